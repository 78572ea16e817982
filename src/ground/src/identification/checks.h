// Checks that several estimators share.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "ground/identification/run_data.h"

namespace ground::detail {

/// checkRun() for estimators that take no known wrench.
void checkFree(const RunData& run);
/// Throws std::invalid_argument unless the longest gap within a stretch is positive.
void checkGap(double max_gap);
/// Throws std::invalid_argument unless acting wrenches are finite and have a row a sample and a
/// channel, 0 to 2, for each column.
void checkActing(const Eigen::MatrixXd& acting, const std::vector<int>& channels, std::size_t samples);
/// Error message for a window in which the motion of a model is not finite.
std::string notFinite(const RunData& run, const Window& window);

}  // namespace ground::detail
