// Every effect of the library: absent at its neutral value, exact derivatives, right physics.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>
#include <regex>
#include <string>

#include "../crafts.h"
#include "ground/model/expression_effect.h"
#include "ground/model/simulation.h"
#include "ground/model/typical.h"

namespace ground {
namespace effects_test {

Model with(const std::string& effect) {
  Model model = tinyWhoover();
  model.addEffect(makeEffect(effect));
  model.body.volts = 7.4;
  return model;
}

/// Commands with edges that are not on a grid.
InputSequence excitation() {
  InputSequence inputs;
  std::mt19937 random(7);
  std::uniform_real_distribution<double> level(0.1, 1.0);
  for (int i = 0; i < 25; ++i) inputs.add(0.0813 * i, level(random), level(random), 0.9);
  for (int i = 0; i < 5; ++i) inputs.battery.add(0.5 * i, 8 - 0.3 * i);
  return inputs;
}

const Vector3<double> kPlace(0.5, -1.0, 2.0);

template <typename T>
std::vector<Measurement<T>> run(const Model& model, const std::vector<T>& coordinates,
                                const Vector3<double>& place = kPlace) {
  static const InputSequence inputs = excitation();
  const Dynamics<T> dynamics(model, coordinates);
  RigidState<T> start;
  start.nu = Vector3<double>(0.3, -0.2, 1.0).cast<T>();
  start.eta = place.cast<T>();
  Simulation<T> simulation(dynamics, inputs, start, 0.05);
  std::vector<Measurement<T>> trajectory;
  for (double t = 0.1; t < 1.9; t += 0.113) {
    simulation.advance(t);
    trajectory.push_back(simulation.measure());
  }
  return trajectory;
}

double difference(const Measurement<double>& a, const Measurement<double>& b) {
  return std::max((a.eta - b.eta).cwiseAbs().maxCoeff(), (a.nu - b.nu).cwiseAbs().maxCoeff());
}

class EveryEffect : public testing::TestWithParam<std::string> {};

TEST_P(EveryEffect, IsExactlyAbsentAtItsNeutralValue) {
  const Model nominal = tinyWhoover(), neutral = with(GetParam());
  const auto without = nominal.coordinates(), with = neutral.coordinates();
  const auto a = run(nominal, std::vector<Jet>(without.begin(), without.end()));
  std::vector<Jet> jets(with.begin(), with.end());
  jets.back().v[0] = 1.0;  // an effect without a derivative would not be computed
  const auto b = run(neutral, jets);
  // A mass matrix with derivatives is inverted as a whole, which rounds differently.
  const double rounding = makeEffect(GetParam())->hooks() & Effect::kInertia ? 1e-14 : 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(a[i].eta(k).a, b[i].eta(k).a, rounding);
      EXPECT_NEAR(a[i].nu(k).a, b[i].nu(k).a, rounding);
    }
}

TEST_P(EveryEffect, ChangesTheMotionInEachOfItsParameters) {
  // Several places: the floor's friction depends on the place.
  const Model neutral = with(GetParam());
  const auto infos = neutral.parameters();
  for (std::size_t p = bodyParameters().size(); p < infos.size(); ++p) {
    std::vector<double> before = neutral.coordinates();
    if (infos[p].shape)
      for (std::size_t q = bodyParameters().size(); q < infos.size(); ++q)
        before[q] += infos[q].scale(neutral.body);
    std::vector<double> coordinates = before;
    coordinates[p] += infos[p].scale(neutral.body);
    double largest = 0;
    for (double x = -2; x <= 2; ++x)
      for (double y = -2; y <= 2; ++y) {
        const Vector3<double> place(x, y, 2.0);
        const auto nominal = run(neutral, before, place), changed = run(neutral, coordinates, place);
        largest = std::max(largest, difference(nominal.back(), changed.back()));
      }
    EXPECT_GT(largest, 1e-4) << infos[p].name;
  }
}

/// The largest slope of a motion by a coordinate, and the largest difference from it of the exact
/// derivatives.
struct Slopes {
  double largest = 0, worst = 0;

