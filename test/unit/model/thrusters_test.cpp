// Crafts that list their thrusters: their layout, model files, motion and effects.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "../crafts.h"
#include "ground/model/capability.h"
#include "ground/model/plausibility.h"
#include "ground/model/simulation.h"

namespace ground {
namespace thrusters_test {

constexpr char kBody[] =
    "schema: ground/model/1\nname: c\n"
    "body:\n  m: 0.1763\n  I_z: 4.0e-4\n  X_u: 0.05\n  Y_v: 0.06\n  N_r: 1.0e-4\n  k: 0.06\n";
constexpr char kFour[] =
    "  thrusters:\n"
    "    - {name: back_left, position: [-0.05, -0.0425], direction: 0}\n"
    "    - {name: back_right, position: [-0.05, 0.0425], direction: 0}\n"
    "    - {name: front_left, position: [0.05, -0.0425], direction: 180, gain: 0.9,\n"
    "       curve: {power: 1.7}}\n"
    "    - {name: front_right, position: [0.05, 0.0425], direction: 170, range: [-0.5, 1],\n"
    "       channel: fr, curve: {table: [[-1, -0.4], [0, 0], [0.5, 0.2], [1, 1]]}}\n";

TEST(Thrusters, MoreThanACraftCanHaveAreRefused) {
  EXPECT_EQ(Thrusters<double>(Eigen::VectorXd::Zero(8)).size(), 8);
  EXPECT_THROW(Thrusters<double>(Eigen::VectorXd::Zero(9)), std::invalid_argument);
  EXPECT_THROW(Thrusters<double>::zero(9), std::invalid_argument);
  EXPECT_THROW(Thrusters<Jet>::zero(1000000), std::invalid_argument);
  EXPECT_THROW((Thrusters<double>{0, 0, 0, 0, 0, 0, 0, 0, 0}), std::invalid_argument);
}

Model table() { return loadModel("cfg/craft/air_table.yaml"); }
Model four(const std::string& effects = "effects: []\n") {
  return parseModel(std::string(kBody) + kFour + effects, "four.yaml");
}

RigidState<double> someState() { return {{0.3, -0.2, 0.7}, {0.4, -0.3, 1.2}}; }

Vector3<double> accelerationOf(const Model& model, const Thrusters<double>& input) {
  const Dynamics<double> dynamics(model);
  return dynamics.derivative(0.5, someState(), input, {1, std::nullopt}).nu;
}

/// The same craft whose left and right thruster are listed.
Model listed(const Model& pair) {
  Model model = pair;
  Thruster left, right;
  left.name = left.channel = "left";
  right.name = right.channel = "right";
  left.position = {0, -pair.body.l};
  right.position = {0, pair.body.l};
  model.thrusters = std::make_shared<const ThrusterLayout>(std::vector<Thruster>{left, right});
  return model;
}

TEST(ThrusterLayout, OfThePairIsThatOfTheThesis) {
  const ThrusterLayout& pair = *thrusterPair();
  EXPECT_TRUE(pair.isPair());
  EXPECT_FALSE(pair.sways());
  EXPECT_EQ(pair.total(Thrusters<double>{3, 1}), Vector3<double>(4, 0, 2));
  Body<double> body;
  body.k = body.input_max = body.l = 1;
  EXPECT_EQ(capability(pair, body).force, 2);
  EXPECT_EQ(capability(pair, body).wrench, Vector3<double>(2, 0, 1));
  EXPECT_EQ(pair.channels(), (std::vector<std::string>{"left", "right", "lift"}));
}

// Sums over the intervals of a table round, differently on each processor.
TEST(ThrusterLayout, AnyTableThroughZeroHasNoForceThere) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> part(0.01, 0.4);
  for (int i = 0; i < 1000; ++i) {
    Thruster thruster;
    thruster.name = thruster.channel = "one";
    thruster.least = -1;
    std::vector<std::array<double, 2>>& points = thruster.curve.table;
    points = {{0, 0}};
    while (points.front()[0] > -1)
      points.insert(points.begin(), {points.front()[0] - part(random), points.front()[1] - part(random)});
    while (points.back()[0] < 1)
      points.push_back({points.back()[0] + part(random), points.back()[1] + part(random)});
    EXPECT_NO_THROW(validate(thruster));
    EXPECT_EQ(thruster.curve.at(0.0), 0);
    EXPECT_NEAR(thruster.curve.at(points[1][0]), points[1][1], 1e-14);
    points[0][1] -= 0.01;  // all other points stay the same
    EXPECT_NO_THROW(validate(thruster));
    for (auto& [input, force] : points) force += 1e-9;
    EXPECT_THROW(validate(thruster), std::invalid_argument);
  }
}

TEST(ThrusterLayout, GivesTheWrenchOfItsForces) {
  const Model model = four();
  const Thrusters<double> force{1, 2, 3, 4};
  const Vector3<double> total = model.thrusters->total(force);
  Vector3<double> expected = Vector3<double>::Zero();
  for (int i = 0; i < 4; ++i) {
    const Thruster& one = (*model.thrusters)[i];
    const double angle = one.direction * M_PI / 180;
    const double X = force(i) * std::cos(angle), Y = force(i) * std::sin(angle);
    expected += Vector3<double>(X, Y, one.position.x() * Y - one.position.y() * X);
  }
  EXPECT_NEAR(total(0), expected(0), 1e-12);
  EXPECT_NEAR(total(1), expected(1), 1e-12);
  EXPECT_NEAR(model.body.l * total(2), expected(2), 1e-12);
}

TEST(ThrusterLayout, CurvesHaveExactDerivatives) {
  for (const ForceCurve& curve :
       {four().thrusters->thrusters()[2].curve, four().thrusters->thrusters()[3].curve}) {
    for (const double at : {-0.3, 0.2, 0.7}) {
      const double h = 1e-6;
      EXPECT_NEAR(curve.at(Jet(at, 0)).v[0], (curve.at(at + h) - curve.at(at - h)) / (2 * h), 1e-8);
    }
  }
}

// --- model files

TEST(ThrustersInModelFiles, SurviveARoundTrip) {
  const Model model = four();
  const Model again = parseModel(formatModel(model), "again");
  EXPECT_EQ(formatModel(again), formatModel(model));
  EXPECT_EQ(again.values(), model.values());
  EXPECT_EQ(again.thrusters->channels(), model.thrusters->channels());
  const Thrusters<double> input{0.2, 0.4, 0.6, -0.4};
  EXPECT_EQ(accelerationOf(again, input), accelerationOf(model, input));
  EXPECT_EQ(parseModel(formatModel(table()), "t").thrusters->liftChannel(), "air");
}

TEST(ThrustersInModelFiles, PositionsScaleWithTheLever) {
  Model model = four();
  model.setValue("l", 2 * model.body.l);
  const Model again = parseModel(formatModel(model), "again");
  EXPECT_NEAR(again.body.l, model.body.l, 1e-15);
  EXPECT_NEAR((*again.thrusters)[1].position.y(), 0.085, 1e-15);
  EXPECT_NEAR((*again.thrusters)[1].position.x(), -0.1, 1e-15);
}

TEST(ThrustersInModelFiles, ThePairStaysTheShortForm) {
  const std::string text = formatModel(loadModel("cfg/hovercraft/tiny_whoover.yaml"));
  EXPECT_EQ(text.find("thrusters:"), std::string::npos) << text;
  EXPECT_NE(text.find("  l: 0.0325"), std::string::npos) << text;
}

// --- motion

/// Motion of a plate with jets, integrated independently: Newton's law in the world's frame.
struct Plate {
  double m, I_z, along, across, spin;
  struct Jet {
    double x, y, direction, force;
  };
  std::vector<Jet> jets;

