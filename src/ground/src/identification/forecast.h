// Monte Carlo prediction of a run from what the filter knows at a sample.
#pragma once

#include <random>
#include <vector>

#include "disturbance_filter.h"
#include "ground/identification/grey_box.h"

namespace ground::detail {

/// What the filter believes at a sample under some levels.
struct Alternative {
  DisturbanceLevels levels;
  FilterBelief belief;
  double weight;  ///< probability of these levels
};

/// Parameters of one draw.
struct DrawnModel {
  Model model;
  Eigen::VectorXd away;  ///< from the likeliest ones, coordinates over scale
};

/// Draws a motion of each model from belief.sample (the same in all alternatives) to sample `last`.
/// Each alternative gets its weight's share of the draws. `sensitivity`: of the belief's mean to
/// DrawnModel::away.
Forecast forecastBy(const RunData& run, const std::vector<DrawnModel>& models,
                    const std::vector<Alternative>& alternatives,
                    const Eigen::MatrixXd& sensitivity, int last, const ForecastOptions& options,
                    std::mt19937_64& random);

}  // namespace ground::detail
