// Python bindings of the core: numpy arrays in, numpy arrays out. Each file binds one library.
#include <malloc.h>

#include <Eigen/Core>
#include <string>

#include "bindings.h"
#include "ground/model/expression_effect.h"
#include "ground/palette.h"
#include "ground/text_width.h"

namespace {

using ground::operator""_a;

pybind11::dict palette() {
  namespace colors = ground::palette;
  return pybind11::dict("measured"_a = colors::kMeasured, "models"_a = colors::kModels,
                        "reference"_a = colors::kReference, "thrusters"_a = colors::kThrusters,
                        "missing"_a = colors::kMissing, "scale"_a = colors::kScale);
}

}  // namespace

PYBIND11_MODULE(_core, module) {
  // Evaluations repeatedly allocate and free the same few megabytes. Keeping them in the process
  // makes a fit a tenth faster than fetching them from the system each time.
  mallopt(M_MMAP_THRESHOLD, 64 << 20);
  mallopt(M_TRIM_THRESHOLD, 256 << 20);

  module.doc() = "The C++ core: model, smoother, fit by simulation error, experiments.";
  module.attr("version") = GROUND_VERSION;
  module.attr("eigen_version") = std::to_string(EIGEN_WORLD_VERSION) + "." +
                                 std::to_string(EIGEN_MAJOR_VERSION) + "." +
                                 std::to_string(EIGEN_MINOR_VERSION);

  module.attr("palette") = palette();
  module.attr("max_effect_states") = ground::kMaxEffectStates;
  module.def("text_width", &ground::textWidth, "text"_a,
             "Width of a line of text in rviz, relative to the height of its letters.");

  ground::bindModel(module);
  ground::bindEquations(module);
  ground::bindEstimation(module);
  ground::bindControl(module);
  ground::bindSimulation(module);
  ground::bindIdentification(module);
  ground::bindGreyBox(module);
}
