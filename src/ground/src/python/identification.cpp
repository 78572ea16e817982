// Bindings of identification.
#include "ground/identification/identification.h"

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <map>

#include "bindings.h"

namespace py = pybind11;

namespace ground {
namespace {

Eigen::MatrixXd fromInputs(const RunData& run) {
  const InputSequence& inputs = run.inputs;
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(inputs.size()), 2 + inputs.thruster_count);
  for (std::size_t i = 0; i < inputs.size(); ++i)
    rows.row(static_cast<Eigen::Index>(i)) = inputRow(inputs.times[i], inputs.thrusters[i], inputs.lift[i]);
  return rows;
}

Eigen::MatrixX2d fromBattery(const RunData& run) {
  const VoltageSeries& battery = run.inputs.battery;
  Eigen::MatrixX2d rows(static_cast<Eigen::Index>(battery.times.size()), 2);
  rows << asColumn(battery.times), asColumn(battery.volts);
  return rows;
}

std::optional<Eigen::MatrixX2d> batteryOf(const RunData& run) {
  return run.inputs.battery.empty() ? std::nullopt : std::optional<Eigen::MatrixX2d>(fromBattery(run));
}

RunData makeRun(const std::string& name, const std::vector<double>& times, const Eigen::MatrixX3d& eta,
                const Eigen::MatrixX3d& nu, const Eigen::Ref<const Eigen::MatrixXd>& inputs,
                const std::optional<Eigen::MatrixX3d>& poses, const std::optional<Vector3<double>>& noise,
                const std::vector<double>& drives, const std::optional<Eigen::MatrixX3d>& wrench,
                const std::optional<InertialData>& inertial, const std::optional<Payload>& payload,
                const std::optional<Eigen::MatrixX2d>& battery, const RunScales& scales) {
  RunData run{name,
              times,
              eta,
              nu,
              toInputs(inputs, battery),
              poses.value_or(Eigen::MatrixX3d(0, 3)),
              noise.value_or(RunData().noise),
              wrench.value_or(Eigen::MatrixX3d(0, 3)),
              inertial.value_or(InertialData()),
              payload.value_or(Payload()),
              scales};
  if (!drives.empty()) run.inputs.drive = DriveClock(drives);
  return run;
}

/// How a run passes to other processes: the arguments of makeRun.
using RunState = std::tuple<std::string, std::vector<double>, Eigen::MatrixX3d, Eigen::MatrixX3d,
                            Eigen::MatrixXd, Eigen::MatrixX3d, Vector3<double>, std::vector<double>,
                            Eigen::MatrixX3d, InertialData, Payload, Eigen::MatrixX2d, RunScales>;

/// The run with other values; what is not given stays. A known wrench belongs to samples: other times need
/// another one.
RunData replaced(const RunData& run, const std::optional<std::vector<double>>& times,
                 const std::optional<Eigen::MatrixX3d>& eta, const std::optional<Eigen::MatrixX3d>& nu,
                 const std::optional<Eigen::MatrixXd>& inputs, const std::optional<Eigen::MatrixX3d>& poses,
                 const std::optional<Vector3<double>>& noise, const std::optional<Eigen::MatrixX3d>& wrench,
                 const std::optional<InertialData>& inertial) {
  RunData other = run;
  if (times) other.wrench.resize(0, 3);
  const auto set = [](auto& value, const auto& given) {
    if (given) value = *given;
  };
  set(other.times, times);
  set(other.eta, eta);
  set(other.nu, nu);
  set(other.poses, poses);
  set(other.noise, noise);
  set(other.wrench, wrench);
  set(other.inertial, inertial);
  if (!inputs) return other;
  InputSequence sequence = toInputs(*inputs);
  sequence.drive = run.inputs.drive;
  sequence.battery = run.inputs.battery;
  other.inputs = std::move(sequence);
  return other;
}

/// The times as an array that shares the run's memory.
py::array timesOf(const py::object& self) {
  const auto& run = self.cast<const RunData&>();
  py::array_t<double> times(static_cast<py::ssize_t>(run.times.size()), run.times.data(), self);
  times.attr("setflags")("write"_a = false);
  return std::move(times);
}

py::dict toDict(const FitResult& result) {
  return py::dict("model"_a = result.model, "parameters"_a = toList(result.parameters),
                  "correlation"_a = result.correlation, "condition"_a = result.condition,
                  "objective"_a = result.objective, "initial"_a = result.initial,
                  "shifted"_a = result.shifted, "width"_a = result.width, "starts"_a = result.starts,
                  "starts_at_best"_a = result.starts_at_best, "freedom"_a = result.freedom,
                  "iterations"_a = result.iterations, "converged"_a = result.converged);
}

void defInertialData(py::module_& module) {
  py::class_<InertialData>(module, "InertialData", "Samples of a gyro and an accelerometer, calibrated.")
      .def(py::init<>(), "No samples.")
      .def(py::init([](std::vector<double> times, const Eigen::MatrixX3d& values,
                       const Vector3<double>& noise, const Vector2<double>& place) {
             return InertialData{std::move(times), values, noise, place};
           }),
           "times"_a, "values"_a, "noise"_a, "place"_a)
      .def_readonly("times", &InertialData::times, "[s], on the run's clock.")
      .def_readonly("values", &InertialData::values,
                    "Yaw rate [rad/s], specific force ahead and to starboard [m/s^2].")
      .def_readonly("noise", &InertialData::noise, "Standard deviations of a sample.")
      .def_readonly("place", &InertialData::place, "From the measured point, ahead and to starboard [m].")
      .def(
          pickledBy(&InertialData::times, &InertialData::values, &InertialData::noise, &InertialData::place));
}

void defRunScales(py::module_& module) {
  using One = RunScales;
  py::class_<One>(module, "RunScales", "Scales of a run that follow from its poses and its craft.")
      .def(py::init([](double max_gap, double linear_jerk, double angular_jerk, double window) {
             return One{max_gap, linear_jerk, angular_jerk, window};
           }),
           "max_gap"_a = One().max_gap, "linear_jerk"_a = One().linear_jerk,
           "angular_jerk"_a = One().angular_jerk, "window"_a = One().window)
      .def_readonly("max_gap", &One::max_gap, "Longest time between poses that is bridged [s].")
      .def_readonly("linear_jerk", &One::linear_jerk, "By which poses were smoothed [m/s^2.5].")
      .def_readonly("angular_jerk", &One::angular_jerk, "The same of the heading [rad/s^2.5].")
      .def_readonly("window", &One::window, "Length of the windows over which errors are taken [s].")
      .def(pickledBy(&One::max_gap, &One::linear_jerk, &One::angular_jerk, &One::window));
}

void defRecording(py::module_& module) {
  py::class_<RunData>(module, "RunData", "A recording: measurements and commands on one clock.")
      .def(py::init(&makeRun), "name"_a, "times"_a, "eta"_a, "nu"_a, "inputs"_a, "poses"_a = py::none(),
           "noise"_a = py::none(), "drives"_a = std::vector<double>(), "wrench"_a = py::none(),
           "inertial"_a = py::none(), "payload"_a = py::none(), "battery"_a = py::none(),
           "scales"_a = RunScales())
      .def("replaced", &replaced, py::kw_only(), "times"_a = py::none(), "eta"_a = py::none(),
           "nu"_a = py::none(), "inputs"_a = py::none(), "poses"_a = py::none(), "noise"_a = py::none(),
           "wrench"_a = py::none(), "inertial"_a = py::none(),
           "The run with other values; what is not given stays. Other times drop a known wrench.")
      .def_readonly("payload", &RunData::payload)
      .def_readonly("name", &RunData::name)
      .def_property_readonly("times", &timesOf, "Read-only view [s].")
      .def_readonly("eta", &RunData::eta)
      .def_readonly("nu", &RunData::nu)
      .def_readonly("poses", &RunData::poses)
      .def_readonly("noise", &RunData::noise)
      .def_readonly("wrench", &RunData::wrench)
      .def_readwrite("scales", &RunData::scales)
      .def_property_readonly(
          "inertial",
          [](const RunData& run) {
            return run.inertial.empty() ? std::nullopt : std::optional<InertialData>(run.inertial);
          },
          "The InertialData; None if there are none.")
      .def_property_readonly("inputs", &fromInputs, "Rows of time, an input for each thruster, lift.")
      .def_property_readonly("battery", &batteryOf, "Rows of time, voltage [V]; None if it is not known.")
      .def_property_readonly(
          "drives", [](const RunData& run) { return run.inputs.drive.starts(); },
          "Start of each drive [s], on the run's clock.")
      .def_property_readonly(
          "t",
          [](const RunData& run) {
            Eigen::VectorXd t(static_cast<Eigen::Index>(run.times.size()));
            for (std::size_t i = 0; i < run.times.size(); ++i)
              t(static_cast<Eigen::Index>(i)) = run.inputs.drive.since(run.times[i]);
            return t;
          },
          "Time since the drive began at each sample [s]: the model's t.")
      .def(py::pickle(
          [](const RunData& r) {
            return std::make_tuple(r.name, r.times, r.eta, r.nu, fromInputs(r), r.poses, r.noise,
                                   r.inputs.drive.starts(), r.wrench, r.inertial, r.payload, fromBattery(r),
                                   r.scales);
          },
          [](const RunState& all) { return std::apply(&makeRun, all); }));
  py::class_<Window>(module, "Window")
      .def(py::init([](int run, int first, int last) {
             return Window{run, first, last};
           }),
           "run"_a, "first"_a, "last"_a)
      .def_readonly("run", &Window::run)
      .def_readonly("first", &Window::first)
      .def_readonly("last", &Window::last)
      .def(pickledBy(&Window::run, &Window::first, &Window::last));
  module.def("cut_windows", &cutWindows, "run"_a, "run_index"_a, "start"_a, "end"_a, "length"_a,
             "max_gap"_a = py::none());
}

void defSimulationError(py::module_& module) {
  py::enum_<FitOptions::Objective>(module, "Objective")
      .value("least_squares", FitOptions::Objective::kLeastSquares)
      .value("thesis", FitOptions::Objective::kThesis);
  py::enum_<Target>(module, "Target").value("velocities", Target::kVelocities).value("poses", Target::kPoses);
  py::class_<SimulationError>(module, "SimulationError", "Simulation minus measurement.")
      .def(py::init<std::vector<RunData>, std::vector<Window>, Target>(), "runs"_a, "windows"_a,
           "target"_a = Target::kVelocities)
      .def("sigma", &SimulationError::sigma, "run"_a)
      .def(
          "simulate",
          [](const SimulationError& problem, const Model& model, FitOptions::Objective objective) {
            const auto simulation = withoutGil([&] { return problem.simulate(model, objective); });
            return py::dict("objective"_a = problem.objective(simulation), "eta"_a = simulation.eta,
                            "nu"_a = simulation.nu);
          },
          "model"_a, "objective"_a = FitOptions::Objective::kLeastSquares,
          "Simulates every window with the initial velocities that minimise the objective.")
      .def(
          "fit",
          [](const SimulationError& problem, const Model& model, const std::vector<std::string>& free,
             FitOptions::Objective objective, int starts, int threads, double width, bool warm,
             const std::vector<Eigen::VectorXd>& initial,
             const std::map<std::string, std::pair<double, double>>& priors,
             const std::vector<std::string>& kept) {
            FitOptions options;
            options.kept = kept;
            options.free = free;
            options.width = width;
            options.warm = warm;
            options.initial = initial;
            for (const auto& [name, known] : priors)
              options.priors.push_back({name, known.first, known.second});
            options.starts = starts;
            options.threads = threads;
            options.objective = objective;
            const auto result = withoutGil([&] { return problem.fit(model, options); });
            return toDict(result);
          },
          "model"_a, "free"_a, "objective"_a = FitOptions::Objective::kLeastSquares, "starts"_a = 1,
          "threads"_a = 0, "width"_a = 0.0, "warm"_a = false, "initial"_a = std::vector<Eigen::VectorXd>(),
          "priors"_a = std::map<std::string, std::pair<double, double>>(),
          "kept"_a = std::vector<std::string>());
}

void defPrediction(py::module_& module) {
  module.def(
      "predict",
      [](const Model& model, const RunData& run, const std::vector<Window>& windows,
         const Eigen::MatrixX3d& nu) {
        const auto simulation = withoutGil([&] { return predict(model, run, windows, nu); });
        return py::dict("eta"_a = simulation.eta, "nu"_a = simulation.nu);
      },
      "model"_a, "run"_a, "windows"_a, "nu"_a,
      "Simulates windows from the measured pose and the given velocity (a row each), without "
      "correction.");
}

}  // namespace

py::list toList(const std::vector<FittedParameter>& parameters) {
  py::list list;
  for (const FittedParameter& p : parameters) {
    list.append(py::dict("name"_a = p.name, "unit"_a = p.unit, "start"_a = p.start, "value"_a = p.value,
                         "ci95"_a = py::make_tuple(p.lower, p.upper), "deviation"_a = p.deviation,
                         "at_bound"_a = p.at_bound, "identified"_a = p.identified));
  }
  return list;
}

void bindIdentification(py::module_& module) {
  defInertialData(module);
  defRunScales(module);
  defRecording(module);
  defSimulationError(module);
  defPrediction(module);
}

}  // namespace ground