  /// h: step of the differences, which are one-sided where the coordinate is `bounded`.
  Slopes(const Model& model, const std::vector<double>& at, std::size_t p, double h, bool bounded = false) {
    std::vector<Jet> jets(at.begin(), at.end());
    jets[p].v[3] = 1.0;
    const auto exact = run(model, jets);
    const auto moved = [&](double steps) {
      std::vector<double> c = at;
      c[p] += steps * h;
      return run(model, c);
    };
    const auto zero = moved(0), plus = moved(1), other = moved(bounded ? 2 : -1);
    for (std::size_t i = 0; i < exact.size(); ++i)
      for (int k = 0; k < 6; ++k) {
        const auto value = [k](const auto& m) { return k < 3 ? m.eta(k) : m.nu(k - 3); };
        const double finite = bounded ? (4 * value(plus[i]) - 3 * value(zero[i]) - value(other[i])) / (2 * h)
                                      : (value(plus[i]) - value(other[i])) / (2 * h);
        largest = std::max(largest, std::abs(finite));
        worst = std::max(worst, std::abs(value(exact[i]).v[3] - finite));
      }
  }
};

TEST_P(EveryEffect, DerivativesAgreeWithFiniteDifferences) {
  const Model neutral = with(GetParam());
  const auto infos = neutral.parameters();
  for (bool at_neutral : {false, true}) {
    std::vector<double> at = neutral.coordinates();
    for (std::size_t p = bodyParameters().size(); p < at.size() && !at_neutral; ++p)
      at[p] += 0.9 * infos[p].scale(neutral.body);
    for (std::size_t p = 2; p < at.size(); ++p) {
      const bool own = p >= bodyParameters().size();
      const bool bounded =
          own && at_neutral &&
          (infos[p].lower == infos[p].neutral || infos[p].coordinate == Coordinate::kReciprocal);
      const Slopes found(neutral, at, p, 1e-5 * infos[p].scale(neutral.body), bounded);
      EXPECT_LT(found.worst, 1e-5 * found.largest + 1e-12)
          << infos[p].name << (at_neutral ? " at neutral" : " away from neutral");
    }
  }
}

TEST_P(EveryEffect, SaysWhetherTheMotionDependsOnThePose) {
  Model model = with(GetParam());
  const auto infos = model.parameters();
  std::vector<double> at = model.coordinates();
  for (std::size_t p = bodyParameters().size(); p < at.size(); ++p)
    at[p] += (1 + 0.1 * static_cast<double>(p)) * infos[p].scale(model.body);
  const Dynamics<double> dynamics(model, at);
  const InputSequence inputs = excitation();
  const auto speedFrom = [&](const Vector3<double>& place) {
    RigidState<double> start;
    start.eta = place;
    Simulation<double> simulation(dynamics, inputs, start, 0.05);
    simulation.advance(1);
    return simulation.state().nu;
  };
  const double change = (speedFrom({1, 0.5, 2}) - speedFrom({-0.7, 0.2, -0.4})).norm();
  EXPECT_EQ(dynamics.usesPose(), change > 1e-9) << change;
}

/// Powers of mass and time in a unit such as "N s^2/m".
Vector2<double> powers(std::string unit) {
  Vector2<double> found(0, 0);
  const std::map<std::string, Vector2<double>> known = {{"kg", {1, 0}}, {"s", {0, 1}},   {"N", {1, -2}},
                                                        {"m", {0, 0}},  {"rad", {0, 0}}, {"-", {0, 0}}};
  const std::regex factor("(/?)([a-zA-Z]+|-)(?:\\^(\\d))?");
  for (std::sregex_iterator at(unit.begin(), unit.end(), factor), end; at != end; ++at) {
    const double power = at->str(3).empty() ? 1 : std::stod(at->str(3));
    found += (at->str(1).empty() ? power : -power) * known.at(at->str(2));
  }
  return found;
}

TEST_P(EveryEffect, ScalesChangeWithTheUnitsOfMassAndTime) {
  const Body<double> body = tinyWhoover().body;
  const double mass = 3, time = 0.7;  // the new numbers for 1 kg and for 1 s
  Body<double> other = body;
  other.m *= mass;
  other.I_z *= mass;
  other.k *= mass / (time * time);
  for (double* damping : {&other.X_u, &other.Y_v, &other.N_r}) *damping *= mass / time;
  Body<double> smaller = body;
  smaller.l *= 0.5;
  for (const ParameterInfo& info : makeEffect(GetParam())->info().parameters) {
    EXPECT_GT(info.scale(body), 0) << info.name;
    if (info.scale(other) == info.scale(body) && info.scale(smaller) == info.scale(body)) continue;
    const Vector2<double> power = (info.coordinate == Coordinate::kReciprocal ? -1 : 1) * powers(info.unit);
    EXPECT_NEAR(info.scale(other) / info.scale(body), std::pow(mass, power(0)) * std::pow(time, power(1)),
                1e-9)
        << info.name;
  }
}

INSTANTIATE_TEST_SUITE_P(Library, EveryEffect, testing::ValuesIn(effectNames()),
                         [](const auto& test) { return test.param; });

RigidState<double> acceleration(const Model& model, const RigidState<double>& state,
                                const Vector2<double>& input = {0, 0}, double t = 0) {
  return Dynamics<double>(model).derivative(t, state, input, {1.0, std::nullopt});
}

TEST(Physics, ComOffsetIsTheSameCraftSeenFromAnotherPoint) {
  // Force-free motion must agree whether described about the centre of mass or about an offset
  // point.
  const Model plain = undamped(),
              offset = withValues(plain, {{"com_offset.xg", 0.02}, {"com_offset.yg", -0.013}});
  const Vector2<double> g(0.02, -0.013);
  RigidState<double> about_com, about_origin;
  about_com.nu << 0.4, 0.3, 5.0;
  about_com.eta << 1, 2, 0.7;
  about_origin.nu << about_com.nu.x() + about_com.nu.z() * g.y(), about_com.nu.y() - about_com.nu.z() * g.x(),
      about_com.nu.z();
  about_origin.eta.head<2>() = about_com.eta.head<2>() - bodyToWorld<double>(0.7, g);
  about_origin.eta.z() = 0.7;
  const InputSequence none;
  const Dynamics<double> a(plain), b(offset);
  Simulation<double> com(a, none, about_com, 0), origin(b, none, about_origin, 0);
  com.advance(2.0);
  origin.advance(2.0);
  const RigidState<double>&c = com.state(), &o = origin.state();
  EXPECT_NEAR(c.nu.z(), o.nu.z(), 1e-6);
  EXPECT_LT((c.eta.head<2>() - o.eta.head<2>() - bodyToWorld<double>(o.eta.z(), g)).norm(), 1e-6);
}

TEST(Physics, MeasurementOffsetsCommute) {
  const std::vector<std::pair<std::string, double>> offsets = {
      {"marker_offset.dx", 0.02}, {"marker_offset.dy", -0.03}, {"heading_offset.psi0", 1.1}};
  const Model one = withValues(with("marker_offset"), offsets);
  const Model other = withValues(with("heading_offset"), offsets);
  RigidState<double> state;
  state.eta << 1, 2, 0.3;
  state.nu << 0.5, -0.2, 3;
  const auto a = Dynamics<double>(one).measure(state), b = Dynamics<double>(other).measure(state);
  EXPECT_LT(difference(a, b), 1e-14);
  // The measured velocity is the derivative of the measured pose.
  const double h = 1e-6;
  const RigidState<double> rate = acceleration(one, state);
  const auto at = [&](double dt) {
    return Dynamics<double>(one).measure({state.eta + dt * rate.eta, state.nu});
  };
  const Vector3<double> velocity = (at(h).eta - at(-h).eta) / (2 * h);
  const Vector2<double> body = worldToBody<double>(a.eta.z(), velocity.head<2>());
  EXPECT_LT((body - a.nu.head<2>()).norm(), 1e-8);
}

TEST(Physics, ThrustFollowsTheVoltageOfTheBattery) {
  Model model = with("battery_voltage");
  model.setValue("battery_voltage.p", 1.5);
  const auto surge = [&](const Model& craft, std::optional<double> volts) {
    const Thrusters<double> full{1.0, 1.0};
    return Dynamics<double>(craft).derivative(0, {}, full, {1.0, volts}).nu.x();
  };
  const double full = surge(tinyWhoover(), std::nullopt);
  EXPECT_NEAR(surge(model, 7.4), full, 1e-12);
  EXPECT_NEAR(surge(model, 6.66), std::pow(0.9, 1.5) * full, 1e-12);
  EXPECT_EQ(surge(model, std::nullopt), full) << "the voltage is not known";
  model.body.volts = 0;
  EXPECT_EQ(surge(model, 6.66), full) << "at which voltage k holds is not told";
}

TEST(Voltage, ActsAtOnceWhileCommandsAreDelayed) {
  Model model = withValues(tinyWhoover(), {{"battery_voltage.p", 2}, {"input_delay.delay", 0.3}});
  model.body.volts = 8;
  InputSequence inputs;
  inputs.add(0, 1, 1, 1);
  for (const auto& [time, volts] : {std::make_pair(0.0, 8.0), {0.5, 8.0}, {0.5, 4.0}, {1.5, 6.0}})
    inputs.battery.add(time, volts);
  EXPECT_EQ(inputs.battery.at(-1), 8);
  EXPECT_EQ(inputs.battery.at(0.5), 4);
  EXPECT_EQ(inputs.battery.at(1.0), 5);
  EXPECT_EQ(inputs.battery.at(9.0), 6);
  const Dynamics<double> dynamics(model);
  Simulation<double> simulation(dynamics, inputs, {}, 0);
  const double full = 2 * model.body.k / model.body.m;
  const auto thrust = [&](double time) {
    simulation.advance(time);
    const double drag = model.body.X_u / model.body.m * simulation.state().nu.x();
    return (simulation.derivative().nu.x() + drag) / full;
  };
  EXPECT_NEAR(thrust(0.2), 0, 1e-12);
  EXPECT_NEAR(thrust(0.4), 1, 1e-9);
  EXPECT_NEAR(thrust(1.0), 25.0 / 64, 1e-9);
  EXPECT_NEAR(thrust(2.0), 36.0 / 64, 1e-9);
  EXPECT_THROW(inputs.battery.add(1.0, 5), std::invalid_argument);
  EXPECT_THROW(inputs.battery.add(2.0, 0), std::invalid_argument);
}

/// Damping that the floor adds at a place, from the acceleration [N s/m].
double floorDamping(const Model& model, double x, double y) {
  RigidState<double> state;
  state.eta << x, y, 0.3;
  state.nu << 0.5, 0.25, 0;
  const Vector3<double> change = acceleration(tinyWhoover(), state).nu - acceleration(model, state).nu;
  EXPECT_NEAR(change.y(), 0.5 * change.x(), 1e-12);  // opposite to the velocity
  EXPECT_EQ(change.z(), 0);
  return model.body.m * change.x() / 0.5;
}

TEST(Physics, FloorFrictionIsInterpolatedBetweenTheNodesOfItsGrid) {
  const Model model = withValues(tinyWhoover(), {{"floor_friction_map.c_3_1", 0.01},     // x = 1 m, y = -1 m
                                                 {"floor_friction_map.c_4_1", 0.02},     // x = 2 m, y = -1 m
                                                 {"floor_friction_map.c_4_2", -0.03}});  // x = 2 m, y = 0 m
  EXPECT_NEAR(floorDamping(model, 1, -1), 0.01, 1e-12);
  EXPECT_NEAR(floorDamping(model, 2, 0), -0.03, 1e-12);
  EXPECT_NEAR(floorDamping(model, 1.25, -1), 0.75 * 0.01 + 0.25 * 0.02, 1e-12);
  const double south = 0.5 * 0.01 + 0.5 * 0.02, north = 0.5 * -0.03;
  EXPECT_NEAR(floorDamping(model, 1.5, -0.25), 0.25 * south + 0.75 * north, 1e-12);
  EXPECT_NEAR(floorDamping(model, 0.5, -1.5), 0.25 * 0.01, 1e-12);
  EXPECT_NEAR(floorDamping(model, 7, -1), 0.02, 1e-12);  // the value at the edge
  EXPECT_EQ(floorDamping(model, -1, 1), 0.0);
}

ParameterInfo parameter(const std::string& name, const std::string& unit, double neutral) {
  ParameterInfo info;
  info.name = name;
  info.unit = unit;
  info.neutral = neutral;
  return info;
}

ExpressionDefinition cubicDamping() {
  ExpressionDefinition definition;
  definition.name = "cubic_damping";
  definition.N = "-c*r^3 + d*sin(psi)*u_L*lift";
  definition.parameters = {parameter("c", "N m s^3", 0), parameter("d", "N m", 0)};
  definition.typical = {1e-6, 1e-4};
  return definition;
}

TEST(ExpressionEffect, EqualsTheFormula) {
  Model model = tinyWhoover();
  model.addEffect(makeExpressionEffect(cubicDamping()));
  model.setValue("cubic_damping.c", 2e-6);
  model.setValue("cubic_damping.d", 3e-4);
  RigidState<double> state;
  state.nu.z() = 4;
  state.eta.z() = 0.6;
  const double nominal = acceleration(tinyWhoover(), state, {0.5, 0.5}).nu.z();
  const double moment = -2e-6 * 64 + 3e-4 * std::sin(0.6) * 0.5;
  EXPECT_NEAR(acceleration(model, state, {0.5, 0.5}).nu.z() - nominal, moment / model.body.I_z, 1e-9);
}

/// A craft with a formula of a yaw moment, in which c is 1.
Model withMoment(const std::string& formula) {
  ExpressionDefinition definition = cubicDamping();
  definition.N = formula;
  Model model = tinyWhoover();
  model.addEffect(makeExpressionEffect(definition));
  model.setValue("cubic_damping.c", 1.0);
  return model;
}

TEST(ExpressionEffect, DerivativesOfAllFunctionsAreExact) {
  for (const std::string formula : {"u*v-r/(2+u)",
                                    "-u^2+v^3*r^4",
                                    "u^5",
                                    "abs(u)^1.5",
                                    "abs(u)^v",
                                    "abs(-u)",
                                    "sign(v)*u",
                                    "sqrt(abs(u))",
                                    "exp(u)",
                                    "ln(abs(u))",
                                    "log2(2+u)+log10(2+v)",
                                    "sin(2*u)*cos(v)",
                                    "tan(u)",
                                    "asin(u)+acos(v)",
                                    "atan(u)",
                                    "sinh(u)-cosh(v)",
                                    "tanh(u)",
                                    "asinh(u)",
                                    "acosh(3+u)",
                                    "atanh(u)",
                                    "rint(u)*v",
                                    "atan2(u, v)",
                                    "min(u, v, r)",
                                    "max(u, v)",
                                    "sum(u, v)",
                                    "avg(u, v, r)",
                                    "u < v ? u*r : v",
                                    "u > v && r >= 1 ? u : r^2",
                                    "u == v || u != v ? v : u",
                                    "_pi*u+_e*v"}) {
    const Model model = withMoment("c*(" + formula + ")");
    RigidState<Jet> state = {};
    RigidState<double> near = {};
    for (int i = 0; i < 3; ++i) state.nu(i) = Jet(near.nu(i) = 0.3 + 0.4 * i, i);
    const Jet exact = Dynamics<Jet>(model).derivative(0.0, state, {0.0, 0.0}, {1.0, std::nullopt}).nu.z();
    for (int i = 0; i < 3; ++i) {
      constexpr double kStep = 1e-6;
      RigidState<double> up = near, down = near;
      up.nu(i) += kStep;
      down.nu(i) -= kStep;
      const double finite = (acceleration(model, up).nu.z() - acceleration(model, down).nu.z()) / (2 * kStep);
      EXPECT_NEAR(exact.v[i], finite, 1e-6 * (1 + std::abs(exact.a))) << formula << ", by " << i;
    }
  }
}

TEST(ExpressionEffect, HasNoSlopeWhereAFiniteValueHasNone) {
  const Model model = withMoment("c*(sqrt(u^2+v^2)*r+abs(u)+sqrt(abs(v)))");
  RigidState<Jet> rest = {};
  for (int i = 0; i < 3; ++i) rest.nu(i) = Jet(0.0, i);
  const Jet found = Dynamics<Jet>(model).derivative(0.0, rest, {0.0, 0.0}, {1.0, std::nullopt}).nu.z();
  EXPECT_EQ(found.v[0], 0.0);
  EXPECT_EQ(found.v[1], 0.0);
}

TEST(ExpressionEffect, MayBeWrittenInTheFrameOfTheWorld) {
  ParameterInfo k;
  k.name = "k";
  ExpressionDefinition spring{"spring", "-k*x", "-k*(y - 0.5)", "k*sin(psi)", {k}, {1}};
  spring.world = true;
  ExpressionDefinition body = spring;
  body.world = false;
  body.X = "-k*x*cos(psi) - k*(y - 0.5)*sin(psi)";
  body.Y = "k*x*sin(psi) - k*(y - 0.5)*cos(psi)";
  Model seen[2] = {tinyWhoover(), tinyWhoover()};
  seen[0].addEffect(makeExpressionEffect(spring));
  seen[1].addEffect(makeExpressionEffect(body));
  for (Model& model : seen) model.setValue("spring.k", 0.01);
  std::vector<std::vector<Measurement<Jet>>> found;
  for (const Model& model : seen) {
    std::vector<Jet> coordinates;
    for (const double value : model.coordinates()) coordinates.emplace_back(value);
    coordinates.back().v[0] = 1;
    found.push_back(run(model, coordinates));
  }
  for (std::size_t i = 0; i < found[0].size(); ++i)
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(found[0][i].eta(c).a, found[1][i].eta(c).a, 1e-12);
      EXPECT_NEAR(found[0][i].eta(c).v[0], found[1][i].eta(c).v[0], 1e-8);
    }
}

