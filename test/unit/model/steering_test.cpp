// Crafts with rudders, turning thrusters, valves and propellers: their wrench, actuators and model files.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>

#include "../crafts.h"
#include "ground/control/allocation.h"
#include "ground/control/reference_pilot.h"
#include "ground/model/capability.h"
#include "ground/model/simulation.h"
#include "ground/safety/fence.h"

namespace ground {
namespace steering_test {

constexpr char kBody[] =
    "schema: ground/model/1\nname: c\n"
    "body:\n  m: 1.2\n  I_z: 0.02\n  X_u: 0.2\n  Y_v: 0.3\n  N_r: 0.01\n  k: 2\n  thrusters:\n";
constexpr char kFan[] = "    - {name: fan, position: [-0.2, 0], direction: 0}\n";

Model craft(const std::string& thrusters, const std::string& effects = "[]") {
  return parseModel(kBody + thrusters + "effects: " + effects + '\n', "craft.yaml");
}
Model fanAndRudder(const std::string& foil, const std::string& effects = "[]") {
  return craft(kFan + ("    - {name: rudder, position: [-0.25, 0], angle: 30, foil: {" + foil + "}}\n"),
               effects);
}
constexpr char kStreamOnly[] = "stream: fan, force: 0.02, jet: 40, own_speed: 0, own_sway: 0";
constexpr char kBoth[] = "stream: fan, force: 0.5, jet: 2, own_speed: 0.8, own_sway: 0.6";
constexpr char kFin[] = "force: 3";

RigidState<double> moving(double u, double v, double r) { return {{0.3, -0.2, 0.7}, {u, v, r}}; }

Vector3<double> acceleration(const Model& model, const RigidState<double>& state,
                             const Thrusters<double>& input) {
  return Dynamics<double>(model).derivative(0.5, state, input, {1, std::nullopt}).nu;
}

// Without own speed the normal force is c jet T sin d, at the place of the foil.
TEST(Rudder, InTheStreamOnlyTurnsWithTheThrust) {
  const Model model = fanAndRudder(kStreamOnly);
  for (const double fan : {0.0, 0.3, 1.0}) {
    for (const double input : {-1.0, -0.4, 0.0, 0.7}) {
      const double angle = input * M_PI / 6, thrust = 2 * fan, normal = 0.02 * 40 * thrust * std::sin(angle);
      const Vector3<double> still = acceleration(model, moving(0, 0, 0), {fan, input});
      EXPECT_NEAR(still(0) * 1.2, thrust - normal * std::sin(angle), 1e-12);
      EXPECT_NEAR(still(1) * 1.2, -normal * std::cos(angle), 1e-12);
      EXPECT_NEAR(still(2) * 0.02, 0.25 * normal * std::cos(angle), 1e-12);
      const Vector3<double> drag = acceleration(model, moving(0.5, 0.3, 1), {fan, input}) -
                                   acceleration(model, moving(0.5, 0.3, 1), {0, 0});
      EXPECT_NEAR((drag - still).norm(), 0, 1e-12);  // own speed does not matter
    }
  }
}

TEST(Rudder, IsTheSameInAMirror) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(-1, 1);
  for (const char* foil : {kStreamOnly, kBoth, kFin}) {
    const Model model = fanAndRudder(foil);
    for (int i = 0; i < 100; ++i) {
      const double u = any(random), v = any(random), r = 3 * any(random), fan = std::abs(any(random)),
                   angle = any(random);
      const Vector3<double> one = acceleration(model, moving(u, v, r), {fan, angle});
      const Vector3<double> other = acceleration(model, moving(u, -v, -r), {fan, -angle});
      EXPECT_NEAR(one(0), other(0), 1e-12);
      EXPECT_NEAR(one(1), -other(1), 1e-12);
      EXPECT_NEAR(one(2), -other(2), 1e-12);
    }
  }
}

// Normal force against the normal velocity: a foil without a stream never drives the craft.
TEST(Foil, WithoutStreamOnlyTakesEnergy) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> any(-1, 1);
  const Model with = fanAndRudder(kFin);
  const Model without = fanAndRudder("force: 1.0e-300");
  const Matrix3<double> mass = Dynamics<double>(with).mass();
  for (int i = 0; i < 300; ++i) {
    const RigidState<double> state = moving(any(random), any(random), 4 * any(random));
    const Thrusters<double> input{0, any(random)};
    const Vector3<double> force =
        mass * (acceleration(with, state, input) - acceleration(without, state, input));
    EXPECT_LE(force.dot(state.nu), 1e-12);
  }
}

