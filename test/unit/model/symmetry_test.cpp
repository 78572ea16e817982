// Nature prefers no side: what is computed for a turned or a mirrored world is turned or mirrored.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "../artificial_run.h"
#include "../crafts.h"
#include "ground/control/predictive_control.h"
#include "ground/control/tracking_law.h"
#include "ground/identification/grey_box.h"

namespace ground {
namespace symmetry_test {

Model craft() { return loadModel("cfg/hovercraft/tiny_whoover_4_1.yaml"); }

/// A change of the world: mirrored at the x axis or not, then turned [rad] and moved [m].
struct World {
  bool mirrored = false;
  double turn = 0;
  Vector2<double> shift = Vector2<double>::Zero();

  Vector2<double> direction(Vector2<double> along) const {
    if (mirrored) along.y() *= -1;
    return bodyToWorld<double>(turn, along);
  }
  Vector2<double> position(const Vector2<double>& at) const { return shift + direction(at); }
  double side() const { return mirrored ? -1 : 1; }
  RigidState<double> state(const RigidState<double>& seen) const {
    RigidState<double> found;
    found.eta << position(seen.eta.head<2>()), wrapAngle(side() * seen.eta.z() + turn);
    found.nu << seen.nu.x(), side() * seen.nu.tail<2>();
    return found;
  }
  ReferencePoint reference(const ReferencePoint& at) const {
    return {position(at.p), direction(at.p_dot), direction(at.p_ddot), direction(at.p_dddot)};
  }
  Thrusters<double> inputs(const Thrusters<double>& pair) const {
    return mirrored ? Thrusters<double>{pair(1), pair(0)} : pair;
  }
};

const std::vector<World> kTurned = {{false, 0.7, {1, -2}}, {false, -2.9, {0, 0}}};
const std::vector<World> kMirrored = {{true, 0, {0, 0}}, {true, 1.9, {-3, 1}}};

std::vector<World> worlds() {
  std::vector<World> all = kTurned;
  all.insert(all.end(), kMirrored.begin(), kMirrored.end());
  return all;
}

RigidState<double> randomState(std::mt19937& random, double far) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  RigidState<double> state;
  state.eta << far * uniform(random), far * uniform(random), M_PI * uniform(random);
  state.nu << 0.5 * uniform(random), 0.3 * uniform(random), 2 * uniform(random);
  return state;
}

TEST(Symmetry, AnglesAreWrappedToHalfATurnOnBothSides) {
  EXPECT_EQ(wrapAngle(M_PI), M_PI);
  EXPECT_EQ(wrapAngle(-M_PI), M_PI);
  for (double angle = -3; angle < 3.1; angle += 0.1)
    for (int turns = -3; turns <= 3; ++turns)
      EXPECT_NEAR(wrapAngle(angle + 2 * M_PI * turns), angle, 1e-14) << turns;
}

TEST(Symmetry, TheTrackingLawIsTheSameInEveryWorld) {
  const BacksteppingControl law(craft(), {});
  const ReferencePtr rose = makeRhodonea({0, 0}, 1.5, 1.5, 0.4);
  std::mt19937 random(1);
  for (int trial = 0; trial < 50; ++trial) {
    const RigidState<double> seen = randomState(random, 1);
    const ReferencePoint at = rose->at(0.3 * trial);
    const auto here = law.run(seen, at);
    for (const World& world : worlds()) {
      const auto there = law.run(world.state(seen), world.reference(at));
      const double side = world.side();
      EXPECT_NEAR(there.force, here.force, 1e-9 * (1 + std::abs(here.force)));
      EXPECT_NEAR(there.torque, side * here.torque, 1e-9 * (1 + std::abs(here.torque)));
      EXPECT_NEAR(there.error.y(), side * here.error.y(), 1e-12);
      const Thrusters<double> wanted = world.inputs(here.inputs);
      for (int i : {0, 1}) EXPECT_NEAR(there.inputs(i), wanted(i), 1e-9);
    }
  }
}

TEST(Symmetry, PredictiveControlPlansTheSameInATurnedWorld) {
  std::mt19937 random(3);
  for (int problem = 0; problem < 12; ++problem) {
    const RigidState<double> start = randomState(random, 2.5);
    const auto decided = [&](const World& world) {
      const ReferencePtr line = makeLine(world.position({0, 0}), world.position({1.5, 0.4}), 0.5, true);
      PredictiveParams params;
      params.search_iterations = 4;
      PredictiveControl control(craft(), params);
      const RigidState<double> seen = world.state(start);
      Thrusters<double> inputs;
      for (int decision = 0; decision < 8; ++decision)
        inputs = control.decide(
            {0, 0, seen, line.get(), 0, {1, std::nullopt}, 0, poseMeasurement(seen.eta, 3e-4, 5e-3)});
      return std::make_pair(control.plan().cost(), inputs);
    };
    const auto [cost, inputs] = decided({});
    for (const World& world : kTurned) {
      const auto [other_cost, other_inputs] = decided(world);
      EXPECT_NEAR(other_cost, cost, 1e-6 * cost) << problem << ' ' << world.turn;
      for (int i : {0, 1}) EXPECT_NEAR(other_inputs(i), inputs(i), 1e-5) << problem;
    }
  }
}

/// A craft whose sides differ.
Model lopsided() {
  return withValues(craft(),
                    {{"thrust_asymmetry.a", 0.08}, {"yaw_bias.n0", 5e-5}, {"body_force_bias.y0", -0.003}});
}

/// Parameters that a mirror turns round.
bool isOdd(const std::string& name) {
  return name == "thrust_asymmetry.a" || name == "yaw_bias.n0" || name == "body_force_bias.y0";
}

RunData seenIn(const World& world, const RunData& run) {
  RunData changed = run;
  changed.inputs = InputSequence();
  for (std::size_t i = 0; i < run.inputs.times.size(); ++i)
    changed.inputs.add(run.inputs.times[i], world.inputs(run.inputs.thrusters[i]), run.inputs.lift[i]);
  for (Eigen::Index i = 0; i < run.eta.rows(); ++i) {
    const RigidState<double> seen = world.state({run.eta.row(i), run.nu.row(i)});
    changed.eta.row(i) = seen.eta;
    changed.nu.row(i) = seen.nu;
    changed.eta(i, 2) = world.side() * run.eta(i, 2) + world.turn;  // not wrapped
  }
  return changed;
}

void compare(const std::vector<FittedParameter>& here, const std::vector<FittedParameter>& there,
             bool mirrored, double tolerance) {
  ASSERT_EQ(here.size(), there.size());
  for (std::size_t i = 0; i < here.size(); ++i) {
    const FittedParameter &a = here[i], &b = there[i];
    const bool turned = mirrored && isOdd(a.name);
    const double side = turned ? -1 : 1, near = tolerance * a.deviation;
    EXPECT_NEAR(b.value, side * a.value, near) << a.name;
    EXPECT_NEAR(b.lower, side * (turned ? a.upper : a.lower), 2 * near) << a.name;
    EXPECT_NEAR(b.upper, side * (turned ? a.lower : a.upper), 2 * near) << a.name;
    EXPECT_EQ(b.identified, a.identified) << a.name;
  }
}

TEST(Symmetry, FitsOfAMirroredRunGiveMirroredParameters) {
  Model guess = lopsided();
  for (const char* name : {"thrust_asymmetry.a", "yaw_bias.n0", "body_force_bias.y0"})
    guess.setValue(name, 0);
  RunData run = record(lopsided(), 6, 0.05, 1);
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  for (Eigen::Index i = 0; i < run.eta.rows(); ++i)
    for (int c = 0; c < 3; ++c) run.eta(i, c) += run.noise(c) * normal(random);
  const std::vector<std::string> free = {
      "I_z", "N_r", "k", "thrust_asymmetry.a", "yaw_bias.n0", "body_force_bias.y0"};
  for (Target target : {Target::kVelocities, Target::kPoses}) {
    const auto fitted = [&](const RunData& data) {
      FitOptions how;
      how.free = free;
      return SimulationError({data}, cutWindows(data, 0, 0, 1e9, 2), target).fit(guess, how);
    };
    // Robust losses of poses are flat about their minimum, where searches end a little apart.
    const double near = target == Target::kPoses ? 0.2 : 0.01;
    const FitResult here = fitted(run);
    EXPECT_NEAR(here.model.value("thrust_asymmetry.a"), 0.08, 0.02);
    for (const World& world : worlds())
      compare(here.parameters, fitted(seenIn(world, run)).parameters, world.mirrored, near);
  }
}

TEST(Symmetry, TheLikelihoodOfAMirroredRunIsThatOfTheMirroredCraft) {
  const RunData run = record(lopsided(), 3, 0, 1);
  Model mirrored = lopsided();
  for (const char* name : {"thrust_asymmetry.a", "yaw_bias.n0", "body_force_bias.y0"})
    mirrored.setValue(name, -mirrored.value(name));
  const auto likelihood = [](const Model& model, const RunData& data) {
    const GreyBox box({data}, model.body);
    return box.likelihood(box.start(model), 25, 1, 1).at(0);
  };
  const Eigen::VectorXd here = likelihood(lopsided(), run);
  for (const World& world : worlds()) {
    const Eigen::VectorXd there = likelihood(world.mirrored ? mirrored : lopsided(), seenIn(world, run));
    ASSERT_EQ(there.size(), here.size());
    EXPECT_LT((there - here).norm(), 1e-6 * here.norm()) << world.turn;
  }
}

}  // namespace symmetry_test
}  // namespace ground
