// Python's view of the core: numpy arrays in, numpy arrays out.
#include <Eigen/LU>
#include <ceres/version.h>
#include <malloc.h>
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "bindings.h"
#include "ground/control/feasibility.h"
#include "ground/control/prbs.h"
#include "ground/control/tracking_watch.h"
#include "ground/estimation/axis_mapping.h"
#include "ground/estimation/smoother.h"
#include "ground/identification/inferred_wrench.h"
#include "ground/identification/prediction.h"
#include "ground/identification/simulation_error.h"
#include "ground/model/drive_clock.h"
#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"
#include "ground/simulation/experiment.h"

namespace py = pybind11;

namespace ground {
namespace {

py::dict describe(const ParameterInfo& info) {
  py::dict d;
  d["name"] = info.name;
  d["unit"] = info.unit;
  d["doc"] = info.doc;
  d["neutral"] = info.neutral;
  d["lower"] = info.lower;
  d["upper"] = info.upper;
  return d;
}

py::list describe(const std::vector<ParameterInfo>& infos) {
  py::list list;
  for (const ParameterInfo& info : infos) list.append(describe(info));
  return list;
}

/// Rows time, left, right, lift, ascending in time.
InputSequence toInputs(const Eigen::Ref<const Eigen::MatrixXd>& rows) {
  if (rows.cols() != 4) throw std::invalid_argument("inputs need columns time, left, right, lift");
  if (!rows.allFinite()) throw std::invalid_argument("an input is not finite");
  InputSequence inputs;
  for (Eigen::Index i = 0; i < rows.rows(); ++i)
    inputs.add(rows(i, 0), rows(i, 1), rows(i, 2), rows(i, 3));
  return inputs;
}

Eigen::MatrixXd fromInputs(const RunData& run) {
  const InputSequence& inputs = run.inputs;
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(inputs.size()), 4);
  for (std::size_t i = 0; i < inputs.size(); ++i)
    rows.row(static_cast<Eigen::Index>(i)) << inputs.times[i], inputs.thrusters[i](0),
        inputs.thrusters[i](1), inputs.lift[i];
  return rows;
}

RunData makeRun(const std::string& name, const std::vector<double>& times,
                const Eigen::MatrixX3d& eta, const Eigen::MatrixX3d& nu,
                const Eigen::Ref<const Eigen::MatrixXd>& inputs, const Eigen::MatrixX3d& poses,
                const Vector3<double>& noise, const std::vector<double>& drives) {
  RunData run{name, times, eta, nu, toInputs(inputs), poses, noise};
  if (!drives.empty()) run.inputs.drive = DriveClock(drives);
  return run;
}

/// When drives began, by the commands and by rows began, as_of of the records.
std::vector<double> driveStarts(const std::vector<double>& times, const std::vector<double>& lift,
                                const Eigen::Ref<const Eigen::MatrixX2d>& records) {
  if (times.size() != lift.size()) throw std::invalid_argument("times and lift differ in length");
  DriveClock clock;
  for (std::size_t i = 0; i < times.size(); ++i) clock.command(times[i], lift[i]);
  for (Eigen::Index i = 0; i < records.rows(); ++i) clock.record(records(i, 0), records(i, 1));
  return clock.starts();
}

/// The times as an array that shares the run's memory.
py::array timesOf(const py::object& self) {
  const auto& run = self.cast<const RunData&>();
  py::array_t<double> times(static_cast<py::ssize_t>(run.times.size()), run.times.data(), self);
  times.attr("setflags")(py::arg("write") = false);
  return std::move(times);
}

py::dict simulateRun(const Model& model, const Eigen::Ref<const Eigen::MatrixXd>& rows,
                     const std::vector<double>& times, const Vector3<double>& eta,
                     const Vector3<double>& nu, const std::vector<double>& drives,
                     const Eigen::MatrixX3d& wrench) {
  InputSequence inputs = toInputs(rows);
  if (!drives.empty()) inputs.drive = DriveClock(drives);
  if (times.empty()) throw std::invalid_argument("there is no time to simulate at");
  const auto count = static_cast<Eigen::Index>(times.size());
  if (wrench.rows() != 0 && wrench.rows() != count)
    throw std::invalid_argument("the wrench needs a row for each time");
  Eigen::MatrixX3d eta_out(count, 3), nu_out(count, 3);
  {
    const py::gil_scoped_release release;
    const Dynamics<double> dynamics(model);
    Simulation<double> simulation(dynamics, inputs, {eta, nu}, times.front());
    const Matrix3<double> mobility = dynamics.mass().inverse();
    for (Eigen::Index i = 0; i < count; ++i) {
      const double time = times[static_cast<std::size_t>(i)];
      Vector3<double> push = Vector3<double>::Zero();
      if (i > 0 && wrench.rows() > 0)
        push = 0.5 * (time - simulation.time()) * mobility * wrench.row(i - 1).transpose();
      simulation.state().nu += push;  // half of it before the step, half after
      simulation.advance(time);
      simulation.state().nu += push;
      eta_out.row(i) = simulation.measure().eta;
      nu_out.row(i) = simulation.measure().nu;
    }
  }
  py::dict d;
  d["eta"] = eta_out;
  d["nu"] = nu_out;
  return d;
}

/// Rows of a log, each filled by fill(entry, row).
template <typename Entry, typename Fill>
Eigen::MatrixXd toRows(const std::vector<Entry>& entries, int columns, Fill fill) {
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(entries.size()), columns);
  for (Eigen::Index i = 0; i < rows.rows(); ++i)
    rows.row(i) = fill(entries[static_cast<std::size_t>(i)]);
  return rows;
}