  using State = std::array<double, 6>;  ///< x, y, psi and their derivatives, world_ned

  State rate(const State& s, const std::vector<double>& input) const {
    const double c = std::cos(s[2]), n = std::sin(s[2]);
    const double u = c * s[3] + n * s[4], v = c * s[4] - n * s[3];
    double X = -along * u, Y = -across * v, N = -spin * s[5];
    for (std::size_t i = 0; i < jets.size(); ++i) {
      const double angle = jets[i].direction * M_PI / 180;
      const double fx = input[i] * jets[i].force * std::cos(angle);
      const double fy = input[i] * jets[i].force * std::sin(angle);
      X += fx;
      Y += fy;
      N += jets[i].x * fy - jets[i].y * fx;
    }
    return {s[3], s[4], s[5], (c * X - n * Y) / m, (n * X + c * Y) / m, N / I_z};
  }
  State step(const State& s, const std::vector<double>& input, double h) const {
    const auto moved = [&s](const State& rates, double by) {
      State to = s;
      for (std::size_t i = 0; i < 6; ++i) to[i] += by * rates[i];
      return to;
    };
    const State a = rate(s, input), b = rate(moved(a, h / 2), input);
    const State c = rate(moved(b, h / 2), input), d = rate(moved(c, h), input);
    State to = s;
    for (std::size_t i = 0; i < 6; ++i) to[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
    return to;
  }
};

TEST(AirTable, MovesAsAnIndependentIntegrationSays) {
  const double a = 0.15, F = 0.5;
  const Plate plate{4.0,
                    0.08,
                    0.15,
                    0.15,
                    0.003,
                    {{a, a, 180, F},
                     {a, a, 270, F},
                     {a, -a, 180, F},
                     {a, -a, 90, F},
                     {-a, a, 0, F},
                     {-a, a, 270, F},
                     {-a, -a, 0, F},
                     {-a, -a, 90, F}}};
  const Model model = table();
  const Dynamics<double> dynamics(model);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(0, 1);
  InputSequence inputs(8);
  std::vector<std::vector<double>> commands;
  for (int i = 0; i < 40; ++i) {
    Thrusters<double> command = Thrusters<double>::zero(8);
    for (double& one : command) one = any(random);
    inputs.add(0.25 * i, command, 1);
    commands.emplace_back(command.begin(), command.end());
  }
  Simulation<double> simulation(dynamics, inputs, {}, 0);
  Plate::State state{};
  for (const std::vector<double>& command : commands) {
    for (int i = 0; i < 250; ++i) state = plate.step(state, command, 1e-3);
    simulation.advance(simulation.time() + 0.25);
    const Vector3<double>& eta = simulation.state().eta;
    for (int i = 0; i < 3; ++i)
      EXPECT_NEAR(eta(i), state[static_cast<std::size_t>(i)], 1e-9) << simulation.time();
  }
  EXPECT_GT(std::hypot(state[0], state[1]), 0.5);
  EXPECT_GT(std::abs(state[2]), 0.3);
}

TEST(AirTable, InputsOfAnotherCraftAreRefused) {
  const Model model = table();
  const Dynamics<double> dynamics(model);
  InputSequence pair;
  pair.add(0, 1, 1, 1);
  EXPECT_THROW(Simulation<double>(dynamics, pair, {}, 0), std::invalid_argument);
  EXPECT_THROW(pair.add(1, Thrusters<double>{1, 1, 1}, 1), std::invalid_argument);
}

// --- effects

class OfEveryEffect : public testing::TestWithParam<std::string> {};

/// A craft with the effect, every parameter off its neutral value.
Model withEffectOn(Model model, const std::string& name) {
  model.addEffect(makeEffect(name, *model.thrusters));
  for (const ParameterInfo& p : model.effects.back().effect->info().parameters) {
    const double off = p.toCoordinate(p.neutral) + 0.3 * p.scale(model.body);
    model.setValue(name + "." + p.name, p.fromCoordinate(off));
  }
  return model;
}

TEST_P(OfEveryEffect, AListedPairMovesAsTheShortForm) {
  const Model pair = withEffectOn(loadModel("cfg/hovercraft/tiny_whoover.yaml"), GetParam());
  const Model same = listed(pair);
  InputSequence inputs;
  for (int i = 0; i < 20; ++i) inputs.add(0.1 * i - 0.5, 0.1 * (i % 7), 0.15 * (i % 5), 1);
  const Dynamics<double> a(pair), b(same);
  Simulation<double> one(a, inputs, someState(), 0), other(b, inputs, someState(), 0);
  one.advance(1.3);
  other.advance(1.3);
  EXPECT_LT((one.state().eta - other.state().eta).norm(), 1e-11);
  EXPECT_LT((one.state().nu - other.state().nu).norm(), 1e-11);
}

/// The effect acts on eight jets, and its derivatives are those of finite differences.
void checkDerivatives(const std::string& effect) {
  const Model model = withEffectOn(table(), effect);
  const std::vector<double> at = model.coordinates();
  std::vector<Jet> seeded(at.begin(), at.end());
  const std::size_t first = bodyParameters().size();
  for (std::size_t i = first; i < seeded.size() && i < first + 8; ++i)
    seeded[i].v[static_cast<int>(i - first)] = 1;
  InputSequence inputs(8);
  for (int i = 0; i < 20; ++i) {
    Thrusters<double> command = Thrusters<double>::zero(8);
    for (int j = 0; j < 8; ++j) command(j) = 0.1 + 0.05 * ((3 * i + 5 * j) % 17);
    inputs.add(0.1 * i - 0.5, command, 0.8);
  }
  const auto seen = [&](const auto& coordinates) {
    using T = typename std::decay_t<decltype(coordinates)>::value_type;
    const Dynamics<T> dynamics(model, coordinates);
    RigidState<T> state;
    state.eta = someState().eta.cast<T>();
    state.nu = someState().nu.cast<T>();
    Simulation<T> simulation(dynamics, inputs, state, 0);
    simulation.advance(1.3);
    return simulation.measure();
  };
  const Measurement<Jet> exact = seen(seeded);
  for (std::size_t i = first; i < at.size() && i < first + 8; ++i) {
    const ParameterInfo info = model.parameters()[i];
    const double h = 1e-5 * info.scale(model.body);
    std::vector<double> above = at, below = at;
    above[i] += h;
    below[i] -= h;
    const Measurement<double> high = seen(above), low = seen(below);
    for (int j = 0; j < 3; ++j) {
      const double slope = (high.nu(j) - low.nu(j)) / (2 * h);
      EXPECT_NEAR(exact.nu(j).v[static_cast<int>(i - first)], slope,
                  1e-5 * std::abs(slope) + 1e-6 / info.scale(model.body))
          << info.name << ' ' << j;
    }
  }
}

TEST_P(OfEveryEffect, HasExactDerivativesOnEightJets) { checkDerivatives(GetParam()); }

INSTANTIATE_TEST_SUITE_P(Library, OfEveryEffect, testing::ValuesIn(effectNames()),
                         [](const auto& one) { return one.param; });

TEST(EffectsOfOneThruster, ExistForThoseThatAreListed) {
  const std::vector<std::string> names = effectNames(*table().thrusters);
  EXPECT_EQ(names.size(), effectNames().size() + 17);  // two of each jet, and supply_droop
  EXPECT_NE(std::find(names.begin(), names.end(), "thruster_gain_front_left_back"), names.end());
  EXPECT_THROW(makeEffect("thruster_gain_left"), std::invalid_argument);
}

TEST(EffectsOfOneThruster, HaveExactDerivatives) {
  checkDerivatives("thruster_gain_back_left_right");
  checkDerivatives("thruster_tilt_front_right_left");
}

/// A craft of four thrusters with an effect moves as one whose thrusters are others.
void expectSameAs(const std::vector<Thruster>& thrusters, const std::string& parameter, double value) {
  const Thrusters<double> input{0.7, 0.4, 0.6, -0.4};
  Model expected = four();
  expected.thrusters = std::make_shared<const ThrusterLayout>(thrusters);
  expected.body.l = expected.thrusters->lever();
  const Vector3<double> found = accelerationOf(withValues(four(), {{parameter, value}}), input);
  EXPECT_LT((found - accelerationOf(expected, input)).norm(), 1e-12) << parameter;
  EXPECT_GT((found - accelerationOf(four(), input)).norm(), 1e-3) << parameter;
}

TEST(ThrusterEffects, AreOtherGainsAndDirectionsOfTheLayout) {
  const std::vector<Thruster> thrusters = four().thrusters->thrusters();
  std::vector<Thruster> turned = thrusters;
  for (std::size_t i = 0; i < 4; ++i) {  // the last one pushes to the side, too
    std::vector<Thruster> weaker = thrusters, tilted = thrusters;
    weaker[i].gain *= 0.8;
    expectSameAs(weaker, "thruster_gain_" + thrusters[i].name + ".a", -0.2);
    tilted[i].direction += 5;
    expectSameAs(tilted, "thruster_tilt_" + thrusters[i].name + ".angle", 5 * M_PI / 180);
    turned[i].direction += 5;
  }
  expectSameAs(turned, "thrust_misalignment.angle", 5 * M_PI / 180);
}

TEST(ThrusterEffects, FormulasKnowThrustersByNameAndNumber) {
  const std::string effects =
      "effects:\n"
      "  - name: wake\n"
      "    expression: {Y: \"c*(u_front_left - u_4)\", thrust_back_left: \"c*u_1*u_back_left\"}\n"
      "    parameters: {c: {value: 0.01, unit: N}}\n";
  const Model model = four(effects);
  const Thrusters<double> input{0.5, 0.4, 0.6, -0.4};
  const Vector3<double> change = accelerationOf(model, input) - accelerationOf(four(), input);
  const double added = 0.01 * 0.25;
  EXPECT_NEAR(change(0), added / 0.1763, 1e-12);
  EXPECT_NEAR(change(1), 0.01 * (0.6 + 0.4) / 0.1763, 1e-12);
  EXPECT_NEAR(change(2), 0.0425 * added / 4e-4, 1e-12);
  const Model again = parseModel(formatModel(model), "again");
  EXPECT_EQ(accelerationOf(again, input), accelerationOf(model, input));

  const std::vector<double> at = model.coordinates();
  std::vector<Jet> seeded(at.begin(), at.end());
  seeded.back().v[0] = 1;
  RigidState<Jet> state;
  Thrusters<Jet> jets = input.cast<Jet>();
  jets(0) = Jet(0.5, 1);
  const Vector3<Jet> nu =
      Dynamics<Jet>(model, seeded).derivative(Jet(0.0), state, jets, {1, std::nullopt}).nu;
  EXPECT_NEAR(nu(0).v[0], 0.25 / 0.1763, 1e-9);
  EXPECT_NEAR(nu(0).v[1], (0.06 + 0.01 * 2 * 0.5) / 0.1763, 1e-6) << "u_1 and u_back_left are one";
}

}  // namespace thrusters_test
}  // namespace ground