TEST(Foil, ForceGrowsWithTheSquareOfSpeedAndTheThrust) {
  const Model model = fanAndRudder(kBoth), none = fanAndRudder("stream: fan, force: 1.0e-300, jet: 1");
  const auto side = [&](double u, double fan) {
    const Thrusters<double> input{fan, 0.5};
    return acceleration(none, moving(u, 0, 0), input).y() - acceleration(model, moving(u, 0, 0), input).y();
  };
  EXPECT_NEAR(side(2, 0), 4 * side(1, 0), 1e-12);
  EXPECT_NEAR(side(0, 1), 4 * side(0, 0.25), 1e-12);
  EXPECT_NEAR(side(1, 1), side(1, 0) + side(0, 1), 1e-12);  // V_stream^2 = V^2 + k_T T
}

TEST(Foil, HasExactDerivatives) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(-1, 1);
  const Model model = fanAndRudder(
      kBoth, "[{name: foil_inflow_rudder, speed: 0.1, sway: 0.1}, {name: foil_side_rudder, a: 0.2}]");
  for (int i = 0; i < 50; ++i) {
    const RigidState<double> state = moving(any(random), any(random), any(random));
    const Thrusters<double> input{0.5 + 0.5 * any(random), any(random)};
    for (int p = 0; p < model.parameterCount(); ++p) {
      std::vector<double> low = model.coordinates(), high = low;
      std::vector<Jet> at(low.begin(), low.end());
      at[static_cast<std::size_t>(p)].v[0] = 1;
      const double h = 1e-6 * std::max(1.0, std::abs(low[static_cast<std::size_t>(p)]));
      low[static_cast<std::size_t>(p)] -= h;
      high[static_cast<std::size_t>(p)] += h;
      const Vector3<double> slope =
          (Dynamics<double>(model, high).derivative(0, state, input, {1, std::nullopt}).nu -
           Dynamics<double>(model, low).derivative(0, state, input, {1, std::nullopt}).nu) /
          (2 * h);
      const Vector3<Jet> exact =
          Dynamics<Jet>(model, at)
              .derivative(Jet(0.0), cast<Jet>(state), input.cast<Jet>(), {1, std::nullopt})
              .nu;
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(exact(c).v[0], slope(c), 1e-6 * (1 + std::abs(slope(c)))) << model.parameters()[p].name;
    }
  }
}

TEST(TurningThruster, IsAFixedOneInItsDirection) {
  const std::string pod = "    - {name: pod, position: [-0.2, 0.1], direction: 0}\n";
  const std::string angle = "    - {name: swivel, turns: pod, angle: 90, offset: 10}\n";
  const Model turning = craft(pod + angle);
  for (const double input : {-1.0, -0.3, 0.0, 0.5, 1.0}) {
    const Model fixed = craft(
        "    - {name: pod, position: [-0.2, 0.1], direction: " + std::to_string(90 * input + 10) + "}\n");
    const Vector3<double> difference = acceleration(turning, moving(0.1, -0.2, 0.3), {0.7, input}) -
                                       acceleration(fixed, moving(0.1, -0.2, 0.3), {0.7});
    EXPECT_NEAR(difference.norm(), 0, 1e-6);  // to_string has 6 digits
  }
}

/// A room of 4 x 4 m.
Room squareRoom() {
  Room room;
  room.corners = {{-2, -2}, {2, -2}, {2, 2}, {-2, 2}};
  return room;
}

