// Everything that asks the model what the craft does hears of every condition on which that may depend.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "ground/control/controllers.h"
#include "ground/control/excitation_pilot.h"
#include "ground/control/reference_pilot.h"
#include "ground/estimation/model_monitor.h"
#include "ground/identification/identification.h"
#include "ground/model/model_file.h"
#include "ground/safety/fence_bound.h"
#include "ground/safety/obedience_monitor.h"
#include "ground/simulation/model_craft.h"

namespace ground {
namespace conditions_test {

constexpr double kNominal = 7.4;  // voltage at which k holds [V]
constexpr double kEnd = 3;        // of the motion [s]
constexpr double kFrame = 0.02;   // between poses [s]

/// What acts on the craft from the start of a motion on.
struct Setting {
  double lift = 0.8;
  std::optional<double> volts = 7.0;
  double t = 3;        ///< since the drive began, at the start [s]
  double angle = 0.2;  ///< input of the rudder

  Conditions<double> given() const { return {lift, volts}; }
  Thrusters<double> thrusters() const { return {0.5, angle}; }
  Inputs inputs() const { return {thrusters(), lift}; }
  /// On a clock that is 0 at the start of the motion.
  DriveClock drive() const {
    DriveClock drive;
    drive.record(-t, 0);
    return drive;
  }
  InputSequence sequence() const {
    InputSequence inputs;
    inputs.drive = drive();
    inputs.add(0, thrusters(), lift);
    if (volts) inputs.battery.add(0, *volts);
    return inputs;
  }
};

/// All conditions. It does not compile when the model may depend on another one: add it here, and a probe.
std::vector<double> conditionsIn(const Setting& setting) {
  const auto& [lift, volts] = setting.given();
  return {lift, volts.value_or(0), setting.t, setting.angle};
}
[[maybe_unused]] bool pointHasNoMore(const Point<double>& point) {
  const auto& [t, eta, nu, heading, nu_air, input, thrust, layout, lift, volts, body, mass, states] = point;
  return &t != &lift;
}

/// A craft whose thrust is six times as strong where a condition is another one.
struct Probe {
  std::string condition;
  std::string factor;  ///< 0 at the usual setting, 1 at the other one; empty: it needs no effect
  Setting other;

  Model model() const {
    const std::string head =
        "schema: ground/model/1\nname: probe\nbody:\n  m: 1.2\n  I_z: 0.02\n  X_u: 0.2\n"
        "  Y_v: 0.3\n  N_r: 0.01\n  k: 2\n  volts: 7.4\n  thrusters:\n"
        "    - {name: fan, position: [-0.2, 0], direction: 0}\n"
        "    - {name: rudder, position: [-0.25, 0], angle: 30, foil: {stream: fan, force: "
        "0.02, jet: 40, own_speed: 0, own_sway: 0}}\neffects: []\n";
    const Model plain = parseModel(head, "probe.yaml");
    if (factor.empty()) return plain;
    return withEffect(plain,
                      "name: probe\nexpression: {thrust_fan: \"c*u_fan*(" + factor +
                          ")\"}\nparameters: {c: {value: 10, unit: N}}\n",
                      "probe");
  }
};

Setting usual() { return {}; }
Setting with(const std::function<void(Setting&)>& change) {
  Setting setting = usual();
  change(setting);
  return setting;
}

const std::vector<Probe>& probes() {
  static const std::vector<Probe> all = {
      {"lift", "(lift - 0.8)/0.2", with([](Setting& s) { s.lift = 1; })},
      {"voltage", "(volt - 7)/1.2", with([](Setting& s) { s.volts = 8.2; })},
      {"time", "0.5 + 0.5*tanh(t - 20)", with([](Setting& s) { s.t = 60; })},
      {"angle", "", with([](Setting& s) { s.angle = 0.8; })},
  };
  return all;
}

/// The motion of a craft at the usual setting, from rest.
struct Flown {
  std::vector<double> times;
  std::vector<RigidState<double>> states;

