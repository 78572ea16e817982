// Bindings of control.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "bindings.h"
#include "ground/control/controllers.h"
#include "ground/control/effect_use.h"
#include "ground/control/feasibility.h"
#include "ground/control/prbs.h"
#include "ground/control/reference_trajectory.h"
#include "ground/control/tracking_watch.h"

namespace py = pybind11;

namespace ground {

void bindControl(py::module_& module) {
  py::class_<ReferenceParams>(module, "ReferenceParams", "A reference trajectory.")
      .def(py::init<>())
      .def_readwrite("kind", &ReferenceParams::kind)
      .def_readwrite("origin", &ReferenceParams::origin)
      .def_readwrite("size", &ReferenceParams::size)
      .def_readwrite("rate_of_turn", &ReferenceParams::rate_of_turn)
      .def_readwrite("petals", &ReferenceParams::petals)
      .def_readwrite("speed", &ReferenceParams::speed)
      .def_readwrite("end", &ReferenceParams::end)
      .def_readwrite("smooth", &ReferenceParams::smooth)
      .def_readwrite("file", &ReferenceParams::file)
      .def(
          "extent", [](const ReferenceParams& params) { return makeReference(params)->extent(); },
          "Time after which it repeats or stands still [s].")
      .def(
          "default_max_error",
          [](const ReferenceParams& params) { return defaultMaxError(*makeReference(params)); },
          "Error beyond which a craft has lost it, unless told otherwise [m].")
      .def(
          "infeasibility",
          [](const ReferenceParams& params, const Model& model) {
            return infeasibility(*makeReference(params), model.body);
          },
          py::arg("model"), "Why the craft cannot follow it exactly; empty when it can.")
      .def(
          "sample",
          [](const ReferenceParams& params, const std::vector<double>& times) {
            const ReferencePtr reference = makeReference(params);
            return toRows(times, 2, [&](double t) {
              return Eigen::RowVector2d(reference->at(std::max(0.0, t)).p.transpose());
            });
          },
          py::arg("times"), "Positions x, y [m] at `times` [s].");
  py::class_<TrackingGains>(module, "TrackingGains", "Gains of the tracking law (4.7).")
      .def(py::init<>())
      .def_readwrite("k_e", &TrackingGains::k_e)
      .def_readwrite("k_z", &TrackingGains::k_z)
      .def_readwrite("k_phi_1", &TrackingGains::k_phi_1)
      .def_readwrite("k_phi_2", &TrackingGains::k_phi_2)
      .def_readwrite("delta_1", &TrackingGains::delta_1)
      .def_readwrite("delta_2", &TrackingGains::delta_2);
  py::class_<PlanWeights>(module, "PlanWeights", "What a plan costs.")
      .def(py::init<>())
      .def_readwrite("velocity", &PlanWeights::velocity)
      .def_readwrite("input", &PlanWeights::input)
      .def_readwrite("turning", &PlanWeights::turning)
      .def_readwrite("end_position", &PlanWeights::end_position)
      .def_readwrite("end_velocity", &PlanWeights::end_velocity);
  py::class_<PredictiveParams>(module, "PredictiveParams", "Model predictive control.")
      .def(py::init<>())
      .def_readwrite("horizon", &PredictiveParams::horizon)
      .def_readwrite("steps", &PredictiveParams::steps)
      .def_readwrite("iterations", &PredictiveParams::iterations)
      .def_readwrite("lost", &PredictiveParams::lost)
      .def_readwrite("search_iterations", &PredictiveParams::search_iterations)
      .def_readwrite("weights", &PredictiveParams::weights)
      .def_readwrite("observer", &PredictiveParams::observer);
  py::class_<PrbsParams>(module, "PrbsParams", "How a binary sequence is played.")
      .def(py::init<>())
      .def_readwrite("clock", &PrbsParams::clock)
      .def_readwrite("duration", &PrbsParams::duration);
  py::class_<ControllerChoice>(module, "ControllerChoice", "A controller by its name.")
      .def(py::init<>())
      .def_readwrite("kind", &ControllerChoice::kind)
      .def_readwrite("gains", &ControllerChoice::gains)
      .def_readwrite("predictive", &ControllerChoice::predictive)
      .def_readwrite("prbs", &ControllerChoice::prbs)
      .def_readwrite("prbs_seed", &ControllerChoice::prbs_seed);
  module.def("controller_names", &controllerNames);
  module.def(
      "effect_use",
      [](const std::string& kind, const Model& model) {
        const EffectUse use = effectUse(kind, model);
        py::dict d;
        d["used"] = use.used;
        d["unused"] = use.unused;
        d["remark"] = use.remark();
        d["refusal"] = use.refusal;
        return d;
      },
      py::arg("kind"), py::arg("model"),
      "What a kind of controller does with the model's effects: names of used and unused ones, a "
      "remark for people, and why it must not drive by the model, empty when it may.");

  module.def("make_prbs", &makePrbs, py::arg("order"), py::arg("seed"),
             "Bits (left, right) of a maximum-length sequence.");
  py::class_<PrbsFile>(module, "PrbsFile", "A binary sequence as a file has it.")
      .def_readonly("rows", &PrbsFile::rows, "Pairs (left, right).")
      .def_readonly("rows_per_bit", &PrbsFile::rows_per_bit)
      .def("describe", &PrbsFile::describe, py::arg("clock"));
  module.def("read_prbs", &readPrbs, py::arg("path"), py::arg("rows_per_bit") = 0);
}

}  // namespace ground