/// A skirt pressure that follows the lift with a time constant and pushes ahead.
ExpressionDefinition skirtPressure() {
  ExpressionDefinition definition;
  definition.name = "skirt";
  definition.X = "c*p";
  definition.parameters = {parameter("c", "N", 0), parameter("tau", "s", 0.4)};
  definition.typical = {0.02, 0.1};
  definition.states = {{"p", "(lift - p)/tau", 0}};
  return definition;
}

Model withSkirt(const ExpressionDefinition& definition, double c, double tau) {
  Model model = tinyWhoover();
  model.addEffect(makeExpressionEffect(definition));
  model.setValue("skirt.c", c);
  model.setValue("skirt.tau", tau);
  return model;
}

TEST(StatesOfEffects, FollowAFirstOrderLagInClosedForm) {
  Model model = withSkirt(skirtPressure(), 0.02, 0.2);
  model.setValue("X_u", 0.0);
  const Dynamics<double> dynamics(model);
  InputSequence inputs;
  inputs.add(0.1037, 0, 0, 0.8);
  Simulation<double> simulation(dynamics, inputs, {}, 0);
  for (double t = 0.2; t < 2; t += 0.31) {
    simulation.advance(t);
    const double on = t - 0.1037, decay = std::exp(-on / 0.2);
    const double gain = 0.8 * 0.02 / model.body.m;
    EXPECT_NEAR(simulation.derivative().nu.x(), gain * (1 - decay), 1e-7 * gain);
    EXPECT_NEAR(simulation.state().nu.x(), gain * (on - 0.2 * (1 - decay)), 1e-7 * gain);
  }
}