// What the fence believes of a command is what the model does with it, whatever its angles.
TEST(Steering, TheFenceKnowsTheForceOfEveryAngle) {
  const std::string turning =
      "    - {name: bow, position: [0.2, 0], direction: 90, range: [-1, 1]}\n"
      "    - {name: servo, turns: fan, angle: 90}\n";
  const std::string stream = "    - {name: rudder, position: [-0.25, 0], angle: 30, offset: 4, foil: {";
  std::mt19937 random(11);
  for (const Model& model :
       {craft(kFan + turning), craft(kFan + stream + kBoth + "}}\n"),
        craft(kFan + stream + kStreamOnly + "}}\n"), loadModel("cfg/craft/one_fan_rudder.yaml"),
        loadModel("cfg/craft/propeller_ship.yaml"), loadModel("cfg/craft/twin_screw_catamaran.yaml"),
        loadModel("cfg/hovercraft/four_thrusters.yaml"), loadModel("cfg/hovercraft/tiny_whoover.yaml")}) {
    Model plain = model;
    for (const Model::Entry& entry : model.effects) plain.removeEffect(entry.effect->info().name);
    ReferencePilot pilot([] { return 0.0; }, [](const ReferencePilot::Decision&) {});
    pilot.setCraft(plain);
    double aside = 0;
    for (int i = 0; i < 200; ++i) {
      Inputs inputs = Inputs::off(model.thrusters->size(), 1);
      for (int j = 0; j < model.thrusters->size(); ++j)
        inputs.thrusters(j) = std::uniform_real_distribution<double>(
            1.5 * (*model.thrusters)[j].least, 1.5 * (*model.thrusters)[j].most)(random);
      // The link clips what is beyond the range.
      const Thrusters<double> given = model.thrusters->clipped(
          Thrusters<double>(model.body.input_max * asVector(inputs.thrusters)), model.body.input_max);
      const Vector3<double> moves =
          acceleration(plain, {Vector3<double>(0, 0, 0), Vector3<double>(0, 0, 0)}, given);
      const Vector2<double> believed = pilot.acceleration(0, inputs);
      EXPECT_NEAR((believed - moves.head<2>()).norm(), 0, 1e-9) << model.name;
      aside = std::max(aside, std::abs(believed.y()));
    }
    if (model.thrusters->steers()) {
      EXPECT_GT(aside, 0.01) << model.name;
    }
  }
}

// At rest near a wall to starboard, a fan that was turned by 90 degrees half a second ago pushes towards it.
TEST(Steering, ATurnedThrusterBesideAWallStopsTheDrive) {
  const Model model = craft(kFan + std::string("    - {name: servo, turns: fan, angle: 90}\n"));
  ReferencePilot pilot([] { return 0.0; }, [](const ReferencePilot::Decision&) {});
  pilot.setCraft(model);
  const Fence fence(squareRoom(), 0.2);
  const RigidState<double> beside{Vector3<double>(0, 1.7, 0), Vector3<double>(0, 0, 0)};
  const auto objection = [&](double angle) {
    Inputs inputs = Inputs::off(2, 1);
    inputs.thrusters(0) = 1;
    inputs.thrusters(1) = angle;
    return fence.objection(beside, 0.5, {{pilot.acceleration(0, inputs), 0.5}});
  };
  EXPECT_NE(objection(1), "");
  EXPECT_EQ(objection(-1), "") << "it pushes away from the wall";
  EXPECT_EQ(objection(0), "") << "it pushes along the wall";
}

TEST(Steering, EffectsChangeWhatTheModelSays) {
  const auto at = [](const Model& model) { return acceleration(model, moving(0.4, 0.1, 1), {0.8, 0.3}); };
  const auto close = [&](const Model& a, const Model& b) { return (at(a) - at(b)).norm() < 1e-9; };
  const std::string rudder = "    - {name: rudder, position: [-0.25, 0], angle: 30, ";
  const std::string foil = std::string("foil: {") + kBoth + "}}\n";
  EXPECT_TRUE(close(fanAndRudder(kBoth, "[{name: angle_offset_rudder, angle: 0.0872664625997165}]"),
                    craft(kFan + rudder + "offset: 5, " + foil)));
  EXPECT_TRUE(close(fanAndRudder(kBoth, "[{name: foil_gain_rudder, a: 0.5}]"),
                    fanAndRudder("stream: fan, force: 0.75, jet: 2, own_speed: 0.8, own_sway: 0.6")));
  EXPECT_TRUE(close(fanAndRudder(kBoth, "[{name: foil_inflow_rudder, speed: 0.36, sway: 0.4}]"),
                    fanAndRudder("stream: fan, force: 0.5, jet: 2")));
  EXPECT_FALSE(close(fanAndRudder(kBoth), fanAndRudder(kBoth, "[{name: foil_gain_rudder, a: 0.5}]")));
}

