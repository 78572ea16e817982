// Maximisation of the posterior of parameters and levels.
#pragma once

#include "estimates.h"
#include "run_filters.h"

namespace ground::detail {

/// The point of largest posterior near a start. Throws as GreyBox::fit does.
GreyBoxFit maximiseLikelihood(RunFilters& filters, const LevelPrior& prior, const GreyBoxPoint& start,
                              const GreyBoxOptions& options);

/// Standard deviations of parameters in coordinates over scale; infinite if they are not identifiable.
Eigen::VectorXd deviationsOf(const Identifiable& known);

}  // namespace ground::detail