TEST(StatesOfEffects, StartSettledToEarlierCommands) {
  const Model model = withSkirt(skirtPressure(), 0.02, 0.2);
  const Dynamics<double> dynamics(model);
  const auto pressure = [&](double since, double start) {
    InputSequence inputs;
    inputs.add(-since, 0, 0, 0.8);
    const Simulation<double> simulation(dynamics, inputs, {}, start);
    return simulation.derivative().nu.x() * model.body.m / 0.02;
  };
  EXPECT_NEAR(pressure(30, 0), 0.8, 1e-9);
  EXPECT_NEAR(pressure(0.3, 0), 0.8 * (1 - std::exp(-0.3 / 0.2)), 1e-6);
  EXPECT_EQ(pressure(-1, 0), 0);  // no command before the start
  ExpressionDefinition full = skirtPressure();
  full.states[0].initial = 0.5;
  const Dynamics<double> from_half(withSkirt(full, 0.02, 0.2));
  const InputSequence none;
  const Simulation<double> simulation(from_half, none, {}, 0);
  EXPECT_NEAR(simulation.derivative().nu.x(), 0.5 * 0.02 / model.body.m, 1e-12);
}

/// The same push, which follows the motion.
ExpressionDefinition wake() {
  ExpressionDefinition definition = skirtPressure();
  definition.states = {{"p", "(u - p)/tau", 0}};
  return definition;
}