TEST(Steering, OneSideReachesTheFoilMoreThanTheOther) {
  const auto at = [](const std::string& foil, double v, const char* effects) {
    return acceleration(fanAndRudder(foil, effects), moving(0.4, v, 0), {0.8, 0.3});
  };
  const std::string foil = "stream: fan, force: 0.5, jet: 2, own_sway: ";
  const char* more_from_port = "[{name: foil_side_rudder, a: 0.2}]";
  const double to_port = -0.3;  // water comes from port
  EXPECT_LT((at(foil + "0.5", to_port, more_from_port) - at(foil + "0.6", to_port, "[]")).norm(), 1e-12);
  EXPECT_LT((at(foil + "0.5", -to_port, more_from_port) - at(foil + "0.4", -to_port, "[]")).norm(), 1e-12);
}

TEST(Steering, EffectsAreThoseThatTheCraftCanHave) {
  const auto names = effectNames(*fanAndRudder(kBoth).thrusters);
  const auto has = [&](const char* name) { return std::count(names.begin(), names.end(), name) == 1; };
  for (const char* name : {"angle_offset_rudder", "angle_lag_rudder", "angle_rate_rudder", "foil_gain_rudder",
                           "dead_band_rudder", "dead_band_fan"})
    EXPECT_TRUE(has(name)) << name;
  for (const char* name : {"angle_offset_fan", "thruster_gain_fan", "foil_gain_fan", "thruster_gain_rudder",
                           "thruster_tilt_rudder", "angle_gain_rudder", "valve_lag", "supply_droop"})
    EXPECT_FALSE(has(name)) << name;
  for (const std::string& name : effectNames())
    EXPECT_EQ(name.find("angle_") == 0 || name.find("foil_") == 0, false) << name;
  EXPECT_THROW(makeEffect("supply_droop"), std::invalid_argument);
}

/// The rudder's input after some time of a step command of 1.
double answer(const std::string& effects, double time, double step) {
  const Model model = fanAndRudder(kStreamOnly, effects);
  const Dynamics<double> dynamics(model);
  InputSequence inputs(2);
  inputs.add(0, {0.5, 1}, 1);
  Simulation<double> simulation(dynamics, inputs, moving(0, 0, 0), 0, step);
  simulation.advance(time);
  return simulation.actuated()(1);
}

TEST(Steering, AnglesFollowTheirCommandsInTime) {
  for (const double step : {0.02, 0.001}) {
    EXPECT_NEAR(answer("[{name: angle_lag_rudder, tau: 0.2}]", 0.3, step), 1 - std::exp(-1.5), 1e-9);
    // 30 degrees at 60 degrees per second
    EXPECT_NEAR(answer("[{name: angle_rate_rudder, rate: 1.0471975511965976}]", 0.2, step), 0.4, 1e-9);
    EXPECT_NEAR(answer("[{name: angle_rate_rudder, rate: 1.0471975511965976}]", 0.6, step), 1, 1e-12);
    EXPECT_NEAR(answer("[{name: dead_band_rudder, width: 0.25}]", 0.6, step), 0.75, 1e-12);
    EXPECT_EQ(answer("[{name: motor_lag, tau: 0.2}]", 0.1, step), 1);  // an angle is not a motor
  }
}

