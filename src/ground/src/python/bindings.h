// Parts of the Python module, a function each.
#pragma once

#include <pybind11/pybind11.h>

#include <vector>

#include "ground/identification/simulation_error.h"

namespace ground {

/// Dictionaries: name, unit, start, value, ci95, deviation, at_bound, identified.
pybind11::list toList(const std::vector<FittedParameter>& parameters);
void bindGreyBox(pybind11::module_& module);

}  // namespace ground