TEST(StatesOfEffects, SettleWithTheInitialMotionAndHaveDerivativesByIt) {
  const Model model = withSkirt(wake(), 0.02, 0.2);
  InputSequence inputs;
  inputs.add(-0.3, 0, 0, 1);
  RigidState<Jet> start;
  start.nu.x() = Jet(0.7, 0);
  const Dynamics<Jet> dynamics(model);
  const Simulation<Jet> simulation(dynamics, inputs, start, 0);
  const double share = 1 - std::exp(-0.3 / 0.2);
  const Jet surge = simulation.derivative().nu.x();
  const Body<double>& b = model.body;
  EXPECT_NEAR(surge.a, 0.7 * (share * 0.02 - b.X_u) / b.m, 1e-6);
  EXPECT_NEAR(surge.v[0], (share * 0.02 - b.X_u) / b.m, 1e-6);
}

TEST(StatesOfEffects, KeepValuesWithoutDerivativesWhenASimulationRestarts) {
  const Dynamics<Jet> dynamics(withSkirt(wake(), 0.02, 0.2));
  const InputSequence none;
  RigidState<Jet> start;
  start.nu.x() = Jet(0.7, 0);
  Simulation<Jet> simulation(dynamics, none, start, 0);
  simulation.advance(0.5);
  const Jet before = simulation.derivative().nu.x();
  EXPECT_GT(std::abs(before.v[0]), 0.1);
  RigidState<Jet> other;
  simulation.restart(other);
  const Jet after = simulation.derivative().nu.x();
  EXPECT_TRUE(isConstant(after));
  EXPECT_GT(after.a, 0.1 * 0.02 / tinyWhoover().body.m);  // acceleration by the wake alone
}

