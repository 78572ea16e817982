// RK4, exact steps and derivatives of the model.
#include <gtest/gtest.h>

#include <cmath>

#include "../crafts.h"
#include "ground/model/simulation.h"

namespace ground {
namespace integration_test {

/// The thesis's step-size study: input (2.6), evaluated at the stages, from rest.
RigidState<double> stepSizeStudy(double h, double duration) {
  const Model model = tinyWhoover();
  const Dynamics<double> dynamics(model);
  const auto input = [](double t) { return Vector2<double>(std::sin(2 * t), std::sin(2 * t + 2)); };
  RigidState<double> state;
  const int steps = static_cast<int>(std::lround(duration / h));
  for (int i = 0; i < steps; ++i) {
    const double t = i * h;
    double now = t;
    dynamics.step(now, state, {{input(t), input(t + h / 2), input(t + h)}, {1.0, std::nullopt}}, h);
  }
  return state;
}

double distance(const RigidState<double>& a, const RigidState<double>& b) {
  return (a.eta - b.eta).head<2>().norm();
}

TEST(RungeKutta, HasOrderFour) {
  const RigidState<double> limit = stepSizeStudy(0.00015625, 10);
  double error = distance(stepSizeStudy(0.01, 10), limit);
  for (double h = 0.005; h > 0.001; h /= 2) {
    const double next = distance(stepSizeStudy(h, 10), limit);
    EXPECT_GT(error / next, 15.0) << "h = " << h;
    EXPECT_LT(error / next, 17.0) << "h = " << h;
    error = next;
  }
}

TEST(RungeKutta, ReproducesTheThesisStepSizeStudy) {
  const RigidState<double> limit = stepSizeStudy(0.00015625, 10);
  EXPECT_LT(distance(stepSizeStudy(0.005, 10), limit), 1e-4);
  EXPECT_NEAR(distance(stepSizeStudy(0.01, 10), limit), 1.2e-3, 1e-4);
  EXPECT_GT(distance(stepSizeStudy(0.1, 10), limit), 1.0);
}

TEST(RungeKutta, KeepsKineticEnergy) {
  const Model model = undamped();
  const Dynamics<double> dynamics(model);
  const auto energy = [&model](const RigidState<double>& s) {
    const Body<double>& b = model.body;
    return 0.5 * (b.m * s.nu.head<2>().squaredNorm() + b.I_z * s.nu.z() * s.nu.z());
  };
  RigidState<double> start;
  start.nu << 1.0, -0.5, 10.0;
  const InputSequence none;
  Simulation<double> simulation(dynamics, none, start, 0.0);
  simulation.advance(10.0);
  EXPECT_LT(std::abs(energy(simulation.state()) / energy(start) - 1), 1e-6);
}

TEST(Simulation, SettlesAtTheSpeedWhereThrustEqualsDamping) {
  const Model model = tinyWhoover();
  const Dynamics<double> dynamics(model);
  InputSequence inputs;
  inputs.add(0, 0.5, 0.5, 1);
  Simulation<double> simulation(dynamics, inputs, {}, 0.0);
  simulation.advance(200.0);
  EXPECT_NEAR(simulation.state().nu.x(), model.body.k / model.body.X_u, 1e-6);
}

TEST(Simulation, EndsStepsAtRequestedTimesAndAtChangesOfTheCommand) {
  // The command changes between grid points; without damping the speed is impulse / mass.
  const Model model = undamped();
  const Dynamics<double> dynamics(model);
  InputSequence inputs;
  inputs.add(0.0123, 1, 1, 1);
  inputs.add(0.0456789, 0, 0, 1);
  Simulation<double> simulation(dynamics, inputs, {}, 0.0);
  simulation.advance(0.0333);
  EXPECT_NEAR(simulation.state().nu.x(), 2 * model.body.k / model.body.m * (0.0333 - 0.0123), 1e-14);
  simulation.advance(1.0);
  EXPECT_NEAR(simulation.state().nu.x(), 2 * model.body.k / model.body.m * (0.0456789 - 0.0123), 1e-14);
}

TEST(MotorLag, GivesTheExactImpulseForAnyTimeConstant) {
  // Without damping the impulse after switching on is k (T - tau (1 - exp(-T/tau))).
  for (double tau : {0.0, 1e-6, 1e-4, 1e-3, 0.005, 0.05, 0.5}) {
    const Model model = withValues(undamped(), {{"motor_lag.tau", tau}});
    const Dynamics<double> dynamics(model);
    InputSequence inputs;
    inputs.add(0, 1, 1, 1);
    Simulation<double> simulation(dynamics, inputs, {}, 0.0);
    simulation.advance(0.2);
    const double lost = tau > 0 ? tau * (1 - std::exp(-0.2 / tau)) : 0.0;
    EXPECT_NEAR(simulation.state().nu.x(), 2 * model.body.k / model.body.m * (0.2 - lost), 1e-9)
        << "tau = " << tau;
  }
}

// Also in a program that has no Simulation: each function is defined once, for everybody.
TEST(Stepping, ItsStretchesReachTheRequestedTime) {
  InputSequence inputs;
  inputs.add(0.013, 0.5, 0.5, 1);
  inputs.add(0.1, 0.2, 0.5, 1);
  Stepping stepping(inputs, 0, 0.02, false, 0.005);
  double sum = 0;
  Stretch stretch{};
  while (stepping.next(0.3, stretch)) {
    EXPECT_LE(stretch.h, 0.005 + 1e-12);
    sum += stretch.steps * stretch.h;
  }
  EXPECT_NEAR(sum, 0.3, 1e-12);
  EXPECT_EQ(stepping.held(), 2u);
}

TEST(MotorLag, IsSettledToEarlierCommandsAtTheStart) {
  const Dynamics<double> dynamics(withValues(tinyWhoover(), {{"motor_lag.tau", 0.1}}));
  InputSequence inputs;
  inputs.add(0, 1, 0.2, 1);
  inputs.add(0.3, 0.5, 1, 1);
  const Simulation<double> late(dynamics, inputs, {}, 0.35);
  const double at_change = 1 - std::exp(-3.0), fades = std::exp(-0.5);
  EXPECT_NEAR(late.actuated()(0), 0.5 + (at_change - 0.5) * fades, 1e-12);
  EXPECT_NEAR(late.actuated()(1), 1.0 + (0.2 * at_change - 1.0) * fades, 1e-12);
}

}  // namespace integration_test
}  // namespace ground
