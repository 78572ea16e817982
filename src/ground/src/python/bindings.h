// Parts of the Python module, a function each.
#pragma once

#include <pybind11/pybind11.h>

namespace ground {

void bindGreyBox(pybind11::module_& module);

}  // namespace ground
