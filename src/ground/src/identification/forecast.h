// Monte Carlo prediction of a run from the filtered state at a sample.
#pragma once

#include <random>
#include <vector>

#include "disturbance_filter.h"
#include "ground/identification/grey_box.h"

namespace ground::detail {

/// The filtered state at a sample for one set of levels.
struct Alternative {
  DisturbanceLevels levels;
  FilterBelief belief;
  double weight;  ///< probability of these levels
};

/// Parameters of one draw.
struct DrawnModel {
  Model model;
  Eigen::VectorXd away;  ///< deviation from the maximum-likelihood values, coordinates over scale
};

/// Draws a motion of each model from belief.sample (the same in all alternatives) to sample `last`.
/// Each alternative gets a number of draws in proportion to its weight. `sensitivity`: derivative
/// of the belief's mean by DrawnModel::away.
Forecast forecastBy(const RunData& run, const std::vector<DrawnModel>& models,
                    const std::vector<Alternative>& alternatives, const Eigen::MatrixXd& sensitivity,
                    int last, const ForecastOptions& options, std::mt19937_64& random);

}  // namespace ground::detail