// The parabola of a ramp that ends within a step has its mean: long steps lose no impulse.
TEST(Steering, ARampIsIntegratedExactly) {
  const Model model = fanAndRudder(kStreamOnly, "[{name: angle_rate_rudder, rate: 3}]");
  const Dynamics<double> dynamics(model);
  const auto mean = [&](double h) {
    double state = 0, sum = 0;
    for (double t = 0; t < 0.3 - 1e-9; t += h) {
      const StepInputs<double> at = dynamics.actuate({0.5, 1}, {1, std::nullopt}, h, &state);
      sum += h / 6 * (at.thrusters[0](1) + 4 * at.thrusters[1](1) + at.thrusters[2](1));
    }
    return sum / 0.3;
  };
  EXPECT_NEAR(mean(0.3), mean(0.001), 1e-5);
}

Model freeFlyer(const std::string& effects) {
  std::string valves;
  for (int i = 0; i < 4; ++i)
    valves += "    - {name: v" + std::to_string(i) + ", position: [0.1, " + (i % 2 ? "0.1" : "-0.1") +
              "], direction: " + (i < 2 ? "0" : "180") + ", command: on_off}\n";
  return craft(valves, effects);
}

TEST(Valves, OpenAndCloseInTimesOfTheirOwn) {
  const Model model = freeFlyer("[{name: valve_lag, open: 0.05, close: 0.01}]");
  const Dynamics<double> dynamics(model);
  InputSequence inputs(4);
  inputs.add(0, {1, 0, 0, 0}, 1);
  inputs.add(1, {0, 0, 0, 0}, 1);
  Simulation<double> simulation(dynamics, inputs, moving(0, 0, 0), 0, 0.005);
  simulation.advance(0.03);
  EXPECT_NEAR(simulation.actuated()(0), 1 - std::exp(-0.6), 1e-9);
  simulation.advance(1.02);
  EXPECT_NEAR(simulation.actuated()(0), std::exp(-2), 1e-6);
}

TEST(Valves, ShareTheirSupply) {
  const Vector3<double> alone =
      acceleration(freeFlyer("[{name: supply_droop, s: 0.2}]"), moving(0, 0, 0), {1, 0, 0, 0});
  const Vector3<double> plain = acceleration(freeFlyer("[]"), moving(0, 0, 0), {1, 0, 0, 0});
  EXPECT_EQ(alone, plain);  // one alone loses nothing
  const Vector3<double> two =
      acceleration(freeFlyer("[{name: supply_droop, s: 0.2}]"), moving(0, 0, 0), {1, 1, 0, 0});
  EXPECT_NEAR(two.x(), 2 * plain.x() / 1.2, 1e-12);
}

TEST(Propeller, LosesThrustWithSpeedOverRevolutions) {
  const std::string screw =
      "    - {name: screw, position: [-0.2, 0.1], direction: 0, range: [-1, 1], curve: {power: 2}}\n";
  const Model model = craft(screw, "[{name: propeller_loss, b: 0.3}]"), none = craft(screw);
  for (const double n : {-0.8, 0.5, 1.0}) {
    const Vector3<double> lost =
        acceleration(none, moving(0.6, 0, 0), {n}) - acceleration(model, moving(0.6, 0, 0), {n});
    EXPECT_NEAR(lost.x() * 1.2, 2 * 0.3 * std::abs(n) * 0.6, 1e-12);
    EXPECT_EQ(acceleration(none, moving(0, 0, 0), {n}), acceleration(model, moving(0, 0, 0), {n}));
  }
}

TEST(Propeller, PushesLessBackward) {
  const std::string screw = "    - {name: screw, position: [-0.2, 0.1], direction: 0, range: [-1, 1]}\n";
  const Model model = craft(screw, "[{name: reverse_loss, a: 0.6}]"), none = craft(screw);
  for (const double n : {-0.8, 0.0, 0.5}) {
    const Vector3<double> pushed = acceleration(model, moving(0, 0, 0), {n});
    const Vector3<double> plain = acceleration(none, moving(0, 0, 0), {n});
    EXPECT_NEAR((pushed - (n < 0 ? 0.4 : 1.0) * plain).norm(), 0, 1e-12) << n;
  }
}

