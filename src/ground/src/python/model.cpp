// Bindings of the model.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <Eigen/LU>
#include <string>
#include <utility>
#include <vector>

#include "bindings.h"
#include "ground/model/capability.h"
#include "ground/model/drive_clock.h"
#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"
#include "ground/model/plausibility.h"
#include "ground/model/random_wrench.h"
#include "ground/model/simulation.h"

namespace py = pybind11;

namespace ground {
namespace {

py::dict describe(const ParameterInfo& info) {
  return py::dict("name"_a = info.name, "unit"_a = info.unit, "doc"_a = info.doc, "neutral"_a = info.neutral,
                  "lower"_a = info.lower, "upper"_a = info.upper, "shape"_a = info.shape);
}

py::list describe(const std::vector<ParameterInfo>& infos) {
  py::list list;
  for (const ParameterInfo& info : infos) list.append(describe(info));
  return list;
}

/// Starts of drives from the commands and from records, rows of began and as_of (DriveClock).
std::vector<double> driveStarts(const std::vector<double>& times, const std::vector<double>& lift,
                                const std::optional<Eigen::MatrixX2d>& records) {
  if (times.size() != lift.size()) throw std::invalid_argument("times and lift differ in length");
  requireFinite(asColumn(times), "a time");
  requireFinite(asColumn(lift), "the lift");
  DriveClock clock;
  for (std::size_t i = 0; i < times.size(); ++i) clock.command(times[i], lift[i]);
  for (Eigen::Index i = 0; records && i < records->rows(); ++i)
    clock.record((*records)(i, 0), (*records)(i, 1));
  return clock.starts();
}

py::list describeThrusters(const Model& model) {
  const ThrusterLayout& layout = *model.thrusters;
  const double scale = model.body.l / layout.lever();
  py::list list;
  for (const Thruster& one : layout.thrusters()) {
    list.append(py::dict("name"_a = one.name, "channel"_a = one.channel,
                         "position"_a = py::make_tuple(scale * one.position.x(), scale * one.position.y()),
                         "direction"_a = one.direction, "range"_a = py::make_tuple(one.least, one.most),
                         "gain"_a = one.gain, "is_angle"_a = one.isAngle(), "on_off"_a = one.on_off));
  }
  return list;
}

/// The wrench of inputs (n, thrusters), over k and k l: X, Y, N (n, 3).
Eigen::MatrixX3d forcesOf(const Model& model, const Eigen::Ref<const Eigen::MatrixXd>& inputs) {
  const ThrusterLayout& layout = *model.thrusters;
  Dynamics<double>(model).requireThrusters(static_cast<int>(inputs.cols()));
  requireFinite(inputs, "an input");
  Eigen::MatrixX3d wrench(inputs.rows(), 3);
  for (Eigen::Index i = 0; i < inputs.rows(); ++i)
    wrench.row(i) = layout.atRest(Thrusters<double>(inputs.row(i).transpose())).transpose();
  return wrench;
}

/// Checks an optional series with a row for each time; returns whether there is one.
template <class Rows>
bool acts(const std::optional<Rows>& rows, Eigen::Index count, const std::string& what) {
  if (!rows || rows->rows() == 0) return false;
  if (rows->rows() != count) throw std::invalid_argument(what + " needs a row for each time");
  requireFinite(*rows, what.c_str());
  return true;
}

py::dict simulateRun(const Model& model, const Eigen::Ref<const Eigen::MatrixXd>& rows,
                     const std::vector<double>& times, const Vector3<double>& eta, const Vector3<double>& nu,
                     const std::vector<double>& drives, const std::optional<Eigen::MatrixX3d>& wrench,
                     const std::optional<Eigen::MatrixX2d>& room, const Payload& payload,
                     const std::optional<Eigen::MatrixX2d>& battery) {
  InputSequence inputs = toInputs(rows, battery);
  if (!drives.empty()) inputs.drive = DriveClock(drives);
  if (times.empty()) throw std::invalid_argument("there is no time to simulate at");
  const auto count = static_cast<Eigen::Index>(times.size());
  requireFinite(asColumn(times), "a time");
  requireFinite(eta, "the initial pose");
  requireFinite(nu, "the initial velocity");
  const bool pushes = acts(wrench, count, "the wrench");
  const bool draught = acts(room, count, "the force in the room");
  Eigen::MatrixX3d eta_out(count, 3), nu_out(count, 3);
  {
    const py::gil_scoped_release release;
    const Dynamics<double> dynamics(model, payload);
    Simulation<double> simulation(dynamics, inputs, {eta, nu}, times.front());
    const Matrix3<double> mobility = dynamics.mass().inverse();
    for (Eigen::Index i = 0; i < count; ++i) {
      const double time = times[static_cast<std::size_t>(i)];
      if (i > 0 && (pushes || draught)) {
        const double dt = time - simulation.time();
        Vector3<double> impulse = Vector3<double>::Zero();
        Vector2<double> in_room = Vector2<double>::Zero();
        if (pushes) impulse = dt * wrench->row(i - 1).transpose();
        if (draught) in_room = dt * room->row(i - 1).transpose();
        advancePushed(simulation, time, mobility, impulse, in_room);
      } else {
        simulation.advance(time);
      }
      eta_out.row(i) = simulation.measure().eta;
      nu_out.row(i) = simulation.measure().nu;
    }
  }
  if (!eta_out.allFinite() || !nu_out.allFinite())
    throw std::runtime_error("the model's motion is not finite");
  return py::dict("eta"_a = eta_out, "nu"_a = nu_out);
}

Eigen::MatrixXd meanInputsOf(const Model& model, const Eigen::Ref<const Eigen::MatrixXd>& rows,
                             const std::vector<double>& times) {
  if (times.size() < 2) throw std::invalid_argument("means need two times");
  requireFinite(asColumn(times), "a time");
  const InputSequence inputs = toInputs(rows, {});
  const py::gil_scoped_release release;
  return meanInputs(Dynamics<double>(model), inputs, times);
}

void defProvenance(py::module_& module) {
  py::class_<Provenance>(module, "Provenance")
      .def(py::init<>())
      .def_readwrite("date", &Provenance::date)
      .def_readwrite("command", &Provenance::command)
      .def_readwrite("bags", &Provenance::bags)
      .def_readwrite("digests", &Provenance::digests)
      .def_readwrite("error_before", &Provenance::error_before)
      .def_readwrite("error_after", &Provenance::error_after)
      .def_readwrite("confidence_95", &Provenance::confidence_95)
      .def_readwrite("not_identified", &Provenance::not_identified);
}

void defDisturbance(py::module_& module) {
  py::class_<Disturbance>(module, "Disturbance",
                          "A random wrench in addition to the model: X, Y [N], N [N m], body.")
      .def(py::init<>())
      .def_readwrite("sigma", &Disturbance::sigma,
                     "Stationary standard deviation of an Ornstein-Uhlenbeck process (3,).")
      .def_readwrite("time", &Disturbance::time, "Correlation time of that process (3,) [s].")
      .def_readwrite("white", &Disturbance::white,
                     "Root of the two-sided spectral density of white noise (3,) [N sqrt(s), ..].")
      .def_readwrite("trim", &Disturbance::trim,
                     "Standard deviation, from run to run, of a constant wrench (3,).")
      .def_readwrite("trim_thrust", &Disturbance::trim_thrust,
                     "Standard deviation, from run to run, of a factor on the thrust.")
      .def("empty", &Disturbance::empty)
      .def("validate", &Disturbance::validate, "Error message; empty if all values are valid.");
}

void defPayload(py::module_& module) {
  py::class_<Payload>(module, "Payload", "A load of known mass that a craft carries beside its own.")
      .def(py::init([](double mass, const std::pair<double, double>& place, double inertia) {
             return Payload{mass, {place.first, place.second}, inertia};
           }),
           "mass"_a = 0.0, "place"_a = std::pair<double, double>(0, 0), "inertia"_a = 0.0)
      .def_readonly("mass", &Payload::mass, "[kg]")
      .def_readonly("place", &Payload::place, "Of its centre of mass: forward, to starboard [m].")
      .def_readonly("inertia", &Payload::inertia, "About its own centre of mass [kg m^2].")
      .def("empty", &Payload::empty)
      .def(pickledBy(&Payload::mass, &Payload::place, &Payload::inertia));
}

double voltsOf(const Model& model) { return model.body.volts; }
void setVolts(Model& model, double volts) { model.body.volts = volts; }

py::list describeParameters(const Model& model) {
  py::list list;
  for (const ParameterInfo& info : model.parameters()) {
    py::dict described = describe(info);
    described["scale"] = info.scale(model.body);
    list.append(described);
  }
  return list;
}

void defModel(py::module_& module) {
  py::class_<Model>(module, "Model", "A craft: rigid body and effects.")
      .def(py::init<>())
      .def_readwrite("name", &Model::name)
      .def_readwrite("disturbance", &Model::disturbance)
      .def_readwrite("provenance", &Model::provenance)
      .def_property_readonly("input_max", [](const Model& m) { return m.body.input_max; })
      .def_property("volts", &voltsOf, &setVolts, "Voltage of the battery at which k holds [V]; 0: unknown.")
      .def_property_readonly("effects",
                             [](const Model& m) {
                               std::vector<std::string> names;
                               for (const auto& e : m.effects) names.push_back(e.effect->info().name);
                               return names;
                             })
      .def_property_readonly(
          "summaries",
          [](const Model& m) {
            py::dict all;
            for (const auto& e : m.effects) all[py::str(e.effect->info().name)] = e.effect->info().summary;
            return all;
          },
          "What each effect is, by name; empty for formulas of the model file.")
      .def_property_readonly("thrusters", &describeThrusters,
                             "Name, channel, position [m], direction [deg], range and gain of each.")
      .def_property_readonly(
          "channels", [](const Model& m) { return m.thrusters->channels(); },
          "Names of the commands: one for each thruster, in order, then that of the lift.")
      .def_property_readonly(
          "is_pair", [](const Model& m) { return m.thrusters->isPair(); },
          "Whether the thrusters are a left and a right one, which model files do not list.")
      .def_property_readonly("hull_length", [](const Model& m) { return m.body.hull_length; })
      .def("forces", &forcesOf, "inputs"_a,
           "The wrench of inputs (n, thrusters) without effects, over k and k l: X, Y, N (n, 3).")
      .def("copy", [](const Model& m) { return Model(m); })
      .def("parameters", &describeParameters, "Name, unit, doc, neutral value and bounds of every parameter.")
      .def("value", &Model::value, "parameter"_a)
      .def("set_value", &Model::setValue, "parameter"_a, "value"_a)
      .def("penalty", &Model::penalty, "parameters"_a,
           "Prior on the named parameters: W (n, n). The log-likelihood decreases by "
           "(x - x0)' W (x - x0)/2 at coordinates x, with neutral coordinates x0.")
      .def(
          "add_effect",
          [](Model& m, const std::string& name) { m.addEffect(makeEffect(name, *m.thrusters)); }, "name"_a,
          "Adds an effect of the library at its neutral values.")
      .def("remove_effect", &Model::removeEffect, "name"_a)
      .def("format", &formatModel, "The model file's text.")
      .def(py::pickle([](const Model& m) { return formatModel(m); },
                      [](const std::string& text) { return parseModel(text, "a pickle"); }));
}

void defFiles(py::module_& module) {
  module.def(
      "load_model", [](const std::string& path) { return loadModel(path); }, "path"_a);
  module.def(
      "time_scale", &timeScale, "model"_a,
      "Time [s] in which full thrust moves a craft by some lengths or turns it round, rounded: 1 s for a "
      "palm-sized hovercraft, 10 s for a free-flyer.");
  module.def("rounded_time", &roundedTime, "seconds"_a,
             "The nearest of 1, 2 and 5 times a power of ten [s].");
  module.def(
      "load_model_with_warnings",
      [](const std::string& path) {
        std::vector<std::string> warnings;
        Model model = loadModel(path, &warnings);
        return std::make_pair(std::move(model), warnings);
      },
      "path"_a, "The model, and a warning for each implausible value.");
  module.def("parse_model", &parseModel, "text"_a, "source"_a);
  module.def("with_effect", &withEffect, "model"_a, "text"_a, "source"_a,
             "A copy of the model with the effect in this text added.");
  module.def("read_effect_file", &readEffectFile, "path"_a);
}

void defEffects(py::module_& module) {
  module.def(
      "effects",
      [](const Model* model) {
        const ThrusterLayout& layout = model ? *model->thrusters : *thrusterPair();
        py::dict all;
        for (const std::string& name : effectNames(layout)) {
          const EffectPtr effect = makeEffect(name, layout);
          const EffectInfo& info = effect->info();
          all[py::str(name)] =
              py::dict("summary"_a = info.summary, "parameters"_a = describe(info.parameters),
                       "opt_in"_a = info.opt_in, "surroundings"_a = nameOf(info.surroundings),
                       "contains"_a = info.contains);
        }
        return all;
      },
      "model"_a = py::none(),
      "The effects of the library by name; with a model also those of its single thrusters. A diagnosis "
      "tries those with `opt_in` only if the user "
      "names them. `surroundings`: where a craft must be for the effect to act: any, floor, lift (a floor, "
      "with "
      "a lift fan) or water. `contains`: an effect that it equals at some parameters.");
}

void defSimulation(py::module_& module) {
  module.def("simulate", &simulateRun, "model"_a, "inputs"_a, "times"_a, "eta"_a, "nu"_a,
             "drives"_a = std::vector<double>(), "wrench"_a = py::none(), "room"_a = py::none(),
             "payload"_a = Payload(), "battery"_a = py::none(),
             "Simulated measurements of pose and velocity at `times` [s] from a true initial state. Raises "
             "RuntimeError if the motion is not finite. "
             "`inputs`: rows of time, an input for each thruster, lift. `drives`: starts of drives [s]; if "
             "empty, they "
             "follow from the lift. `wrench`: additional X, Y [N], N [N m], each row until the next time; "
             "none by default. `room`: additional force x, y [N] along the axes of the room (world_ned). "
             "`payload`: what the craft carries. `battery`: rows of time [s], voltage [V].");
  module.def("mean_inputs", &meanInputsOf, "model"_a, "inputs"_a, "times"_a,
             "Means of what reaches the craft between ascending `times` [s]: thruster inputs after the "
             "actuators of the model, late by its delay, and the lift, a row for each interval.");
  module.def("drive_starts", &driveStarts, "times"_a, "lift"_a, "records"_a = py::none(),
             "Starts of drives [s], the origins of the model's t, from commands in order of time "
             "and from records (k, 2): began and as_of, in order. Empty without any lift.");
}

}  // namespace

InputSequence toInputs(const Eigen::Ref<const Eigen::MatrixXd>& rows,
                       const std::optional<Eigen::MatrixX2d>& battery) {
  const auto count = static_cast<int>(rows.cols()) - 2;
  if (count < 1 || count > kMaxThrusters)
    throw std::invalid_argument("inputs need columns time, one for each of 1 to " +
                                std::to_string(kMaxThrusters) + " thrusters, lift");
  requireFinite(rows, "an input");
  InputSequence inputs(count);
  for (Eigen::Index i = 0; i < rows.rows(); ++i)
    inputs.add(rows(i, 0), Thrusters<double>(rows.row(i).segment(1, count).transpose()), rows(i, count + 1));
  for (Eigen::Index i = 0; battery && i < battery->rows(); ++i)
    inputs.battery.add((*battery)(i, 0), (*battery)(i, 1));
  return inputs;
}

Eigen::RowVectorXd inputRow(double time, const Thrusters<double>& thrusters, double lift) {
  Eigen::RowVectorXd row(2 + thrusters.size());
  row(0) = time;
  for (int i = 0; i < thrusters.size(); ++i) row(1 + i) = thrusters(i);
  row(row.size() - 1) = lift;
  return row;
}

void bindModel(py::module_& module) {
  defPayload(module);
  defProvenance(module);
  defDisturbance(module);
  defModel(module);
  defFiles(module);
  defEffects(module);
  defSimulation(module);
}

}  // namespace ground