TEST(StatesOfEffects, DerivativesAgreeWithFiniteDifferences) {
  // States that depend on delayed and lagged inputs, on motion, place and another state.
  ExpressionDefinition definition = skirtPressure();
  definition.X = "c*p + c*q*u";
  definition.N = "0.01*c*q";
  definition.thrusts["left"] = "-c*p*u_L";
  definition.states = {{"p", "(lift*u_L + 0.2*u + 0.1*sin(psi) - p)/tau", 0.3},
                       {"q", "(p*r + 0.1*x - q)/(2*tau)", 0}};
  const Model model =
      withValues(withSkirt(definition, 0.02, 0.15), {{"input_delay.delay", 0.0234}, {"motor_lag.tau", 0.03}});
  const auto infos = model.parameters();
  const std::vector<double> at = model.coordinates();
  for (std::size_t p = 2; p < at.size(); ++p) {
    // The lag's formula for short steps differs by 1e-10; a small h for the delay would amplify it.
    const double share = infos[p].name == "input_delay.delay" ? 1e-3 : 1e-5;
    const Slopes found(model, at, p, share * infos[p].scale(model.body));
    EXPECT_GT(found.largest, 0) << infos[p].name;
    EXPECT_LT(found.worst, 1e-5 * found.largest) << infos[p].name;
  }
}