// A pod behind the centre that turns right round: at both ends of its range it pushes back, between them it
// turns.
TEST(Swivel, OfHalfATurnIsKnownToTurnTheCraft) {
  const auto turning = [](const std::string& angle) {
    return capability(craft(kFan + std::string("    - {name: servo, turns: fan, angle: ") + angle + "}\n"))
        .wrench;
  };
  EXPECT_NEAR(turning("180").z(), turning("90").z(), 1e-9);
  EXPECT_GT(turning("90").z(), 0.1 * turning("90").x());
}

TEST(SteeringFile, IsWrittenAsItWasRead) {
  const Model model = craft(
      kFan +
      std::string("    - {name: rudder, position: [-0.25, 0.01], angle: -30, offset: 2, channel: servo,\n"
                  "       range: [-0.5, 1], foil: {stream: fan, force: 0.5, jet: 2, drag: 0.7}}\n"
                  "    - {name: bow, position: [0.2, 0], direction: 90, command: on_off, supply: a}\n"
                  "    - {name: swivel, turns: bow, angle: 180}\n"));
  const std::string text = formatModel(model);
  const Model again = parseModel(text, "again.yaml");
  EXPECT_EQ(formatModel(again), text);
  EXPECT_EQ(model.thrusters->channels(), again.thrusters->channels());
  const Thrusters<double> input{0.4, 0.3, 1, -0.2};
  EXPECT_NEAR(
      (acceleration(model, moving(1, 0.2, 1), input) - acceleration(again, moving(1, 0.2, 1), input)).norm(),
      0, 1e-12);
}

TEST(SteeringFile, SaysWhatIsWrong) {
  const std::string place = "    - {name: rudder, position: [-0.2, 0], angle: 30, ";
  const auto says = [&](const std::string& thrusters, const std::string& what) {
    const std::string text = refusal([&] { craft(thrusters); });
    EXPECT_NE(text.find(what), std::string::npos) << text;
    EXPECT_NE(text.find("craft.yaml, line "), std::string::npos) << text;
  };
  says(kFan + place + "foil: {stream: fin, force: 1, jet: 1}}\n", "in the stream of fin, and no thruster");
  says(kFan + place + "foil: {stream: fan, force: 1}}\n", "needs jet");
  says(kFan + place + "foil: {force: -1}}\n", "force of its foil must be positive");
  says(kFan + place + "foil: {force: 1}, gain: 2}\n", "gain");
  says(kFan + std::string("    - {name: rudder, position: [-0.2, 0], foil: {force: 1}}\n"), "angle");
  says(kFan + std::string("    - {name: swivel, turns: fin, angle: 90}\n"), "it turns fin");
  says(kFan + std::string("    - {name: swivel, turns: fan, angle: 0}\n"), "angle must not be 0");
}

TEST(SteeredAllocation, TurnsAndPushesWithinTheRanges) {
  const Model model = fanAndRudder(kStreamOnly);
  const Allocation allocation(model, {1, 1e-4, 1});
  std::mt19937 random(5);
  std::uniform_real_distribution<double> any(-1, 1);
  for (int i = 0; i < 200; ++i) {
    const double force = 1.2 + 0.3 * any(random), moment = 0.07 * any(random);
    const Allocation::Output out = allocation.run({force, 0, moment});
    EXPECT_NEAR(out.wrench.x(), force, 1e-3);
    EXPECT_NEAR(out.wrench.z(), moment, 1e-3);
    EXPECT_GE(out.inputs(0), 0);
    EXPECT_LE(std::abs(out.inputs(1)), 1);
  }
  EXPECT_NEAR(allocation.most({1, 0, 0}).wrench.x(), 2, 1e-3);
  EXPECT_GT(allocation.most({0, 0, 1}).wrench.z(), 0.1);
  EXPECT_LT(allocation.most({0, 0, -1}).wrench.z(), -0.1);
}

TEST(SteeredAllocation, KnowsTheOffsetOfARudder) {
  const Model model = fanAndRudder(kStreamOnly, "[{name: angle_offset_rudder, angle: 0.1}]");
  const Allocation::Output out = Allocation(model, {1, 1e-4, 1}).run({1, 0, 0});
  EXPECT_NEAR(out.inputs(1) * M_PI / 6, -0.1, 1e-3);
}

}  // namespace steering_test
}  // namespace ground