py::dict toDict(const ExperimentLog& log) {
  py::dict d;
  d["frames"] = toRows(log.frames, 5, [](const MocapFrame& f) {
    return (Eigen::RowVectorXd(5) << f.captured, f.delivered, f.eta.transpose()).finished();
  });
  d["commands"] = toRows(log.commands, 4, [](const ExperimentLog::Command& c) {
    return Eigen::RowVector4d(c.time, c.left, c.right, c.lift);
  });
  d["truth"] = toRows(log.truth, 13, [](const ExperimentLog::Truth& t) {
    return (Eigen::RowVectorXd(13) << t.time, t.state.eta.transpose(), t.state.nu.transpose(),
            t.nu_dot.transpose(), t.wrench.transpose())
        .finished();
  });
  d["references"] = toRows(log.references, 9, [](const ExperimentLog::Reference& r) {
    return (Eigen::RowVectorXd(9) << r.time, r.point.p.transpose(), r.point.p_dot.transpose(),
            r.point.p_ddot.transpose(), r.point.p_dddot.transpose())
        .finished();
  });
  d["decisions"] = toRows(log.decisions, 4, [](const ExperimentLog::Decision& c) {
    return Eigen::RowVector4d(c.time, c.thrusters.x(), c.thrusters.y(), c.computing);
  });
  d["stopped"] = log.stopped;
  d["stopped_at"] = log.stopped_at;
  return d;
}

ExperimentParams experimentParams(const Vector3<double>& eta, const Vector3<double>& nu,
                                  const MocapParams& mocap, unsigned long seed,
                                  const Disturbance& disturbance) {
  if (!eta.allFinite() || !nu.allFinite())
    throw std::invalid_argument("the initial state is not finite");
  ExperimentParams params{{eta, nu}, mocap, seed};
  params.disturbance = disturbance;
  return params;
}

py::dict toDict(const FitResult& result) {
  py::dict d;
  d["model"] = result.model;
  d["parameters"] = toList(result.parameters);
  d["correlation"] = result.correlation;
  d["condition"] = result.condition;
  d["objective"] = result.objective;
  d["initial"] = result.initial;
  d["width"] = result.width;
  d["starts"] = result.starts;
  d["starts_at_best"] = result.starts_at_best;
  d["iterations"] = result.iterations;
  d["converged"] = result.converged;
  d["message"] = result.message;
  return d;
}

}  // namespace

