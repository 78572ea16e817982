// Monte Carlo prediction of a run from what the filter knows at a sample.
#pragma once

#include <random>
#include <vector>

#include "disturbance_filter.h"
#include "ground/identification/grey_box.h"

namespace ground {

/// What the filter believes at a sample under some levels.
struct Alternative {
  DisturbanceLevels levels;
  FilterBelief belief;
  double weight;  ///< probability of these levels
};

/// Draws motions from belief.sample (the same in all alternatives) to sample `last`. Each
/// alternative gets its weight's share of the draws.
Forecast forecastBy(const RunData& run, const Model& model,
                    const std::vector<Alternative>& alternatives, int last,
                    const ForecastOptions& options, std::mt19937_64& random);

}  // namespace ground
