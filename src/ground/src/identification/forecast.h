// Monte Carlo prediction of a run from what the filter knows at a sample.
#pragma once

#include <random>
#include <vector>

#include "disturbance_filter.h"
#include "ground/identification/grey_box.h"

namespace ground {

/// What the filter knows at a sample if the levels are these, and how likely that is.
struct Alternative {
  DisturbanceLevels levels;
  FilterBelief belief;
  double weight;  ///< at least 0; the weights sum to 1
};

/// Draws motions from belief.sample (the same in all alternatives) to sample `last`. Draws are
/// shared out over the alternatives by their weights.
Forecast forecastBy(const RunData& run, const Model& model,
                    const std::vector<Alternative>& alternatives, int last,
                    const ForecastOptions& options, std::mt19937_64& random);

}  // namespace ground