py::list toList(const std::vector<FittedParameter>& parameters) {
  py::list list;
  for (const FittedParameter& p : parameters) {
    py::dict d;
    d["name"] = p.name;
    d["unit"] = p.unit;
    d["start"] = p.start;
    d["value"] = p.value;
    d["ci95"] = py::make_tuple(p.lower, p.upper);
    d["deviation"] = p.deviation;
    d["at_bound"] = p.at_bound;
    d["identified"] = p.identified;
    list.append(d);
  }
  return list;
}

}  // namespace ground

PYBIND11_MODULE(_core, module) {
  // Evaluations borrow and return the same few megabytes over and over: kept, they cost a tenth of
  // a fit less than fetched from the system each time.
  mallopt(M_MMAP_THRESHOLD, 64 << 20);
  mallopt(M_TRIM_THRESHOLD, 256 << 20);

  using namespace ground;
  module.doc() = "The C++ core: model, smoother, fit by simulation error, experiments.";
  module.attr("version") = GROUND_VERSION;
  module.attr("ceres_version") = CERES_VERSION_STRING;
  module.attr("eigen_version") = std::to_string(EIGEN_WORLD_VERSION) + "." +
                                 std::to_string(EIGEN_MAJOR_VERSION) + "." +
                                 std::to_string(EIGEN_MINOR_VERSION);

  py::class_<Provenance>(module, "Provenance")
      .def(py::init<>())
      .def_readwrite("date", &Provenance::date)
      .def_readwrite("command", &Provenance::command)
      .def_readwrite("bags", &Provenance::bags)
      .def_readwrite("error_before", &Provenance::error_before)
      .def_readwrite("error_after", &Provenance::error_after)
      .def_readwrite("confidence_95", &Provenance::confidence_95)
      .def_readwrite("not_identified", &Provenance::not_identified);

  py::class_<Disturbance>(module, "Disturbance",
                          "A random wrench beside the model: X, Y [N], N [N m], body.")
      .def(py::init<>())
      .def_readwrite("sigma", &Disturbance::sigma,
                     "Stationary standard deviation of an Ornstein-Uhlenbeck process (3,).")
      .def_readwrite("time", &Disturbance::time, "Its correlation time (3,) [s].")
      .def_readwrite("white", &Disturbance::white,
                     "Root of the two-sided spectral density of white noise (3,) [N sqrt(s), ..].")
      .def_readwrite("trim", &Disturbance::trim,
                     "Standard deviation, from run to run, of a constant wrench (3,).")
      .def_readwrite("trim_thrust", &Disturbance::trim_thrust,
                     "Standard deviation, from run to run, of a factor on the thrust.")
      .def("empty", &Disturbance::empty)
      .def("validate", &Disturbance::validate, "What is wrong; empty when nothing is.");
  py::class_<Model>(module, "Model", "A craft: rigid body and effects.")
      .def(py::init<>())
      .def_readwrite("name", &Model::name)
      .def_readwrite("disturbance", &Model::disturbance)
      .def_readwrite("provenance", &Model::provenance)
      .def_property_readonly("input_max", [](const Model& m) { return m.body.input_max; })
      .def_property_readonly("effects",
                             [](const Model& m) {
                               std::vector<std::string> names;
                               for (const auto& e : m.effects)
                                 names.push_back(e.effect->info().name);
                               return names;
                             })
      .def("copy", [](const Model& m) { return Model(m); })
      .def(
          "parameters",
          [](const Model& m) {
            py::list list;
            for (const ParameterInfo& info : m.parameters()) {
              py::dict described = describe(info);
              described["scale"] = info.scale(m.body);
              list.append(described);
            }
            return list;
          },
          "Name, unit, doc, neutral value and bounds of every parameter.")
      .def("value", &Model::value, py::arg("parameter"))
      .def("set_value", &Model::setValue, py::arg("parameter"), py::arg("value"))
      .def("penalty", &Model::penalty, py::arg("parameters"),
           "Prior on the named parameters: W (n, n), by which the log-likelihood loses "
           "(x - x0)' W (x - x0)/2 at coordinates x, x0 the neutral ones.")
      .def(
          "add_effect", [](Model& m, const std::string& name) { m.addEffect(makeEffect(name)); },
          py::arg("name"), "Adds an effect of the library at its neutral values.")
      .def("remove_effect", &Model::removeEffect, py::arg("name"))
      .def("format", &formatModel, "The model file's text.")
      .def(py::pickle([](const Model& m) { return formatModel(m); },
                      [](const std::string& text) { return parseModel(text, "a pickle"); }));

  module.def(
      "load_model", [](const std::string& path) { return loadModel(path); }, py::arg("path"));
  module.def(
      "load_model_with_warnings",
      [](const std::string& path) {
        std::vector<std::string> warnings;
        Model model = loadModel(path, &warnings);
        return std::make_pair(std::move(model), warnings);
      },
      py::arg("path"), "The model, and a line for each value that is hardly meant as it stands.");
  module.def("parse_model", &parseModel, py::arg("text"), py::arg("source"));
  module.def("with_effect", &withEffect, py::arg("model"), py::arg("text"), py::arg("source"),
             "A copy of the model with the effect of this text.");
  module.def("read_effect_file", &readEffectFile, py::arg("path"));
  module.def("save_model", &saveModel, py::arg("model"), py::arg("path"),
             py::arg("overwrite") = false);
  module.def(
      "effects",
      [] {
        py::dict all;
        for (const std::string& name : effectNames()) {
          const EffectPtr effect = makeEffect(name);
          const EffectInfo& info = effect->info();
          py::dict d;
          d["summary"] = info.summary;
          d["parameters"] = describe(info.parameters);
          d["opt_in"] = info.opt_in;
          all[py::str(name)] = d;
        }
        return all;
      },
      "The effects of the library by name. A diagnosis tries those with `opt_in` only when it is "
      "asked to.");
  module.def("simulate", &simulateRun, py::arg("model"), py::arg("inputs"), py::arg("times"),
             py::arg("eta"), py::arg("nu"), py::arg("drives") = std::vector<double>(),
             py::arg("wrench") = Eigen::MatrixX3d(0, 3),
             "Measured pose and velocity at `times` [s] from a true initial state; inputs are rows "
             "of time, left, right, lift; `drives` says when drives began [s], the lift if empty; "
             "`wrench` X, Y [N], N [N m] acts besides, each row until the next time (none if empty).");
  module.def("drive_starts", &driveStarts, py::arg("times"), py::arg("lift"),
             py::arg("records") = Eigen::MatrixX2d(0, 2),
             "When drives began [s], the origins of the model's t: by commands in order of time "
             "and by records (k, 2), began and as of when, in order. Empty without any lift.");

  py::class_<MocapParams>(module, "MocapParams", "Quality of the simulated motion capture.")
      .def(py::init<>())
      .def_readwrite("rate", &MocapParams::rate)
      .def_readwrite("position_noise", &MocapParams::position_noise)
      .def_readwrite("heading_noise", &MocapParams::heading_noise)
      .def_readwrite("latency", &MocapParams::latency)
      .def_readwrite("loss", &MocapParams::loss)
      .def_readwrite("gap_rate", &MocapParams::gap_rate)
      .def_readwrite("gap_length", &MocapParams::gap_length);
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
  py::class_<ObserverParams>(module, "ObserverParams", "Noise that the observer reckons with.")
      .def(py::init<>())
      .def_readwrite("position_noise", &ObserverParams::position_noise)
      .def_readwrite("heading_noise", &ObserverParams::heading_noise)
      .def_readwrite("push", &ObserverParams::push)
      .def_readwrite("twist", &ObserverParams::twist)
      .def_readwrite("push_drift", &ObserverParams::push_drift)
      .def_readwrite("twist_drift", &ObserverParams::twist_drift);
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
  py::class_<TrackingParams>(module, "TrackingParams", "The tracking controller of an experiment.")
      .def(py::init<>())
      .def_readwrite("reference", &TrackingParams::reference)
      .def_readwrite("controller", &TrackingParams::controller)
      .def_readwrite("estimate", &TrackingParams::estimate)
      .def_readwrite("rate", &TrackingParams::rate)
      .def_readwrite("start", &TrackingParams::start)
      .def_readwrite("lift", &TrackingParams::lift)
      .def_readwrite("lift_time", &TrackingParams::lift_time)
      .def_readwrite("duration", &TrackingParams::duration)
      .def_readwrite("max_error", &TrackingParams::max_error)
      .def_readwrite("tail", &TrackingParams::tail);
  module.def(
      "play_schedule",
      [](const Model& model, const Eigen::Ref<const Eigen::MatrixXd>& schedule, double duration,
         const Vector3<double>& eta, const Vector3<double>& nu, const MocapParams& mocap,
         unsigned long seed, const Disturbance& disturbance) {
        const InputSequence inputs = toInputs(schedule);
        const ExperimentParams params = experimentParams(eta, nu, mocap, seed, disturbance);
        ExperimentLog log;
        {
          const py::gil_scoped_release release;
          log = playSchedule(model, inputs, duration, params);
        }
        return toDict(log);
      },
      py::arg("model"), py::arg("schedule"), py::arg("duration"), py::arg("eta"), py::arg("nu"),
      py::arg("mocap"), py::arg("seed"), py::arg("disturbance") = Disturbance(),
      "Craft and mocap under rows of time, left, right, lift (0..1). Gives frames (captured, "
      "delivered, x, y, psi), commands (time, left, right, lift), truth (time, eta, nu, nu_dot, "
      "wrench of the disturbance).");
  module.def(
      "track_reference",
      [](const Model& model, const Model& believed, const TrackingParams& tracking,
         const Vector3<double>& eta, const Vector3<double>& nu, const MocapParams& mocap,
         unsigned long seed, const Disturbance& disturbance) {
        const ExperimentParams params = experimentParams(eta, nu, mocap, seed, disturbance);
        ExperimentLog log;
        {
          const py::gil_scoped_release release;
          log = trackReference(model, believed, tracking, params);
        }
        return toDict(log);
      },
      py::arg("model"), py::arg("believed"), py::arg("tracking"), py::arg("eta"), py::arg("nu"),
      py::arg("mocap"), py::arg("seed"), py::arg("disturbance") = Disturbance(),
      "The same with a controller in the loop; besides, references (time, p, p_dot, p_ddot, "
      "p_dddot), decisions (time, left, right, processor time), why it stopped early, empty when "
      "it did not, and when.");

  module.def("make_prbs", &makePrbs, py::arg("order"), py::arg("seed"),
             "Bits (left, right) of a maximum-length sequence.");
  py::class_<PrbsFile>(module, "PrbsFile", "A binary sequence as a file has it.")
      .def_readonly("rows", &PrbsFile::rows, "Pairs (left, right).")
      .def_readonly("rows_per_bit", &PrbsFile::rows_per_bit)
      .def("describe", &PrbsFile::describe, py::arg("clock"));
  module.def("read_prbs", &readPrbs, py::arg("path"), py::arg("rows_per_bit") = 0);

  py::class_<AxisMapping>(module, "AxisMapping", "Between the mocap's frame and world_ned.")
      .def(py::init<const std::string&, double>(), py::arg("axes") = AxisMapping::kOptiTrack,
           py::arg("heading_offset") = 0.0)
      .def(
          "to_mocap",
          [](const AxisMapping& mapping, const Vector3<double>& eta, double height) {
            Eigen::Vector3d p;
            Eigen::Quaterniond q;
            mapping.toMocap(eta, height, p, q);
            return py::make_tuple(p, Eigen::Vector4d(q.x(), q.y(), q.z(), q.w()));
          },
          py::arg("eta"), py::arg("height"),
          "Position and quaternion x, y, z, w in the mocap's frame.")
      .def(
          "to_planar",
          [](const AxisMapping& mapping, const Eigen::Vector3d& p, const Eigen::Vector4d& xyzw) {
            return mapping.toPlanar(p, Eigen::Quaterniond(xyzw(3), xyzw(0), xyzw(1), xyzw(2)));
          },
          py::arg("position"), py::arg("xyzw"), "x, y [m], psi [rad], or None.");

  py::class_<EstimatorParams>(module, "EstimatorParams")
      .def(py::init<>())
      .def_readwrite("position_noise", &EstimatorParams::position_noise)
      .def_readwrite("heading_noise", &EstimatorParams::heading_noise)
      .def_readwrite("linear_jerk", &EstimatorParams::linear_jerk)
      .def_readwrite("angular_jerk", &EstimatorParams::angular_jerk)
      .def_readwrite("gate", &EstimatorParams::gate)
      .def_readwrite("max_gap", &EstimatorParams::max_gap);
  module.def(
      "smooth",
      [](const std::vector<double>& stamps, const Eigen::MatrixX3d& eta,
         const EstimatorParams& params) {
        const SmoothedMotion motion = smooth(stamps, eta, params);
        py::dict d;
        d["eta"] = motion.eta;
        d["nu"] = motion.nu;
        d["nu_dot"] = motion.nu_dot;
        d["used"] = motion.used;
        d["starts"] = motion.starts;
        return d;
      },
      py::arg("stamps"), py::arg("eta"), py::arg("params"),
      "Velocities without delay from the poses of a whole recording.");

  py::class_<RunData>(module, "RunData", "A recording as the fit sees it.")
      .def(py::init(&makeRun), py::arg("name"), py::arg("times"), py::arg("eta"), py::arg("nu"),
           py::arg("inputs"), py::arg("poses") = RunData().poses,
           py::arg("noise") = RunData().noise, py::arg("drives") = std::vector<double>())
      .def_readonly("name", &RunData::name)
      .def_property_readonly("times", &timesOf, "Read-only view [s].")
      .def_readonly("eta", &RunData::eta)
      .def_readonly("nu", &RunData::nu)
      .def_readonly("poses", &RunData::poses)
      .def_readonly("noise", &RunData::noise)
      .def_property_readonly("inputs", &fromInputs, "Rows time, left, right, lift.")
      .def_property_readonly(
          "drives", [](const RunData& run) { return run.inputs.drive.starts(); },
          "When drives began [s], on the run's clock.")
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
            return py::make_tuple(r.name, r.times, r.eta, r.nu, fromInputs(r), r.poses, r.noise,
                                  r.inputs.drive.starts());
          },
          [](const py::tuple& t) {
            return makeRun(t[0].cast<std::string>(), t[1].cast<std::vector<double>>(),
                           t[2].cast<Eigen::MatrixX3d>(), t[3].cast<Eigen::MatrixX3d>(),
                           t[4].cast<Eigen::MatrixXd>(), t[5].cast<Eigen::MatrixX3d>(),
                           t[6].cast<Vector3<double>>(), t[7].cast<std::vector<double>>());
          }));
  py::class_<Window>(module, "Window")
      .def(py::init([](int run, int first, int last) { return Window{run, first, last}; }),
           py::arg("run"), py::arg("first"), py::arg("last"))
      .def_readonly("run", &Window::run)
      .def_readonly("first", &Window::first)
      .def_readonly("last", &Window::last)
      .def(py::pickle([](const Window& w) { return py::make_tuple(w.run, w.first, w.last); },
                      [](const py::tuple& t) {
                        return Window{t[0].cast<int>(), t[1].cast<int>(), t[2].cast<int>()};
                      }));
  module.def("cut_windows", &cutWindows, py::arg("run"), py::arg("run_index"), py::arg("start"),
             py::arg("end"), py::arg("length"), py::arg("max_gap") = 0.1);

  py::enum_<FitOptions::Objective>(module, "Objective")
      .value("least_squares", FitOptions::Objective::kLeastSquares)
      .value("thesis", FitOptions::Objective::kThesis);
  py::enum_<Target>(module, "Target")
      .value("velocities", Target::kVelocities)
      .value("poses", Target::kPoses);
  py::class_<SimulationError>(module, "SimulationError", "Simulation minus measurement.")
      .def(py::init<std::vector<RunData>, std::vector<Window>, Target>(), py::arg("runs"),
           py::arg("windows"), py::arg("target") = Target::kVelocities)
      .def("sigma", &SimulationError::sigma, py::arg("run"))
      .def(
          "simulate",
          [](const SimulationError& problem, const Model& model, FitOptions::Objective objective) {
            WindowSimulation simulation;
            {
              const py::gil_scoped_release release;
              simulation = problem.simulate(model, objective);
            }
            py::dict d;
            d["objective"] = problem.objective(simulation);
            d["eta"] = simulation.eta;
            d["nu"] = simulation.nu;
            return d;
          },
          py::arg("model"), py::arg("objective") = FitOptions::Objective::kLeastSquares,
          "Every window with the initial velocities that suit the model best by the objective.")
      .def(
          "fit",
          [](const SimulationError& problem, const Model& model,
             const std::vector<std::string>& free, FitOptions::Objective objective, int starts,
             int threads, double width, bool near, const std::vector<Eigen::VectorXd>& initial) {
            FitOptions options;
            options.free = free;
            options.width = width;
            options.near = near;
            options.initial = initial;
            options.starts = starts;
            options.threads = threads;
            options.objective = objective;
            FitResult result;
            {
              const py::gil_scoped_release release;
              result = problem.fit(model, options);
            }
            return toDict(result);
          },
          py::arg("model"), py::arg("free"),
          py::arg("objective") = FitOptions::Objective::kLeastSquares, py::arg("starts") = 1,
          py::arg("threads") = 0, py::arg("width") = 0.0, py::arg("near") = false,
          py::arg("initial") = std::vector<Eigen::VectorXd>());

  module.def(
      "predict",
      [](const Model& model, const RunData& run, const std::vector<Window>& windows,
         const Eigen::MatrixX3d& nu) {
        WindowSimulation simulation;
        {
          const py::gil_scoped_release release;
          simulation = predict(model, run, windows, nu);
        }
        py::dict d;
        d["eta"] = simulation.eta;
        d["nu"] = simulation.nu;
        return d;
      },
      py::arg("model"), py::arg("run"), py::arg("windows"), py::arg("nu"),
      "Windows from the measured pose and the given measured velocity, a row each, uncorrected.");

  py::enum_<WrenchNature>(module, "WrenchNature")
      .value("random_walk", WrenchNature::kRandomWalk)
      .value("white", WrenchNature::kWhite);
  py::class_<WrenchNoise>(module, "WrenchNoise", "Noise levels of the filter.")
      .def(py::init<>())
      .def_readwrite("force", &WrenchNoise::force)
      .def_readwrite("moment", &WrenchNoise::moment)
      .def_readwrite("position", &WrenchNoise::position)
      .def_readwrite("heading", &WrenchNoise::heading);
  py::class_<WrenchFilter>(module, "WrenchFilter", "The wrench that a model lacks along a run.")
      .def(py::init<const Model&, const RunData&, double>(), py::arg("model"), py::arg("run"),
           py::arg("max_gap") = 0.1, py::call_guard<py::gil_scoped_release>())
      .def("likeliest_noise", &WrenchFilter::likeliestNoise, py::arg("nature"),
           py::call_guard<py::gil_scoped_release>())
      .def(
          "innovations",
          [](const WrenchFilter& filter, WrenchNature nature, const WrenchNoise& noise) {
            Innovations innovations;
            {
              const py::gil_scoped_release release;
              innovations = filter.innovations(nature, noise);
            }
            py::dict d;
            d["normalised"] = innovations.normalised;
            d["valid"] = innovations.valid;
            d["log_likelihood"] = innovations.log_likelihood;
            return d;
          },
          py::arg("nature"), py::arg("noise"), "Ahead, to starboard, in heading; one row a sample.")
      .def(
          "smooth",
          [](const WrenchFilter& filter, const WrenchNoise& noise, const Eigen::MatrixXd& acting,
             const std::vector<int>& channels) {
            InferredWrench inferred;
            {
              const py::gil_scoped_release release;
              inferred = filter.smooth(noise, acting, channels);
            }
            py::dict d;
            d["wrench"] = inferred.wrench;
            d["sigma"] = inferred.sigma;
            d["responses"] = inferred.responses;
            return d;
          },
          py::arg("noise"), py::arg("acting") = Eigen::MatrixXd(),
          py::arg("channels") = std::vector<int>(),
          "X, Y [N], N [N m] and standard deviations, one row a sample; responses to acting ones.")
      .def_property_readonly("model_thrust", &WrenchFilter::modelThrust)
      .def_property_readonly("stretches", &WrenchFilter::stretches);
  ground::bindGreyBox(module);
}