  explicit Flown(const Model& model) {
    const InputSequence inputs = usual().sequence();
    const Dynamics<double> dynamics(model);
    Simulation<double> simulation(dynamics, inputs, RigidState<double>(), 0);
    for (int i = 0; i * kFrame <= kEnd; ++i) {
      simulation.advance(i * kFrame);
      times.push_back(i * kFrame);
      states.push_back(simulation.state());
    }
  }
  /// As it is recorded, with the conditions that were told.
  RunData recorded(const Setting& told) const {
    RunData run;
    run.name = "flown";
    run.times = times;
    run.inputs = told.sequence();
    run.eta.resize(static_cast<Eigen::Index>(times.size()), 3);
    run.nu = run.eta;
    for (std::size_t i = 0; i < times.size(); ++i) {
      run.eta.row(static_cast<Eigen::Index>(i)) = states[i].eta;
      run.nu.row(static_cast<Eigen::Index>(i)) = states[i].nu;
    }
    return run;
  }
  PoseMeasurement pose(std::size_t i) const { return poseMeasurement(states[i].eta, 1e-3, 1e-2); }
};

using Answer = std::vector<double>;
Answer numbers(const Eigen::MatrixXd& all) { return {all.data(), all.data() + all.size()}; }
Answer numbers(const RigidState<double>& state) {
  return {state.eta(0), state.eta(1), state.eta(2), state.nu(0), state.nu(1), state.nu(2)};
}

// What each consumer answers about a flown motion when it is told a setting.

template <class SomePilot>
void tell(SomePilot& pilot, const Setting& told) {
  if (told.volts) pilot.voltage(*told.volts);
  pilot.driveBegan(-told.t, 0);
}

Answer fence(const Model& model, const Setting& told) {
  ReferencePilot pilot([] { return 0.0; }, nullptr);
  pilot.setCraft(model);
  tell(pilot, told);
  return numbers(pilot.acceleration(0, told.inputs()));
}

Answer fenceOfExcitation(const Model& model, const Setting& told) {
  ExcitationPilot pilot([] { return 0.0; }, nullptr, nullptr);
  pilot.play({}, 1, &model);
  tell(pilot, told);
  return numbers(pilot.acceleration(0, told.inputs()));
}

Answer bound(const Model& model, const Setting& told) {
  ReferencePilot pilot([] { return 0.0; }, nullptr);
  pilot.setCraft(model);
  tell(pilot, told);
  return {fullAcceleration(pilot, 0)};
}

Answer obedience(const Model& model, const Setting& told) {
  const Flown flown(model);
  ObedienceMonitor monitor(model);
  if (told.volts) monitor.voltage(*told.volts);
  monitor.setDrive(told.drive());
  for (std::size_t i = 0; i < flown.times.size(); ++i) {
    monitor.command(flown.times[i], told.thrusters(), told.lift);
    monitor.measure(flown.times[i], flown.states[i], Vector3<double>::Constant(1e-6));
  }
  return {monitor.disobedience(1).empty() ? 0.0 : 1.0};
}

Answer monitor(const Model& model, const Setting& told) {
  const Flown flown(model);
  ModelMonitor monitor(model, {});
  monitor.setDrive(told.drive());
  if (told.volts) monitor.voltage(0, *told.volts);
  std::optional<ModelMonitor::Error> error;
  for (std::size_t i = 0; i < flown.times.size(); ++i) {
    monitor.command(flown.times[i], told.thrusters(), told.lift);
    error = monitor.measure(flown.times[i], flown.states[i], flown.pose(i));
  }
  Answer all = numbers(error->wrench);
  const Answer predicted = numbers(error->predicted.eta);
  all.insert(all.end(), predicted.begin(), predicted.end());
  return all;
}

Answer observer(const Model& model, const Setting& told) {
  const Flown flown(model);
  DisturbanceObserver observer(model, {});
  observer.command(0, told.thrusters(), told.lift);
  observer.voltage(told.volts);
  observer.countFrom(-told.t);
  for (std::size_t i = 0; i < 20; ++i) observer.measure(flown.times[i], flown.states[i], flown.pose(i));
  return numbers(observer.at(flown.times[19] + 0.2).state);
}

Answer plan(const Model& model, const Setting& told) {
  TrajectoryOptimizer plan(model, 20, 0.05);
  plan.setProblem(told.t, TrajectoryOptimizer::State::Zero(), told.given(), Vector3<double>::Zero(),
                  std::vector<ReferencePoint>(20));
  for (Thrusters<double>& inputs : plan.newInputs()) inputs = told.thrusters();
  plan.rollOut();
  return numbers(plan.states().back());
}

Answer predictiveControl(const Model& model, const Setting& told) {
  const Flown flown(model);
  double now = 0;
  ReferencePilot pilot([&] { return now; }, [](const ReferencePilot::Decision&) {});
  auto made = std::make_unique<PredictiveControl>(model, PredictiveParams());
  const PredictiveControl& control = *made;
  std::unique_ptr<TrackingController> controller = std::move(made);
  pilot.swapController(controller, model);
  ReferencePtr circle = makeCircle({0, 0}, 1.0, 0.8);
  pilot.swapReference(circle);
  tell(pilot, told);
  pilot.commanded(0, told.inputs());
  pilot.activate(0);
  for (std::size_t i = 0; i < 20; ++i) {
    now = flown.times[i];
    MeasuredState measured{now, flown.states[i], true};
    measured.pose = flown.pose(i);
    pilot.objection(measured);
    pilot.update(now, now, flown.states[i], told.lift);
  }
  return numbers(control.plan().states().back());
}

Answer simulator(const Model& model, const Setting& told) {
  constexpr double kEmpty = 3.3 / 3.7, kFull = 4.2 / 3.7;  // of the nominal voltage
  ModelCraft::Params params;
  params.battery = {1e6, (told.volts.value_or(kNominal) / kNominal - kEmpty) / (kFull - kEmpty)};
  ModelCraft craft(model, params);
  craft.command({0.0, 0.0}, told.lift);
  craft.advance(told.t);
  craft.command(told.thrusters(), told.lift);
  craft.advance(told.t + 1);
  return numbers(craft.state());
}

Answer simulation(const Model& model, const Setting& told) {
  const InputSequence inputs = told.sequence();
  const Dynamics<double> dynamics(model);
  Simulation<double> simulation(dynamics, inputs, RigidState<double>(), 0);
  simulation.advance(1);
  return numbers(simulation.state());
}

Answer prediction(const Model& model, const Setting& told) {
  const RunData run = Flown(model).recorded(told);
  return numbers(predict(model, run, {{0, 0, 50}}, Eigen::MatrixX3d::Zero(1, 3)).nu[0]);
}

Answer simulationError(const Model& model, const Setting& told) {
  const RunData run = Flown(model).recorded(told);
  return numbers(SimulationError({run}, {{0, 0, 50}}).simulate(model).nu[0]);
}

GreyBox box(const Model& model, const Setting& told) {
  return GreyBox({Flown(model).recorded(told)}, model.body);
}
Answer likelihood(const Model& model, const Setting& told) {
  const GreyBox runs = box(model, told);
  return numbers(runs.likelihood(runs.start(model), 25, 1e9, 1)[0]);
}
Answer scores(const Model& model, const Setting& told) {
  const GreyBox runs = box(model, told);
  return numbers(runs.scores(runs.start(model), {"k"}, 25, 1e9, 1).score);
}
Answer missingWrench(const Model& model, const Setting& told) {
  const GreyBox runs = box(model, told);
  return numbers(runs.smooth(runs.start(model), 0, 25).wrench);
}
Answer forecast(const Model& model, const Setting& told) {
  const GreyBox runs = box(model, told);
  ForecastOptions options;
  options.starts = {50};
  options.horizons = {1};
  return numbers(runs.forecast(runs.start(model), 0, options)[0].mean);
}

/// The equations as an export writes them down.
Answer equations(const Model& model, const Setting& told) {
  Trace trace;
  const Dynamics<Symbol> dynamics(model);
  const Symbol lift = trace.parameter("lift", told.lift), t = trace.parameter("t", told.t);
  std::optional<Symbol> volts;
  if (told.volts) volts = trace.parameter("volts", *told.volts);
  const Thrusters<Symbol> inputs{trace.parameter("fan", told.thrusters()(0)),
                                 trace.parameter("rudder", told.angle)};
  const RigidState<Symbol> dot = dynamics.derivative(t, RigidState<Symbol>(), inputs, {lift, volts});
  return {valueOf(dot.nu(0)), valueOf(dot.nu(1)), valueOf(dot.nu(2))};
}

struct Consumer {
  std::string name;
  Answer (*answer)(const Model&, const Setting& told);
  /// Conditions that it does not ask for, because it considers all of them.
  std::vector<std::string> whatever = {};
  bool measures = false;  ///< it is told no voltage: it has a battery
};

const Consumer kConsumers[] = {
    {"fence", fence},
    {"fence of an excitation", fenceOfExcitation},
    {"bound of the fence", bound, {"lift", "angle"}},  // at full lift, the largest of all inputs
    {"obedience", obedience},
    {"model monitor", monitor},
    {"observer", observer},
    {"plan", plan},
    {"predictive control", predictiveControl},
    {"simulator", simulator, {}, true},
    {"simulation", simulation},
    {"prediction of windows", prediction},
    {"simulation error", simulationError},
    {"likelihood", likelihood},
    {"score test", scores},
    {"missing wrench", missingWrench},
    {"forecast", forecast},
    {"equations", equations},
};

double difference(const Answer& one, const Answer& other) {
  double most = one.size() == other.size() ? 0 : 1e9;
  for (std::size_t i = 0; i < std::min(one.size(), other.size()); ++i)
    most = std::max(most, std::abs(one[i] - other[i]));
  return most;
}

TEST(Conditions, EachHasAProbeOfItsOwn) {
  const std::vector<double> before = conditionsIn(usual());
  std::vector<int> changed(before.size(), 0);
  for (const Probe& probe : probes()) {
    const std::vector<double> after = conditionsIn(probe.other);
    int changes = 0;
    for (std::size_t i = 0; i < before.size(); ++i) {
      if (after[i] == before[i]) continue;
      ++changes;
      ++changed[i];
    }
    EXPECT_EQ(changes, 1) << probe.condition;
  }
  EXPECT_EQ(changed, std::vector<int>(before.size(), 1));
}

TEST(Conditions, ReachEveryConsumer) {
  for (const Probe& probe : probes()) {
    const Model model = probe.model();
    for (const Consumer& consumer : kConsumers) {
      const auto& all = consumer.whatever;
      if (std::find(all.begin(), all.end(), probe.condition) != all.end()) continue;
      EXPECT_GT(difference(consumer.answer(model, usual()), consumer.answer(model, probe.other)), 1e-3)
          << consumer.name << " does not respond to " << probe.condition;
    }
  }
}

TEST(Conditions, ChangeNothingWithoutAnEffect) {
  const Model plain = Probe().model();
  for (const Probe& probe : probes()) {
    if (probe.factor.empty()) continue;
    for (const Consumer& consumer : kConsumers)
      EXPECT_LT(difference(consumer.answer(plain, usual()), consumer.answer(plain, probe.other)), 1e-9)
          << consumer.name << " responds to " << probe.condition;
  }
}

TEST(Conditions, WithoutAVoltageKHolds) {
  const Model model = probes()[1].model();
  const Setting unknown = with([](Setting& s) { s.volts = std::nullopt; });
  const Setting nominal = with([](Setting& s) { s.volts = kNominal; });
  for (const Consumer& consumer : kConsumers) {
    if (consumer.measures) continue;
    EXPECT_LT(difference(consumer.answer(model, unknown), consumer.answer(model, nominal)), 1e-9)
        << consumer.name;
  }
}

TEST(Conditions, AControllerWithoutEffectsSaysThatItIgnoresThem) {
  for (const Probe& probe : probes()) {
    if (probe.factor.empty()) continue;
    EXPECT_EQ(effectUse("TrajectoryTracking", probe.model()).unused, std::vector<std::string>{"probe"});
  }
}

}  // namespace conditions_test
}  // namespace ground
