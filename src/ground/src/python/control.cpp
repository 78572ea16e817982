// Bindings of control.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cmath>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "bindings.h"
#include "ground/control/controllers.h"
#include "ground/control/effect_use.h"
#include "ground/control/excitation_pilot.h"
#include "ground/control/feasibility.h"
#include "ground/control/prbs.h"
#include "ground/control/reference_trajectory.h"
#include "ground/control/tracking_watch.h"
#include "ground/safety/fence.h"
#include "ground/safety/fence_bound.h"

namespace py = pybind11;

namespace ground {
namespace {

template <class Params>
std::vector<TunableInfo> infosOf(const Tunables<Params>& table) {
  return {table.begin(), table.end()};
}

py::object toPython(const TunableInfo& info, const Setting& value) {
  return info.type == "int" ? py::int_(std::lround(std::get<double>(value))) : py::cast(value);
}

void defReferences(py::module_& module) {
  py::class_<TunableInfo>(module, "TunableInfo", "Description of a parameter.")
      .def_readonly("name", &TunableInfo::name)
      .def_readonly("unit", &TunableInfo::unit)
      .def_readonly("text", &TunableInfo::text)
      .def_readonly("type", &TunableInfo::type, "double, int, bool or str.")
      .def_readonly("low", &TunableInfo::low)
      .def_readonly("high", &TunableInfo::high)
      .def_property_readonly("default",
                             [](const TunableInfo& info) { return toPython(info, info.standard); });
  py::class_<ReferenceInfo>(module, "ReferenceInfo", "Description of a kind of reference.")
      .def_readonly("name", &ReferenceInfo::name)
      .def_readonly("text", &ReferenceInfo::text)
      .def_readonly("takes", &ReferenceInfo::takes)
      .def_readonly("ends", &ReferenceInfo::ends);
  module.def("reference_table", &referenceTable);
  module.def("reference_parameters", [] { return infosOf(ReferenceParams::table()); });
  py::class_<ReferenceParams> reference(module, "ReferenceParams", "A reference trajectory.");
  defFields(reference, ReferenceParams::table());
  reference.def(py::init<>())
      .def_readwrite("kind", &ReferenceParams::kind)
      .def(
          "extent", [](const ReferenceParams& params) { return makeReference(params)->extent(); },
          "Time after which it repeats or ends [s].")
      .def(
          "default_max_error",
          [](const ReferenceParams& params) { return defaultMaxError(*makeReference(params)); },
          "Default position error at which a craft has lost it [m].")
      .def(
          "infeasibility",
          [](const ReferenceParams& params, const Model& model) {
            return infeasibility(*makeReference(params), model);
          },
          "model"_a, "Why the craft cannot follow it exactly; empty if it can.")
      .def(
          "sample",
          [](const ReferenceParams& params, const std::vector<double>& times) {
            const ReferencePtr path = makeReference(params);
            requireFinite(asColumn(times), "a time");
            return toRows(times, 2, [&](double t) {
              return Eigen::RowVector2d(path->at(std::max(0.0, t)).p.transpose());
            });
          },
          "times"_a, "Positions x, y [m] at `times` [s].");
}

void defControllers(py::module_& module) {
  py::class_<ControllerInfo>(module, "ControllerInfo", "Description of a kind of controller.")
      .def_readonly("name", &ControllerInfo::name)
      .def_readonly("text", &ControllerInfo::text)
      .def_property_readonly("parameters",
                             [](const ControllerInfo& info) { return infosOf(info.parameters); });
  module.def("controller_table", &controllerTable);
  py::class_<ControllerChoice>(module, "ControllerChoice", "A controller by its name.")
      .def(py::init<>())
      .def_readwrite("kind", &ControllerChoice::kind)
      .def_property(
          "values",
          [](const ControllerChoice& choice) {
            py::dict values;
            for (const auto& one : controllerInfo(choice.kind).parameters)
              values[py::str(one.name)] = toPython(one, one.get(choice));
            return values;
          },
          [](ControllerChoice& choice, const std::map<std::string, Setting>& values) {
            const ControllerInfo& info = controllerInfo(choice.kind);
            for (const auto& [name, value] : values) {
              const auto* const one = findNamed(info.parameters, name);
              if (!one)
                throw std::invalid_argument(info.name + " has no parameter '" + name + "'; it has " +
                                            namesOf(info.parameters));
              one->set(choice, value);
            }
          },
          "Values of all parameters of its kind by name. Assignment sets the given ones; raises "
          "ValueError on an unknown name or a wrong type.");
}

void defRoom(py::module_& module) {
  py::class_<Room>(module, "RoomPlan", "The allowed floor area, world_ned.")
      .def(py::init<>())
      .def_readwrite("name", &Room::name)
      .def_readwrite("corners", &Room::corners)
      .def_readwrite("margin", &Room::margin)
      .def_readwrite("home", &Room::home)
      .def_readwrite("braking", &Room::braking)
      .def_readwrite("latency", &Room::latency)
      .def("validate", &Room::validate)
      .def(
          "clearance",
          [](const Room& room, const Vector2<double>& point) {
            const std::string wrong = room.validate();
            if (!wrong.empty()) throw std::invalid_argument(wrong);
            requireFinite(point, "the point");
            return room.clearance(point);
          },
          "point"_a, "Distance from the nearest wall [m], negative outside.");
  module.def("load_room", &loadRoom, "path"_a);
  module.def("parse_room", &parseRoom, "yaml"_a, "source"_a);
  module.def(
      "leaves_room",
      [](const ReferenceParams& params, const Room& room) {
        return leavesRoom(params, *makeReference(params), room);
      },
      "reference"_a, "room"_a, "Why a reference does not fit into a room; empty if it fits.");
}

void defBound(py::module_& module) {
  const auto full = [](const Model& model) {
    ReferencePilot pilot([] { return 0.0; }, nullptr);
    auto controller = makeController(model, ControllerChoice());
    pilot.swapController(controller, model);
    return fullAcceleration(pilot, 0);
  };
  module.def("full_acceleration", full, "model"_a,
             "Largest acceleration of a craft by its thrusters [m/s^2].");
  module.def(
      "fence_bound", [full](const Room& room, const Model& model) { return fenceBound(room, full(model)); },
      "room"_a, "model"_a, "Speeds up to which a craft stays inside, in words.");
  module.def(
      "largest_safe_speed",
      [full](const Room& room, const Model& model, double push, double blind, double thrust_error) {
        return largestSafeSpeed(room, full(model), {push, blind, thrust_error});
      },
      "room"_a, "model"_a, "push"_a, "blind"_a, "thrust_error"_a,
      "Speed up to which the fence keeps a craft inside [m/s], 0 if none is certain. push: share of full "
      "thrust; blind: time without a pose [s]; thrust_error: share of the thrust.");
}

void defDesigns(py::module_& module) {
  py::class_<DesignParams>(module, "DesignParams", "An input design by its name.")
      .def(py::init<>())
      .def_readwrite("kind", &DesignParams::kind)
      .def_readwrite("clock", &DesignParams::clock)
      .def_readwrite("levels", &DesignParams::levels)
      .def_readwrite("order", &DesignParams::order)
      .def_readwrite("seed", &DesignParams::seed)
      .def_readwrite("hold", &DesignParams::hold)
      .def_readwrite("file", &DesignParams::file)
      .def_readwrite("rows_per_bit", &DesignParams::rows_per_bit)
      .def(
          "take_thrusters",
          [](DesignParams& params, const Model& model) { params.thrusters = model.thrusters; }, "model"_a,
          "Makes it a design for the thrusters of a model.");
  py::class_<DesignInfo>(module, "DesignInfo", "Description of a design.")
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
            Eigen::MatrixXd rows(static_cast<Eigen::Index>(signal.times.size()),
                                 2 + signal.thrusters->size());
            for (Eigen::Index i = 0; i < rows.rows(); ++i) {
              const auto at = static_cast<std::size_t>(i);
              const Inputs& inputs = signal.inputs[at];
              rows.row(i) = inputRow(signal.times[at], inputs.thrusters, inputs.lift);
            }
            return rows;
          },
          "Time [s], inputs of the thrusters, lift.");
  module.def("make_design", &makeDesign, "params"_a, "duration"_a);
  py::class_<ReturnParams>(module, "ReturnParams", "Bursts and returns of an excitation in a room.")
      .def(py::init<>())
      .def_readwrite("burst", &ReturnParams::burst);
}

void defEffectUse(py::module_& module) {
  module.def(
      "effect_use",
      [](const std::string& kind, const Model& model) {
        const EffectUse use = effectUse(kind, model);
        return py::dict("used"_a = use.used, "unused"_a = use.unused, "remark"_a = use.remark(),
                        "refusal"_a = use.refusal);
      },
      "kind"_a, "model"_a,
      "How a kind of controller uses the model's effects: names of used and unused ones, a remark "
      "for users, and why it must not drive by the model (empty if it may).");
  module.def("make_prbs", &makePrbs, "order"_a, "seed"_a, "Bits (left, right) of a maximum-length sequence.");
}

}  // namespace

void bindControl(py::module_& module) {
  defReferences(module);
  defControllers(module);
  defRoom(module);
  defBound(module);
  defDesigns(module);
  defEffectUse(module);
}

}  // namespace ground
