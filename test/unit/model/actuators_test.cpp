// Memory of thrusters and their supply: exact over steps of any length.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <string>

#include "../crafts.h"
#include "ground/model/simulation.h"

namespace ground {
namespace actuators_test {

Model with(const std::vector<std::pair<std::string, double>>& values) {
  return withValues(undamped(), values);
}

constexpr double kHold = 0.0813;

/// The same command for both thrusters.
InputSequence steps() {
  InputSequence inputs;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> level(0, 1);
  for (int i = 0; i < 20; ++i) {
    const double command = level(random);
    inputs.add(kHold * i, command, command, 0.9);
  }
  return inputs;
}

/// Straight ahead, without damping, the speed is the sum of what acts: here by an independent integration in
/// steps of 10 us. acts: input that acts at a command, from the states before; it moves the states by h.
using Acts =
    std::function<Vector2<double>(const Vector2<double>& command, Vector2<double>& states, double h)>;

double speed(const Model& model, const Acts& acts, double end) {
  constexpr double kStep = 1e-5;
  const InputSequence inputs = steps();
  Vector2<double> states(0, 0);
  double sum = 0;
  for (int i = 0; i < std::lround(end / kStep); ++i) {
    const auto at = static_cast<std::size_t>((i + 0.5) * kStep / kHold);
    const Thrusters<double>& command = inputs.thrusters[std::min<std::size_t>(at, 19)];
    sum += kStep * acts({command(0), command(1)}, states, kStep).sum();
  }
  return model.body.k / model.body.m * sum;
}

void expectSpeed(const Model& model, const Acts& acts) {
  const Dynamics<double> dynamics(model);
  const InputSequence inputs = steps();
  const double expected = speed(model, acts, 1.5);
  for (const double step : {0.001, 0.005, 0.03}) {
    Simulation<double> simulation(dynamics, inputs, {}, 0, step);
    simulation.advance(1.5);
    EXPECT_NEAR(simulation.state().nu.x(), expected, 2e-4 * expected) << step;
  }
}

Acts ofEach(const std::function<double(double command, double input)>& rate) {
  return [rate](const Vector2<double>& command, Vector2<double>& inputs, double h) {
    const Vector2<double> before = inputs;
    for (int i = 0; i < 2; ++i) inputs(i) += h * rate(command(i), inputs(i));
    return Vector2<double>(0.5 * (before + inputs));
  };
}

TEST(MotorRiseFall, HasATimeForEachWay) {
  for (const double fall : {0.02, 0.15}) {
    const auto rate = [fall](double u, double w) { return (u - w) / (u > w ? 0.07 : fall); };
    expectSpeed(with({{"motor_rise_fall.rise", 0.07}, {"motor_rise_fall.fall", fall}}), ofEach(rate));
  }
}

TEST(MotorRiseFall, IsALagWhereBothTimesAreTheSame) {
  const Dynamics<double> both(with({{"motor_rise_fall.rise", 0.05}, {"motor_rise_fall.fall", 0.05}}));
  const Dynamics<double> lag(with({{"motor_lag.tau", 0.05}}));
  const InputSequence inputs = steps();
  Simulation<double> one(both, inputs, {}, 0), other(lag, inputs, {}, 0);
  one.advance(1.5);
  other.advance(1.5);
  EXPECT_EQ(one.state().eta, other.state().eta);
}

TEST(MotorRiseFall, TakesBackwardForForward) {
  const std::string text =
      "schema: ground/model/1\nname: c\nbody:\n  {m: 1, I_z: 1, X_u: 0, Y_v: 0, N_r: 0, k: 1, thrusters: "
      "[{name: screw, position: [0, 0.1], direction: 0, range: [-1, 1]}]}\n"
      "effects: [{name: motor_rise_fall, rise: 0.1, fall: 0.02}]\n";
  const Dynamics<double> dynamics(parseModel(text, "craft.yaml"));
  const auto after = [&](double sign) {
    InputSequence inputs(1);
    inputs.add(0, {sign}, 1);
    inputs.add(0.2, {sign * 0.3}, 1);
    Simulation<double> simulation(dynamics, inputs, {}, 0);
    simulation.advance(0.5);
    return simulation.state().nu.x();
  };
  EXPECT_EQ(after(-1), -after(1));
}

TEST(MotorRate, IsTheSlopeOfAnInput) {
  constexpr double kRate = 6;
  const Acts acts = [](const Vector2<double>& command, Vector2<double>& inputs, double h) {
    const Vector2<double> before = inputs;
    for (int i = 0; i < 2; ++i)
      inputs(i) += std::max(-h * kRate, std::min(h * kRate, command(i) - inputs(i)));
    return Vector2<double>(0.5 * (before + inputs));
  };
  expectSpeed(with({{"motor_rate.rate", kRate}}), acts);
}

TEST(SupplySag, RecoversWithoutLoad) {
  const Acts acts = [](const Vector2<double>& command, Vector2<double>& states, double h) {
    const double before = states(0);
    states(0) += h * (0.5 * command.sum() - before) / 0.4;
    return Vector2<double>(command * (1 - 0.3 * 0.5 * (before + states(0))));
  };
  expectSpeed(with({{"supply_sag.part", 0.3}, {"supply_sag.time", 0.4}}), acts);
}

TEST(ThrustDroop, IsThatOfEachThruster) {
  const Model model = with({{"thrust_droop.part", 0.3}, {"thrust_droop.time", 0.4}});
  const Acts acts = [](const Vector2<double>& command, Vector2<double>& states, double h) {
    const Vector2<double> before = states;
    states += h / 0.4 * (command - before);
    return Vector2<double>(command.array() * (1 - 0.15 * (before + states).array()));
  };
  expectSpeed(model, acts);
  const Dynamics<double> dynamics(model);
  InputSequence one;
  one.add(0, 1, 0, 0.9);
  one.add(3, 1, 1, 0.9);
  Simulation<double> simulation(dynamics, one, {}, 0);
  simulation.advance(3);
  EXPECT_NEAR(simulation.actuated()(0), 0.7, 1e-3);
  EXPECT_NEAR(simulation.actuated()(1), 1, 1e-9);  // it begins to work
}

TEST(Actuators, WorkOneAfterAnother) {
  // a lag of what a limited rate lets through, whatever the length of a step
  const Dynamics<double> dynamics(with({{"motor_rate.rate", 6}, {"motor_lag.tau", 0.03}}));
  const InputSequence inputs = steps();
  const auto at = [&](double step) {
    Simulation<double> simulation(dynamics, inputs, {}, 0, step);
    simulation.advance(1.5);
    return simulation.state().nu.x();
  };
  EXPECT_NEAR(at(0.005), at(0.0005), 1e-3 * at(0.0005));
}

}  // namespace actuators_test
}  // namespace ground
