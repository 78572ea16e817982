// Maximisation of the posterior of parameters and levels.
#pragma once

#include "run_filters.h"

namespace ground::detail {

/// Sets all coordinates, clamped to the bounds of the parameters.
void setCoordinates(Model& model, const std::vector<double>& coordinates);

/// The point of largest posterior near a start. Throws as GreyBox::fit does.
GreyBoxFit ascend(RunFilters& filters, const LevelPrior& prior, const GreyBoxPoint& start,
                  const GreyBoxOptions& options);

}  // namespace ground::detail
