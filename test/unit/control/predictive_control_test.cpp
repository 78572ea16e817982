// The planner and the predictive controller.
#include "ground/control/predictive_control.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "ground/control/reference_pilot.h"
#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"

namespace ground {
namespace predictive_control_test {

Model craft(const std::vector<std::pair<std::string, std::vector<double>>>& effects = {}) {
  Model model = loadModel("cfg/hovercraft/tiny_whoover_4_1.yaml");
  for (const auto& [name, values] : effects) {
    model.addEffect(makeEffect(name));
    model.effects.back().values = values;
  }
  return model;
}

/// A state that is measured at t [s].
Observation seen(double t, const RigidState<double>& state, const ReferenceTrajectory& reference) {
  return {t, t, state, &reference, 0, {1, std::nullopt}, 0, poseMeasurement(state.eta, 3e-4, 5e-3)};
}

/// A craft whose skirt fills slowly and whose wake lags behind: two states of an expression effect.
Model craftWithMemory() {
  return withEffect(craft({{"motor_lag", {0.06}}}), R"yaml(
name: memory
states: {p: "(lift*u_L - p)/0.3", wake: "(u - wake)/0.5"}
expression: {X: "-c*(u - wake)", N: "0.02*c*p"}
parameters: {c: {value: 0.03, unit: N s/m}}
)yaml",
                    "memory");
}

/// Where a controller believes the craft to be when its next inputs act, after a second of full thrust; its
/// model is loaded once more `swapped` seconds before that, if at all.
TrajectoryOptimizer::State believedAfterThrust(const Model& model, std::optional<double> swapped) {
  constexpr double kFrame = 0.01, kEnd = 1;
  double now = 0;
  ReferencePilot pilot([&] { return now; }, [](const ReferencePilot::Decision&) {});
  PredictiveControl* control = nullptr;
  const auto load = [&] {
    auto made = std::make_unique<PredictiveControl>(model, PredictiveParams());
    control = made.get();
    std::unique_ptr<TrackingController> controller = std::move(made);
    pilot.swapController(controller, model);
  };
  load();
  ReferencePtr circle = makeCircle({0, 0}, 1.0, 0.8);
  pilot.swapReference(circle);
  const Inputs full{1, 1, 1};
  const double most = model.body.input_max;
  InputSequence sent;
  sent.add(0, most, most, 1);
  const Dynamics<double> dynamics(model);
  Simulation<double> craft(dynamics, sent, {Vector3<double>::Zero(), Vector3<double>::Zero()}, 0);
  pilot.commanded(0, full);
  pilot.activate(0);
  for (int frame = 0; now < kEnd; ++frame) {
    now = frame * kFrame;
    craft.advance(now);
    if (swapped && std::abs(now - (kEnd - *swapped)) < kFrame / 2) load();
    MeasuredState measured{now, craft.state(), true};
    measured.pose = poseMeasurement(measured.state.eta, 3e-4, 5e-3);
    pilot.objection(measured);
    pilot.update(now, now, craft.state(), 1);
    pilot.commanded(now, full);
  }
  return control->plan().states().front();
}

TEST(AModelLoadedInFlight, KnowsTheCommandsThatHaveNotActedYet) {
  for (const Model& model : {craft({{"input_delay", {0.1}}}), craft({{"motor_lag", {0.2}}}),
                             craft({{"input_delay", {0.06}}, {"motor_lag", {0.1}}})}) {
    const TrajectoryOptimizer::State usual = believedAfterThrust(model, {});
    for (const double swapped : {0.0, 0.03}) {
      const TrajectoryOptimizer::State found = believedAfterThrust(model, swapped);
      // Without them it would be off by the thrust of the delay: 0.1 m/s and more.
      EXPECT_LT((found - usual).segment<3>(3).norm(), 0.02) << model.effects.front().effect->info().name;
      EXPECT_LT((found - usual).head<2>().norm(), 0.002);
    }
  }
}

struct Planned {
  std::string name;
  Model model;
  bool walls = false;  ///< whether walls bar the way
  friend void PrintTo(const Planned& planned, std::ostream* out) { *out << planned.name; }
};

class Plans : public testing::TestWithParam<Planned> {};

/// Walls so near to a circle of 1 m that a craft on it could not be stopped inside.
PlanWalls nearWalls() {
  Room room;
  room.corners = {{-1.3, -1.2}, {1.25, -1.2}, {1.25, 1.2}, {-1.3, 1.2}};
  return {Fence(room, 0.2), 0.15, 30};
}

TEST_P(Plans, AreOptimalWithinTheBounds) {
  // The conditions of Karush, Kuhn and Tucker, by finite differences of the cost.
  const Model& model = GetParam().model;
  TrajectoryOptimizer plan(model, 25, 0.05);
  const ReferencePtr circle = makeCircle({0, 0}, 1.0, 0.8);
  std::vector<ReferencePoint> points;
  for (int k = 1; k <= 25; ++k) points.push_back(circle->at(0.05 * k));
  TrajectoryOptimizer::State start = TrajectoryOptimizer::State::Zero();
  start.head<6>() << 0.97, -0.01, 1.5, 0.75, 0.02, 0.7;
  if (GetParam().walls) plan.setWalls(nearWalls());
  plan.setProblem(0, start, {1, std::nullopt}, {0.05, -0.02, 0.4}, points);
  for (auto& input : plan.newInputs()) asVector(input).setConstant(0.5);
  double cost = plan.rollOut();
  const double first = cost;
  for (int i = 0; i < 400; ++i) {
    plan.improve();
    EXPECT_LE(plan.cost(), cost);
    cost = plan.cost();
  }
  EXPECT_LT(cost, 0.5 * first);
  const std::vector<Thrusters<double>> best = plan.inputs();
  int inside = 0, at_bounds = 0;
  for (std::size_t k = 0; k < best.size(); ++k) {
    for (int side = 0; side < 2; ++side) {
      const double h = 1e-4, input = best[k](side);
      ASSERT_TRUE(input >= 0 && input <= 1);
      const auto at = [&](double value) {
        plan.newInputs() = best;
        plan.newInputs()[k](side) = value;
        return plan.rollOut();
      };
      const double slope = (at(input + h) - at(input - h)) / (2 * h);
      const double tolerance = 2e-5;
      if (input > 1e-6) {
        EXPECT_LT(slope, tolerance) << k << ' ' << side << ' ' << input;
      }
      if (input < 1 - 1e-6) {
        EXPECT_GT(slope, -tolerance) << k << ' ' << side << ' ' << input;
      }
      (input > 1e-6 && input < 1 - 1e-6 ? inside : at_bounds) += 1;
    }
  }
  EXPECT_GT(inside, 2);
  EXPECT_GT(at_bounds, 0);
}

INSTANTIATE_TEST_SUITE_P(
    All, Plans,
    testing::Values(Planned{"nominal", craft()}, Planned{"lag", craft({{"motor_lag", {0.06}}})},
                    Planned{"memory", craftWithMemory()}, Planned{"walls", craft(), true},
                    Planned{"lag_on_a_slope", craft({{"motor_lag", {0.06}},
                                                     {"floor_tilt", {0.02, -0.01}},
                                                     {"quadratic_drag", {0.01, 0.02, 1e-5}}})}),
    [](const auto& test) { return test.param.name; });

using State = TrajectoryOptimizer::State;

constexpr int kSteps = 40;
constexpr double kStep = 0.05;

/// Points of a circle after each step of the horizon from t on.
std::vector<ReferencePoint> ahead(double t, double rate = 0.63) {
  const ReferencePtr circle = makeCircle({0, 0}, 2, rate);
  std::vector<ReferencePoint> points;
  for (int k = 1; k <= kSteps; ++k) points.push_back(circle->at(t + kStep * k));
  return points;
}

/// A state near the start of the circle; `far` scales the deviations.
State near(double far, std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  State state = State::Zero();
  state.head<6>() << 2, 0, M_PI / 2, 1.26, 0, 0.63;
  for (int i = 0; i < 6; ++i) state(i) += far * uniform(random);
  return state;
}

double improved(TrajectoryOptimizer& plan, int iterations) {
  for (int i = 0; i < iterations; ++i) plan.improve();
  return plan.cost();
}

class Continued : public testing::TestWithParam<Planned> {};

TEST_P(Continued, NeverCostMoreThanTheSameInputsAndMostlyMuchLess) {
  const Model& model = GetParam().model;
  std::mt19937 random(1);
  double open_costs = 0, costs = 0;
  for (double shift : {0.0, 0.02, 0.05, 0.13, 1.0, 1.99, 3.0, 1e9}) {
    for (double far : {0.0, 1e-3, 0.01, 0.1, 1.0}) {
      const auto plan = std::make_unique<TrajectoryOptimizer>(model, kSteps, kStep);
      plan->setProblem(0, near(0.02, random), {1, std::nullopt}, {0, 0, 0}, ahead(0));
      plan->rollOut();
      improved(*plan, 20);
      // The planned inputs alone, each the mean of those that were planned for its time.
      const std::vector<Thrusters<double>> planned = plan->inputs();
      const auto same = std::make_unique<TrajectoryOptimizer>(model, kSteps, kStep);
      for (int k = 0; k < kSteps; ++k) {
        const double at = std::min(k + std::min(shift, 1e6) / kStep, kSteps - 1.0);
        const auto from = static_cast<std::size_t>(at);
        const std::size_t to = std::min<std::size_t>(from + 1, kSteps - 1);
        asVector(same->newInputs()[static_cast<std::size_t>(k)]) =
            (1 - (at - std::floor(at))) * asVector(planned[from]) +
            (at - std::floor(at)) * asVector(planned[to]);
      }
      const State start = plan->states()[shift < 1 ? 1 : 0] + far * (near(1, random) - near(0, random));
      for (TrajectoryOptimizer* one : {plan.get(), same.get()})
        one->setProblem(shift, start, {1, std::nullopt}, {0, 0, 0}, ahead(std::min(shift, 10.0)));
      const double open = same->rollOut(), cost = plan->warmStart(shift);
      EXPECT_LE(cost, open * (1 + 1e-9)) << shift << ' ' << far;
      EXPECT_EQ(cost, plan->cost());
      EXPECT_DOUBLE_EQ(cost, plan->rollOut()) << "the cost is not that of the plan";
      if (shift < 1 && far > 0 && far < 0.1) {
        open_costs += open;
        costs += cost;
      }
    }
  }
  EXPECT_LT(costs, 0.5 * open_costs) << "the feedback does nothing";
}

INSTANTIATE_TEST_SUITE_P(Plans, Continued,
                         testing::Values(Planned{"nominal", craft()},
                                         Planned{"lag", craft({{"motor_lag", {0.06}}})},
                                         Planned{"memory", craftWithMemory()}),
                         [](const auto& test) { return test.param.name; });

TEST(TrajectoryOptimizer, ANewSeedCostsWhatItCostsAloneHoweverTheOneBeforeFailed) {
  std::mt19937 random(5);
  const State start = near(0.5, random);
  const auto improvedSeed = [](TrajectoryOptimizer& plan) {
    for (auto& input : plan.newInputs()) input = {0.3, 0.9};
    plan.rollOut();
    return improved(plan, 3);
  };
  const auto alone = std::make_unique<TrajectoryOptimizer>(craft(), kSteps, kStep);
  const auto used = std::make_unique<TrajectoryOptimizer>(craft(), kSteps, kStep);
  for (TrajectoryOptimizer* plan : {alone.get(), used.get()})
    plan->setProblem(0, start, {1, std::nullopt}, {0, 0, 0}, ahead(0));
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (auto& input : used->newInputs()) input = {kNan, kNan};
  used->rollOut();
  for (int i = 0; i < 8; ++i) EXPECT_FALSE(used->improve());
  EXPECT_DOUBLE_EQ(improvedSeed(*used), improvedSeed(*alone));
}

TEST(TrajectoryOptimizer, CarriesOnWhenTheHeadingWasWrapped) {
  std::mt19937 random(1);
  const State begin = near(0.02, random);
  const auto costFrom = [&](double turns) {
    const auto plan = std::make_unique<TrajectoryOptimizer>(craft(), kSteps, kStep);
    plan->setProblem(0, begin, {1, std::nullopt}, {0, 0, 0}, ahead(0));
    plan->rollOut();
    improved(*plan, 20);
    State start = plan->states()[0];
    start(0) += 0.03;
    start(2) += 2 * M_PI * turns;
    plan->setProblem(0, start, {1, std::nullopt}, {0, 0, 0}, ahead(0));
    return plan->warmStart(0);
  };
  EXPECT_NEAR(costFrom(1), costFrom(0), 1e-9 * costFrom(0));
  EXPECT_NEAR(costFrom(-2), costFrom(0), 1e-9 * costFrom(0));
}

/// Closed loop at 50 Hz on the true state; look(t, error, controller) after every decision.
template <typename Look>
void track(const Model& truth, PredictiveControl& control, const ReferenceTrajectory& reference,
           const RigidState<double>& initial, double duration, Look look) {
  const Dynamics<double> dynamics(truth);
  InputSequence inputs;
  Simulation<double> simulation(dynamics, inputs, initial, 0);
  inputs.times.reserve(10000);
  for (int i = 0; i < duration * 50; ++i) {
    const double t = i / 50.0;
    simulation.advance(t);
    const Thrusters<double> chosen = control.decide(seen(t, simulation.state(), reference));
    control.commanded(t, chosen, 1);
    const double most = truth.body.input_max;
    ASSERT_TRUE(truth.thrusters->clipped(chosen, most) == chosen);
    ASSERT_TRUE(truth.thrusters->clipped(control.wanted(), most) == chosen) << t;
    inputs.add(t, chosen, 1);
    look(t, (simulation.state().eta.head<2>() - reference.at(t).p).norm());
  }
}

TEST(PredictiveControl, WorksWithinItsBounds) {
  const Model model = craft({{"motor_lag", {0.05}}, {"floor_tilt", {0.01, 0.01}}});
  PredictiveParams params;
  PredictiveControl control(model, params);
  const ReferencePtr circle = makeCircle({0, 0}, 2, 0.63);
  RigidState<double> start;
  start.eta << -2, 2, 3;  // far away, so that the search for other plans starts
  int searched = 0, beyond_at_first = 0, beyond_at_last = 0;
  track(model, control, *circle, start, 20, [&](double t, double error) {
    EXPECT_LE(control.improvements(), params.iterations + params.search_iterations);
    searched += control.improvements() > params.iterations;
    const Thrusters<double> wanted = control.wanted();
    const bool beyond = asVector(wanted).minCoeff() < 0 || asVector(wanted).maxCoeff() > 1;
    beyond_at_first += beyond && t < 3;
    beyond_at_last += beyond && t > 15;
    if (t > 15) {
      EXPECT_LT(error, 1e-3) << t;
    }
  });
  EXPECT_GT(searched, 20);
  EXPECT_GT(beyond_at_first, 75) << "of 150 decisions far from the circle";
  EXPECT_EQ(beyond_at_last, 0) << "on the circle it does not saturate";
}

TEST(PredictiveControl, AWrongModelLeavesNoLastingError) {
  const Model believed = craft();
  Model truth = believed;
  truth.body.k *= 0.85;
  truth.body.X_u *= 1.3;
  truth.body.Y_v *= 1.3;
  truth.body.N_r *= 1.3;
  truth.body.I_z *= 1.15;
  PredictiveControl control(believed, {});
  const ReferencePtr circle = makeCircle({0, 0}, 2, 0.63);
  track(truth, control, *circle, {}, 30, [&](double t, double error) {
    if (t > 20) {
      EXPECT_LT(error, 1e-3) << t;
    }
  });
}

TEST(PredictiveControl, GivesNoThrustWhileTheStateIsNotFinite) {
  PredictiveControl control(craft(), {});
  const ReferencePtr circle = makeCircle({0, 0}, 2, 0.63);
  RigidState<double> good, bad;
  good.eta << 2, 0, 1.57;
  bad.eta << std::nan(""), 0, 0;
  EXPECT_GT(asVector(control.decide(seen(0.00, good, *circle))).norm(), 0);
  EXPECT_EQ(asVector(control.decide(seen(0.02, bad, *circle))).norm(), 0);
  EXPECT_GT(asVector(control.decide(seen(0.04, good, *circle))).norm(), 0);
}

/// Sum of the squares by which a plan comes too near to nearWalls().
double excessOf(PredictiveControl& control) {
  const ReferencePtr circle = makeCircle({0, 0}, 1.0, 0.8);
  RigidState<double> state;
  state.eta << 1, 0, M_PI / 2;
  state.nu << 0.8, 0, 0.8;
  for (int i = 0; i < 10; ++i) control.decide(seen(0, state, *circle));
  double sum = 0;
  for (const State& at : control.plan().states()) {
    Eigen::Matrix<double, 1, 5> unused;
    sum += std::pow(nearWalls().fence.violation({at.head<3>(), at.segment<3>(3)}, 0.15, unused), 2);
  }
  return sum;
}

TEST(PredictiveControl, AvoidsWallsAtOnceAndAlsoAfterNewParameters) {
  PredictiveParams params;
  params.lost = 10;  // no other plans
  PredictiveControl control(craft(), params), another(craft(), params);
  const double near = excessOf(control);
  EXPECT_GT(near, 0.05);
  control.avoid(nearWalls());
  EXPECT_LT(excessOf(control), 0.3 * near);
  for (const double horizon : {2.0, 2.2}) {  // the same plans, and others
    params.horizon = horizon;
    another.setParams(params);
    const double without = excessOf(another);
    control.setParams(params);
    EXPECT_LT(excessOf(control), 0.3 * without) << horizon;
  }
}

/// Least cost of plans that begin with random inputs.
double leastCost(const Model& model, const RigidState<double>& start, std::mt19937& random) {
  const auto plan = std::make_unique<TrajectoryOptimizer>(model, kSteps, kStep);
  State state = State::Zero();
  state.head<3>() = start.eta;
  state.segment<3>(3) = start.nu;
  plan->setProblem(0, state, {1, std::nullopt}, {0, 0, 0}, ahead(0));
  std::uniform_real_distribution<double> uniform(0, 1);
  double least = std::numeric_limits<double>::infinity();
  for (int trial = 0; trial < 32; ++trial) {
    Thrusters<double> held = {0.0, 0.0};
    for (int k = 0; k < kSteps; ++k) {
      if (k % (kSteps / (1 + trial % 8)) == 0) held = {uniform(random), uniform(random)};
      plan->newInputs()[static_cast<std::size_t>(k)] = held;
    }
    plan->rollOut();
    least = std::min(least, improved(*plan, 60));
  }
  return least;
}

TEST(PredictiveControl, FindsTheBestValleyFromColdStarts) {
  const Model model = craft();
  const ReferencePtr circle = makeCircle({0, 0}, 2, 0.63);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  constexpr int kProblems = 60;
  int found = 0;
  for (int problem = 0; problem < kProblems; ++problem) {
    RigidState<double> start;
    start.eta << 2 + 2.5 * uniform(random), 2.5 * uniform(random), M_PI * uniform(random);
    start.nu << 0.5 * uniform(random), 0.3 * uniform(random), 2 * uniform(random);
    PredictiveControl control(model, {});
    double cost = std::numeric_limits<double>::infinity();
    for (int decision = 0; decision < 20; ++decision) {
      control.decide(seen(0, start, *circle));
      EXPECT_LE(control.plan().cost(), cost * (1 + 1e-9)) << "the same problem again";
      cost = control.plan().cost();
    }
    found += cost < 1.01 * leastCost(model, start, random);
  }
  EXPECT_GE(found, 0.95 * kProblems);
}

/// A clock on which each reading takes a while.
struct SlowClock {
  double now = 0, reading = 1e-3;  ///< [s]
  double operator()() { return now += reading; }
};

/// Decides far from a circle, twice, with `deadline` [s]; 0: without a clock. Returns the costs.
std::array<double, 2> costsBy(double deadline) {
  SlowClock clock;
  PredictiveParams params;
  if (deadline > 0) params.deadline = deadline;
  PredictiveControl control(craft(), params);
  if (deadline > 0) control.setClock(std::ref(clock));
  const ReferencePtr circle = makeCircle({0, 0}, 2, 0.63);
  std::array<double, 2> costs{};
  for (std::size_t i = 0; i < costs.size(); ++i) {
    RigidState<double> state;
    state.eta << -2, 2 + 0.1 * static_cast<double>(i), 3;
    const double t = 0.02 * static_cast<double>(i);
    const double began = clock.now + clock.reading;
    const Thrusters<double> chosen = control.decide(seen(t, state, *circle));
    EXPECT_TRUE(asVector(chosen).allFinite());
    if (deadline > 0) {
      EXPECT_LE(clock.now - began, deadline * (1 + 1e-9) + 1e-12) << deadline;
    }
    costs[i] = control.plan().cost();
  }
  return costs;
}

TEST(PredictiveControl, KeepsItsDeadlineWithTheBestPlanSoFar) {
  const double unlimited = costsBy(0)[0];
  double before = std::numeric_limits<double>::infinity();
  int better = 0;
  for (int pieces = 1; pieces < 600; pieces += 1 + pieces / 20) {
    const std::array<double, 2> costs = costsBy(1e-3 * pieces);
    EXPECT_LE(costs[0], before) << "more time makes a worse plan";
    EXPECT_TRUE(std::isfinite(costs[1]));
    better += costs[0] < before;
    before = costs[0];
  }
  EXPECT_GT(better, 5);
  EXPECT_EQ(before, unlimited) << "with much time, the deadline changes something";
}

}  // namespace predictive_control_test
}  // namespace ground