TEST(StatesOfEffects, MayActOnEachThruster) {
  ExpressionDefinition droop = skirtPressure();
  droop.X = "";
  droop.thrusts["left"] = "-c*p*u_L";
  droop.thrusts["right"] = "2*c*p*u_R";
  const Model model = withSkirt(droop, 0.01, 0.2);
  const Dynamics<double> dynamics(model), nominal(tinyWhoover());
  const double full = 1;
  const auto at = [&](const Dynamics<double>& d) {
    return d.derivative(0, {}, {0.5, 0.25}, {1, std::nullopt}, &full).nu;
  };
  const Vector3<double> change = at(dynamics) - at(nominal);
  EXPECT_NEAR(change.x(), 0, 1e-12);
  EXPECT_NEAR(change.z(), -0.01 * model.body.l / model.body.I_z, 1e-9);
}

TEST(ExpressionEffect, RefusesBadFormulas) {
  for (const char* formula :
       {"c*", "unknown*u", "u=3", "c*u, v", "c*system(1)", "1 + c*u", "c*sqrt(-1)", "c*(0/0)"}) {
    EXPECT_THROW(withMoment(formula), std::invalid_argument) << formula;
  }
  ExpressionDefinition taken = cubicDamping();
  taken.parameters[0].name = "psi";
  EXPECT_THROW(makeExpressionEffect(taken), std::invalid_argument);
}

}  // namespace effects_test
}  // namespace ground
