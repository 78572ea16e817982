// Bindings of control.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "bindings.h"
#include "ground/control/controllers.h"
#include "ground/control/effect_use.h"
#include "ground/control/excitation_pilot.h"
#include "ground/control/feasibility.h"
#include "ground/control/fence.h"
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
  py::class_<RoomPlan>(module, "RoomPlan", "The floor that a craft may be on, world_ned.")
      .def(py::init<>())
      .def_readwrite("name", &RoomPlan::name)
      .def_readwrite("corners", &RoomPlan::corners)
      .def_readwrite("margin", &RoomPlan::margin)
      .def_readwrite("home", &RoomPlan::home)
      .def_readwrite("braking", &RoomPlan::braking)
      .def_readwrite("latency", &RoomPlan::latency)
      .def("validate", &RoomPlan::validate)
      .def("clearance",
           py::overload_cast<const Vector2<double>&>(&RoomPlan::clearance, py::const_),
           py::arg("point"), "Distance from the nearest wall [m], negative outside.");
  module.def("load_room", &loadRoomPlan, py::arg("path"));
  module.def("parse_room", &parseRoomPlan, py::arg("yaml"), py::arg("source"));
  module.def(
      "leaves_room",
      [](const ReferenceParams& params, const RoomPlan& room) {
        return leavesRoom(*makeReference(params), room);
      },
      py::arg("reference"), py::arg("room"),
      "Why a reference does not fit into a room; empty when it does.");
  py::class_<DesignParams>(module, "DesignParams", "An input design by its name.")
      .def(py::init<>())
      .def_readwrite("kind", &DesignParams::kind)
      .def_readwrite("clock", &DesignParams::clock)
      .def_readwrite("levels", &DesignParams::levels)
      .def_readwrite("order", &DesignParams::order)
      .def_readwrite("seed", &DesignParams::seed)
      .def_readwrite("hold", &DesignParams::hold)
      .def_readwrite("file", &DesignParams::file)
      .def_readwrite("rows_per_bit", &DesignParams::rows_per_bit);
  py::class_<DesignInfo>(module, "DesignInfo", "What a design is.")
      .def_readonly("name", &DesignInfo::name)
      .def_readonly("text", &DesignInfo::text)
      .def_readonly("takes", &DesignInfo::takes);
  module.def("design_table", &designTable);
  py::class_<InputSignal>(module, "InputSignal", "Inputs over time, each held until the next.")
      .def_readonly("end", &InputSignal::end)
      .def_readonly("has_lift", &InputSignal::has_lift)
      .def_readonly("description", &InputSignal::description)
      .def_property_readonly(
          "rows",
          [](const InputSignal& signal) {
            Eigen::MatrixXd rows(static_cast<Eigen::Index>(signal.times.size()), 4);
            for (Eigen::Index i = 0; i < rows.rows(); ++i) {
              const auto at = static_cast<std::size_t>(i);
              const Inputs& inputs = signal.inputs[at];
              rows.row(i) << signal.times[at], inputs.left, inputs.right, inputs.lift;
            }
            return rows;
          },
          "Time [s], left, right, lift (0..1).");
  module.def("make_design", &makeDesign, py::arg("params"), py::arg("duration"));
  py::class_<ReturnParams>(module, "ReturnParams", "How an excitation is kept inside a room.")
      .def(py::init<>())
      .def_readwrite("burst", &ReturnParams::burst)
      .def_readwrite("arrival", &ReturnParams::arrival)
      .def_readwrite("predictive", &ReturnParams::predictive);
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
}

}  // namespace ground
