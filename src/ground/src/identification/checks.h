// Checks that several estimators share.
#pragma once

#include <string>

#include "ground/identification/run_data.h"

namespace ground::detail {

/// checkRun() for estimators that take no known wrench.
void checkFree(const RunData& run);
/// Error message for a window in which the motion of a model is not finite.
std::string notFinite(const RunData& run, const Window& window);

}  // namespace ground::detail
