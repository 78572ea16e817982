// Controllers of crafts with other thrusters than a left and a right one.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "../faulty_craft.h"
#include "ground/control/controllers.h"
#include "ground/control/feasibility.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"
#include "ground/safety/obedience_monitor.h"
#include "ground/simulation/experiment.h"

namespace ground {
namespace any_thrusters_test {

constexpr char kBody[] =
    "schema: ground/model/1\nname: four thrusters\n"
    "body:\n  m: 0.1763\n  I_z: 4.0e-4\n  X_u: 0.05\n  Y_v: 0.06\n  N_r: 1.0e-4\n  k: 0.06\n"
    "  thrusters:\n"
    "    - {name: back_left, position: [-0.05, -0.0425], direction: 0}\n"
    "    - {name: back_right, position: [-0.05, 0.0425], direction: 0}\n";
/// Two propellers behind push forward, two in front push backward.
Model four(const std::string& curve = "") {
  const std::string rest =
      ", direction: 180" + (curve.empty() ? "" : ", curve: " + curve) + "}\neffects: []\n";
  const std::string left = "    - {name: front_left, position: [0.05, -0.0425]";
  const std::string right = "    - {name: front_right, position: [0.05, 0.0425]";
  const std::string middle = rest.substr(0, rest.find("effects"));
  return parseModel(kBody + left + middle + right + rest, "four.yaml");
}
/// A pair of reversible thrusters.
Model reversible() {
  Model model = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  Thruster left, right;
  left.name = left.channel = "port";
  right.name = right.channel = "starboard";
  left.position = {0, -model.body.l};
  right.position = {0, model.body.l};
  left.least = right.least = -1;
  model.thrusters = std::make_shared<const ThrusterLayout>(std::vector<Thruster>{left, right});
  return model;
}
Model table() { return loadModel("cfg/craft/air_table.yaml"); }
/// The pair as a craft that lists its thrusters.
Model listed() {
  Model model = reversible();
  std::vector<Thruster> thrusters = model.thrusters->thrusters();
  for (Thruster& one : thrusters) one.least = 0;
  model.thrusters = std::make_shared<const ThrusterLayout>(thrusters);
  return model;
}

/// Root mean square of the position error after `settled` [s]. Fails if an input is outside of its
/// range.
double errorOf(const Model& truth, TrackingController& control, const ReferenceTrajectory& reference,
               double duration, double settled) {
  const Dynamics<double> dynamics(truth);
  InputSequence inputs(truth.thrusters->size());
  Simulation<double> simulation(dynamics, inputs, {}, 0);
  double squares = 0;
  int count = 0;
  for (int i = 0; i < duration * 50; ++i) {
    const double t = i / 50.0;
    simulation.advance(t);
    const Thrusters<double> chosen = control.decide({t,
                                                     t,
                                                     simulation.state(),
                                                     &reference,
                                                     0,
                                                     {1, std::nullopt},
                                                     0,
                                                     poseMeasurement(simulation.state().eta, 3e-4, 5e-3)});
    EXPECT_TRUE(truth.thrusters->clipped(chosen, truth.body.input_max) == chosen) << t;
    control.commanded(t, chosen, 1);
    inputs.add(t, chosen, 1);
    if (t < settled) continue;
    squares += (simulation.state().eta.head<2>() - reference.at(t).p).squaredNorm();
    ++count;
  }
  return std::sqrt(squares / count);
}

TEST(TrackingLawOfAnyThrusters, GivesAListedPairTheInputsOfThePair) {
  const Model model = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  const BacksteppingControl pair(model, {}), other(listed(), {});
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int i = 0; i < 1000; ++i) {
    RigidState<double> state;
    ReferencePoint reference;
    for (int c = 0; c < 3; ++c) state.eta(c) = uniform(random);
    for (int c = 0; c < 3; ++c) state.nu(c) = uniform(random);
    reference.p = {uniform(random), uniform(random)};
    reference.p_dot = {uniform(random), uniform(random)};
    const auto a = pair.run(state, reference), b = other.run(state, reference);
    for (int j = 0; j < 2; ++j) {
      ASSERT_NEAR(a.inputs(j), b.inputs(j), 1e-12);
      ASSERT_NEAR(a.wanted(j), b.wanted(j), 1e-9 * (1 + std::abs(a.wanted(j))));
    }
  }
}

TEST(TrackingLawOfAnyThrusters, FollowsACircle) {
  TrackingGains gains;
  gains.k_z = 3e-3;
  BacksteppingControl control(four(), gains);
  EXPECT_LT(errorOf(four(), control, *makeCircle({0, 0}, 1, 0.4), 60, 30), 0.2);
}

TEST(TrackingLawOfAnyThrusters, RefusesCraftsThatItCannotSteer) {
  Thruster forward, side;
  forward.name = forward.channel = "forward";
  forward.position = {0, 0.1};
  side.name = side.channel = "side";
  side.position = {-0.1, 0};
  side.direction = 90;
  Model model = four();
  const auto use = [&](std::vector<Thruster> thrusters) {
    model.thrusters = std::make_shared<const ThrusterLayout>(thrusters);
    model.body.l = model.thrusters->lever();
    return effectUse("TrajectoryTracking", model).refusal;
  };
  EXPECT_NE(use({forward}).find("do not turn it to starboard; use ModelPredictive"), std::string::npos)
      << use({forward});
  forward.position.y() = -0.1;
  EXPECT_NE(use({forward}).find("do not turn it to port"), std::string::npos) << use({forward});
  EXPECT_NE(use({side}).find("do not push it forward"), std::string::npos) << use({side});
  EXPECT_EQ(effectUse("TrajectoryTracking", table()).refusal, "");
}

TEST(PredictiveControlOfAnyThrusters, FollowsACircle) {
  PredictiveControl first(four(), {});
  EXPECT_LT(errorOf(four(), first, *makeCircle({0, 0}, 1, 0.4), 30, 15), 2e-3);
  PredictiveControl second(table(), {});
  EXPECT_LT(errorOf(table(), second, *makeCircle({0, 0}, 0.5, 0.3), 30, 20), 5e-3);
  PredictiveControl third(reversible(), {});
  EXPECT_LT(errorOf(reversible(), third, *makeCircle({0, 0}, 1, 0.4), 30, 15), 2e-3);
}

TEST(PredictiveControlOfAnyThrusters, UsesThrustersWhoseForceCurveIsFlatAtZero) {
  // It can stop at the end of the line only with the thrusters in front.
  for (const char* curve : {"{power: 1.8}", "{table: [[0, 0], [0.1, 0], [1, 1]]}"}) {
    const Model model = four(curve);
    PredictiveControl control(model, {});
    const double error = errorOf(model, control, *makeLine({0, 0}, {1.5, 0}, 0.5, true), 10, 6);
    EXPECT_LT(error, 0.02) << curve;
  }
}

TEST(FeasibilityOfAnyThrusters, KnowsBrakesAndSidewaysThrust) {
  const ReferencePtr stop = makeLine({0, 0}, {2.5, 2.5}, 0.6, true);
  Model pair = four();
  std::vector<Thruster> back = pair.thrusters->thrusters();
  back.resize(2);
  pair.thrusters = std::make_shared<const ThrusterLayout>(back);
  EXPECT_NE(infeasibility(*stop, pair), "") << "without thrusters in front it cannot brake";
  EXPECT_EQ(infeasibility(*stop, four()), "");
  EXPECT_NE(infeasibility(*makeCircle({0, 0}, 2, 1.5), four()).find("a thrust of"), std::string::npos);
  EXPECT_EQ(infeasibility(*makeLine({0, 0}, {1, 1}, 0.2, true), table()), "");
  EXPECT_NE(infeasibility(*makeCircle({0, 0}, 1, 1), table()).find("the thrusters give"), std::string::npos);
}

ExperimentLog flown(const Model& model, CraftFault fault, double fault_from) {
  TrackingParams tracking;
  tracking.reference.kind = "circle";
  tracking.reference.size = 0.5;
  tracking.reference.rate_of_turn = 0.3;
  tracking.controller.kind = "ModelPredictive";
  tracking.duration = 20;
  tracking.max_error = std::numeric_limits<double>::infinity();
  ModelCraft::Params start;
  start.initial.eta << 0.5, 0, M_PI / 2;
  FaultyCraft craft(model, start, fault, fault_from);
  ExperimentParams place;
  place.plant = &craft;
  return trackReference(model, model, tracking, place);
}

TEST(ObedienceOfAnyThrusters, NoticesACraftThatDoesNotFollow) {
  for (const Model& model : {four(), table(), reversible()}) {
    const ExperimentLog sound = flown(model, CraftFault::kDeaf, 1e9);
    EXPECT_EQ(sound.stopped, "") << model.name;
    EXPECT_EQ(sound.commands.back().thrusters.size(), model.thrusters->size());
    const ExperimentLog deaf = flown(model, CraftFault::kDeaf, 6);
    EXPECT_NE(deaf.stopped.find("does not follow its commands"), std::string::npos)
        << model.name << ": " << deaf.stopped;
  }
}

TEST(ExcitationOfAnyThrusters, StaysInsideARoom) {
  const Room room = loadRoom("cfg/room/room_4x4.yaml");
  for (const Model& model : {four(), table()}) {
    ExcitationParams params;
    params.duration = 60;
    params.room = room;
    const ExperimentLog log = excite(model, model, params, {});
    EXPECT_EQ(log.stopped, "") << model.name;
    EXPECT_GE(log.marks.size(), 3u) << model.name << ": bursts and returns";
    for (const auto& truth : log.truth) ASSERT_GT(room.clearance(truth.state.eta.head<2>()), 0) << model.name;
    for (const auto& command : log.commands) ASSERT_EQ(command.thrusters.size(), model.thrusters->size());
  }
}

}  // namespace any_thrusters_test
}  // namespace ground
