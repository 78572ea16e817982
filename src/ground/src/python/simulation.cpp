// Bindings of simulated experiments.
#include <pybind11/eigen.h>
#include <pybind11/functional.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "bindings.h"
#include "ground/simulation/experiment.h"
#include "ground/simulation/simulated_imu.h"

namespace py = pybind11;

namespace ground {
namespace {

py::dict toDict(const ExperimentLog& log) {
  const auto frames = toRows(log.frames, 5, [](const MocapFrame& f) {
    return (Eigen::RowVectorXd(5) << f.captured, f.delivered, f.eta.transpose()).finished();
  });
  const int thrusters = log.commands.empty() ? 2 : log.commands.front().thrusters.size();
  const auto rows = [&](const std::vector<ExperimentLog::Command>& commands) {
    return toRows(commands, 2 + thrusters,
                  [](const ExperimentLog::Command& c) { return inputRow(c.time, c.thrusters, c.lift); });
  };
  const auto truth = toRows(log.truth, 14, [](const ExperimentLog::Truth& t) {
    return (Eigen::RowVectorXd(14) << t.time, t.state.eta.transpose(), t.state.nu.transpose(),
            t.nu_dot.transpose(), t.wrench.transpose(), t.voltage)
        .finished();
  });
  const auto references = toRows(log.references, 9, [](const ExperimentLog::Reference& r) {
    return (Eigen::RowVectorXd(9) << r.time, r.point.p.transpose(), r.point.p_dot.transpose(),
            r.point.p_ddot.transpose(), r.point.p_dddot.transpose())
        .finished();
  });
  const auto decisions = toRows(log.decisions, 3 + 2 * thrusters, [](const ReferencePilot::Decision& made) {
    return (Eigen::RowVectorXd(3 + 2 * made.inputs.size()) << made.now, made.stamp, made.computing,
            asVector(made.inputs).transpose(), asVector(made.wanted).transpose())
        .finished();
  });
  py::list marks;
  for (const ExcitationPilot::Mark& mark : log.marks)
    marks.append(py::make_tuple(mark.time, mark.number, mark.burst, mark.reason));
  py::list stages;
  for (const ExperimentLog::Stage& stage : log.stages)
    stages.append(py::make_tuple(stage.time, nameOf(stage.state), stage.reason));
  return py::dict("frames"_a = frames, "commands"_a = rows(log.commands), "sent"_a = rows(log.sent),
                  "truth"_a = truth, "references"_a = references, "decisions"_a = decisions,
                  "marks"_a = marks, "stages"_a = stages, "stopped"_a = log.stopped,
                  "stopped_at"_a = log.stopped_at);
}

/// A craft whose motion is written in Python.
class PythonPlant : public Plant {
 public:
  void command(const Thrusters<double>& thrusters, double lift) override {
    const Eigen::VectorXd inputs = asVector(thrusters);
    PYBIND11_OVERRIDE_PURE(void, Plant, command, inputs, lift);
  }
  void advance(double time) override { PYBIND11_OVERRIDE_PURE(void, Plant, advance, time); }
  RigidState<double> state() const override {
    const Pair found = stateVectors();
    return {found.first, found.second};
  }
  RigidState<double> derivative() const override {
    const Pair found = derivativeVectors();
    return {found.first, found.second};
  }
  Measurement<double> measurement() const override {
    const Pair found = measurementVectors();
    return {found.first, found.second};
  }
  Vector3<double> wrench() const override { PYBIND11_OVERRIDE_PURE(Vector3<double>, Plant, wrench, ); }
  Vector3<double> poseNoise() override {
    PYBIND11_OVERRIDE_NAME(Vector3<double>, Plant, "pose_noise", poseNoise, );
  }

 private:
  using Pair = std::pair<Vector3<double>, Vector3<double>>;

  Pair stateVectors() const { PYBIND11_OVERRIDE_PURE_NAME(Pair, Plant, "state", state, ); }
  Pair derivativeVectors() const { PYBIND11_OVERRIDE_PURE_NAME(Pair, Plant, "derivative", derivative, ); }
  Pair measurementVectors() const { PYBIND11_OVERRIDE_PURE_NAME(Pair, Plant, "measurement", measurement, ); }
};

/// Pose and velocity, or their derivatives, as Python has them.
template <class Motion>
py::tuple toTuple(const Motion& motion) {
  return py::make_tuple(motion.eta, motion.nu);
}

void defPlant(py::module_& module) {
  py::class_<Plant, PythonPlant>(
      module, "Plant",
      "Base class of a simulated craft whose motion is written in Python. An experiment calls its "
      "methods; all but pose_noise must be overridden. Poses are x, y [m], psi [rad], world_ned; "
      "velocities u, v [m/s], r [rad/s], body.")
      .def(py::init<>())
      .def(
          "command",
          [](Plant& plant, const Eigen::VectorXd& thrusters, double lift) {
            Thrusters<double> inputs = Thrusters<double>::zero(static_cast<int>(thrusters.size()));
            for (int i = 0; i < inputs.size(); ++i) inputs(i) = thrusters(i);
            plant.command(inputs, lift);
          },
          "thrusters"_a, "lift"_a,
          "The craft receives a command at the current time: an input for each thruster, in the "
          "model's units, and lift, 0..1.")
      .def("advance", &Plant::advance, "time"_a,
           "Moves the craft to a time of the experiment's clock [s], which begins at 0.")
      .def(
          "state", [](const Plant& plant) { return toTuple(plant.state()); },
          "True pose (3,) and velocity (3,) now.")
      .def(
          "derivative", [](const Plant& plant) { return toTuple(plant.derivative()); },
          "Derivatives of true pose (3,) and velocity (3,) now.")
      .def(
          "measurement", [](const Plant& plant) { return toTuple(plant.measurement()); },
          "Pose (3,) and velocity (3,) of the rigid body that the mocap sees, without noise.")
      .def("wrench", &Plant::wrench, "Disturbance (3,) now: X, Y [N], N [N m], body.")
      .def("pose_noise", &Plant::poseNoise,
           "Noise (3,) of the pose in the frame that is captured now [m], [m], [rad], besides that "
           "of MocapParams. Called once for every frame, delivered or lost.");
}

ExperimentParams experimentParams(const Vector3<double>& eta, const Vector3<double>& nu,
                                  const MocapParams& mocap, unsigned long seed,
                                  const Disturbance& disturbance, Plant* plant,
                                  const std::pair<double, double>& battery, const Hazards& hazards = {},
                                  double imu_rate = 0) {
  if (!eta.allFinite() || !nu.allFinite()) throw std::invalid_argument("the initial state is not finite");
  ExperimentParams params{{eta, nu}, mocap, seed};
  params.disturbance = disturbance;
  params.plant = plant;
  params.battery = {battery.first, battery.second};
  params.hazards = hazards;
  params.imu_rate = imu_rate;
  return params;
}

/// Defines an experiment that a controller drives.
template <class Params>
void defExperiment(py::module_& module, const char* name, const char* params_name,
                   ExperimentLog (*run)(const Model&, const Model&, const Params&, const ExperimentParams&),
                   const char* doc) {
  module.def(
      name,
      [run](const Model& model, const Model& believed, const Params& drive, const Vector3<double>& eta,
            const Vector3<double>& nu, const MocapParams& mocap, unsigned long seed,
            const Disturbance& disturbance, Plant* plant, const std::pair<double, double>& battery,
            const Hazards& hazards, double imu_rate) {
        const ExperimentParams params =
            experimentParams(eta, nu, mocap, seed, disturbance, plant, battery, hazards, imu_rate);
        const auto log = withoutGil([&] { return run(model, believed, drive, params); });
        return toDict(log);
      },
      "model"_a, "believed"_a, py::arg(params_name), "eta"_a, "nu"_a, "mocap"_a, "seed"_a,
      "disturbance"_a = Disturbance(), "plant"_a = nullptr, "battery"_a = std::make_pair(0.0, 1.0),
      "hazards"_a = Hazards(), "imu_rate"_a = 0.0, doc);
}

void defParams(py::module_& module) {
  py::class_<MocapParams>(module, "MocapParams", "Quality of the simulated motion capture.")
      .def(py::init<>())
      .def_readwrite("rate", &MocapParams::rate)
      .def_readwrite("position_noise", &MocapParams::position_noise)
      .def_readwrite("heading_noise", &MocapParams::heading_noise)
      .def_readwrite("latency", &MocapParams::latency)
      .def_readwrite("loss", &MocapParams::loss)
      .def_readwrite("gap_rate", &MocapParams::gap_rate)
      .def_readwrite("gap_length", &MocapParams::gap_length)
      .def_readwrite("gaps_vary", &MocapParams::gaps_vary);
  py::class_<LifecycleParams>(module, "LifecycleParams", "Parameters of all controllers.")
      .def(py::init<>())
      .def_readwrite("lift", &LifecycleParams::lift)
      .def_readwrite("lift_time", &LifecycleParams::lift_time)
      .def_readwrite("state_timeout", &LifecycleParams::state_timeout)
      .def_readwrite("recovery_time", &LifecycleParams::recovery_time)
      .def_readwrite("rate", &LifecycleParams::rate);
  py::class_<GroundLinkParams> link(module, "GroundLinkParams", "When the sender gives up.");
  defFields(link, GroundLinkParams::table());
  py::class_<DriveParams>(module, "DriveParams", "A controller, its life cycle and the sender.")
      .def_readwrite("estimate", &DriveParams::estimate)
      .def_readwrite("estimator", &DriveParams::estimator)
      .def_readwrite("life", &DriveParams::life)
      .def_readwrite("link", &DriveParams::link)
      .def_readwrite("start", &DriveParams::start)
      .def_readwrite("duration", &DriveParams::duration)
      .def_readwrite("tail", &DriveParams::tail)
      .def_readwrite("room", &DriveParams::room);
  py::class_<TrackingParams, DriveParams>(module, "TrackingParams",
                                          "The tracking controller of an experiment.")
      .def(py::init<>())
      .def_readwrite("reference", &TrackingParams::reference)
      .def_readwrite("controller", &TrackingParams::controller)
      .def_readwrite("law", &TrackingParams::law)
      .def_readwrite("max_error", &TrackingParams::max_error);
  py::class_<ExcitationParams, DriveParams>(module, "ExcitationParams",
                                            "An input design; with a room, in bursts between returns.")
      .def(py::init<>())
      .def_readwrite("design", &ExcitationParams::design)
      .def_readwrite("returns", &ExcitationParams::returns);
}

void defHazards(py::module_& module) {
  py::class_<Hazards> hazards(module, "Hazards",
                              "What goes wrong in an experiment; spells are (start, duration) [s].");
  const auto spell = [&hazards](const char* name, Hazards::Spell Hazards::*member, const char* doc) {
    hazards.def_property(
        name, [member](const Hazards& h) { return py::make_tuple((h.*member).from, (h.*member).duration); },
        [member](Hazards& h, const std::pair<double, double>& given) {
          h.*member = {given.first, given.second};
        },
        doc);
  };
  spell("pushed", &Hazards::pushed, "When the push acts.");
  spell("unseen", &Hazards::unseen, "Poses captured then are lost.");
  spell("unheard", &Hazards::unheard, "Commands sent then do not reach the craft.");
  hazards.def(py::init<>())
      .def_readwrite("push", &Hazards::push, "Force x, y [N], world_ned.")
      .def_readwrite("axes", &Hazards::axes)
      .def_readwrite("heading_offset", &Hazards::heading_offset)
      .def_readwrite("upright_time", &Hazards::upright_time)
      .def_readwrite("braking", &Hazards::braking);
}

void defExperiments(py::module_& module) {
  module.def(
      "play_schedule",
      [](const Model& model, const Eigen::Ref<const Eigen::MatrixXd>& schedule, double duration,
         const Vector3<double>& eta, const Vector3<double>& nu, const MocapParams& mocap, unsigned long seed,
         const Disturbance& disturbance, Plant* plant, const std::pair<double, double>& battery) {
        const InputSequence inputs = toInputs(schedule);
        const ExperimentParams params = experimentParams(eta, nu, mocap, seed, disturbance, plant, battery);
        const auto log = withoutGil([&] { return playSchedule(model, inputs, duration, params); });
        return toDict(log);
      },
      "model"_a, "schedule"_a, "duration"_a, "eta"_a, "nu"_a, "mocap"_a, "seed"_a,
      "disturbance"_a = Disturbance(), "plant"_a = nullptr, "battery"_a = std::make_pair(0.0, 1.0),
      "Simulates craft and mocap under rows of time, an input for each thruster, lift. Returns frames "
      "(captured, delivered, x, y, psi), commands (such rows), truth (time, eta, nu, "
      "nu_dot, wrench of the disturbance, voltage). battery: its endurance at full power [s], 0 for none, "
      "and "
      "its charge. plant: the craft; then eta, nu, disturbance and battery are not used, and the model "
      "gives the thrusters. By default the model moves the craft.");
  defExperiment(module, "track_reference", "tracking", &trackReference,
                "Like play_schedule with a controller and the sender in the loop. Also returns sent (as "
                "commands: what has left for the craft), references (time, "
                "p, p_dot, p_ddot, p_dddot), decisions (time, stamp of the state, CPU time, fractions of "
                "the largest input, the same before saturation), stages (time, state, reason), "
                "stopped (why it stopped early; empty if it did not) and stopped_at. hazards: what goes "
                "wrong. imu_rate: of a simulated gyro and accelerometer [Hz], 0 for none.");
  defExperiment(module, "excite", "excitation", &excite,
                "Like track_reference with an input design. Also returns marks (time, number, true "
                "for a burst and false for a return, reason).");
}

Eigen::MatrixX3d sense(const Eigen::MatrixX3d& nu, const Eigen::MatrixX3d& nu_dot, unsigned seed) {
  if (nu.rows() != nu_dot.rows() || !nu.allFinite() || !nu_dot.allFinite())
    throw std::invalid_argument("velocities and their derivatives must be finite and of one shape");
  SimulatedImu imu(seed);
  Eigen::MatrixX3d rows(nu.rows(), 3);
  for (Eigen::Index i = 0; i < nu.rows(); ++i) {
    const ImuSample sample = imu.sample({Vector3<double>::Zero(), nu.row(i).transpose()}, nu_dot.row(i));
    rows.row(i) << sample.yaw_rate, sample.acceleration[0], sample.acceleration[1];
  }
  return rows;
}

}  // namespace

void bindSimulation(py::module_& module) {
  defParams(module);
  defPlant(module);
  defHazards(module);
  defExperiments(module);
  module.def("sense", &sense, "nu"_a, "nu_dot"_a, "seed"_a,
             "What a simulated gyro and accelerometer measure (n, 3), in the flight controller's "
             "units: yaw rate, acceleration ahead and to starboard.");
}

}  // namespace ground
