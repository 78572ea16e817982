// The equations of docs/theory/effects.md, written down once more for plain numbers.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "../crafts.h"
#include "ground/model/dynamics.h"

namespace ground {
namespace formulas_test {

using Values = std::map<std::string, double>;

/// Parameters at which effects change a motion clearly.
const std::map<std::string, Values> kEffects = {
    {"added_mass", {{"mx", 0.01}, {"my", 0.03}}},
    {"battery_sag", {{"tau", 40}}},
    {"body_force_bias", {{"x0", 0.01}, {"y0", -0.02}}},
    {"com_offset", {{"xg", 0.006}, {"yg", -0.004}}},
    {"coulomb_friction", {{"f", 0.01}, {"n", 2e-4}}},
    {"differential_side_force", {{"c", 0.2}}},
    {"directional_yaw_damping", {{"na", 3e-5}}},
    {"drift_resistance", {{"xvv", 0.02}, {"xvr", -0.003}, {"xrr", 4e-4}}},
    {"floor_tilt", {{"sx", 0.02}, {"sy", -0.01}}},
    {"hull_lift", {{"yv", 0.03}, {"yr", -0.002}, {"nv", 0.001}, {"nr", 2e-4}}},
    {"hull_nonlinear",
     {{"xvvvv", 0.02},
      {"yvvv", 0.03},
      {"yvvr", 0.002},
      {"yvrr", 4e-4},
      {"yrrr", 2e-5},
      {"nvvv", 0.001},
      {"nvvr", 3e-4},
      {"nvrr", 2e-5},
      {"nrrr", 1e-6}}},
    {"momentum_drag", {{"q", 0.02}}},
    {"quadratic_drag", {{"cx", 0.02}, {"cy", 0.05}, {"cr", 1e-5}}},
    {"skirt_friction", {{"f0", 0.04}, {"n0", 6e-4}}},
    {"surge_resistance", {{"xuu", 0.03}}},
    {"sway_yaw_damping", {{"yr", 0.003}, {"nv", 0.002}}},
    {"thrust_asymmetry", {{"a", 0.1}}},
    {"thrust_curve", {{"p", 1.6}}},
    {"thrust_misalignment", {{"angle", 0.1}}},
    {"thrust_speed_loss", {{"c", 0.3}}},
    {"thrust_sway_moment", {{"c", 0.02}}},
    {"wind", {{"wx", 0.3}, {"wy", -0.2}}},
    {"yaw_bias", {{"n0", 1e-4}}},
};

struct Instant {
  double t, u, v, r, psi, left, right, lift;
};

Model craftWith(const std::vector<std::string>& effects) {
  Model model = tinyWhoover();
  for (const std::string& name : effects)
    for (const auto& [parameter, value] : kEffects.at(name))
      model = withValues(model, {{name + "." + parameter, value}});
  return model;
}

/// A parameter of the model, or what it is without the effect.
double valueOr(const Model& model, const std::string& effect, const std::string& name, double none) {
  return model.hasEffect(effect) ? model.value(effect + "." + name) : none;
}

/// Body acceleration by the documented equations.
Vector3<double> accelerationOf(const Model& model, const Instant& at) {
  const auto p = [&](const char* effect, const char* name, double none = 0) {
    return valueOr(model, effect, name, none);
  };
  const Body<double>& b = model.body;
  const double c = std::cos(at.psi), s = std::sin(at.psi), u = at.u, v = at.v, r = at.r;
  const double wx = p("wind", "wx"), wy = p("wind", "wy");
  const double ua = u - (c * wx + s * wy), va = v - (-s * wx + c * wy), air = std::hypot(ua, va);

  const double inf = std::numeric_limits<double>::infinity();
  const double all =
      std::exp(-at.t / p("battery_sag", "tau", inf)) * std::max(0.0, 1 - p("thrust_speed_loss", "c") * ua);
  const double power = p("thrust_curve", "p", 1), a = p("thrust_asymmetry", "a");
  const double left = all * b.k * (1 + a) * std::pow(at.left, power);
  const double right = all * b.k * (1 - a) * std::pow(at.right, power);
  const double F = left + right, angle = p("thrust_misalignment", "angle");

  const double lift = at.lift, drag = p("momentum_drag", "q") * lift;
  const double f = p("coulomb_friction", "f") + p("skirt_friction", "f0") * (1 - lift);
  const double n = p("coulomb_friction", "n") + p("skirt_friction", "n0") * (1 - lift);
  const double speed = std::hypot(u, v);
  const double gx = 9.81 * b.m * p("floor_tilt", "sx"), gy = 9.81 * b.m * p("floor_tilt", "sy");
  const double slope_x = c * gx + s * gy, slope_y = -s * gx + c * gy;
  const double xg = p("com_offset", "xg"), yg = p("com_offset", "yg");

  const double arm = std::sqrt(3 * b.I_z / b.m) / 2, V = std::sqrt(ua * ua + va * va + arm * arm * r * r);
  const auto cubic = [&](const std::string& of) {
    const auto d = [&](const char* which) { return p("hull_nonlinear", (of + which).c_str()); };
    return (d("vvv") * va * va * va + d("vvr") * va * va * r + d("vrr") * va * r * r + d("rrr") * r * r * r) /
           V;
  };

  const double X = F * std::cos(angle) - b.X_u * ua - p("quadratic_drag", "cx") * air * ua - drag * ua +
                   p("body_force_bias", "x0") - f * u / speed + slope_x -
                   p("surge_resistance", "xuu") * std::abs(ua) * ua - p("drift_resistance", "xvv") * va * va -
                   p("drift_resistance", "xvr") * va * r - p("drift_resistance", "xrr") * r * r +
                   p("hull_nonlinear", "xvvvv") * std::pow(va, 4) / (V * V);
  const double Y = F * std::sin(angle) - b.Y_v * va - p("quadratic_drag", "cy") * air * va - drag * va +
                   p("body_force_bias", "y0") - f * v / speed + slope_y - p("sway_yaw_damping", "yr") * r +
                   p("differential_side_force", "c") * (left - right) -
                   std::abs(ua) * (p("hull_lift", "yv") * va + p("hull_lift", "yr") * r) - cubic("y");
  const double N = b.l * (left - right) * std::cos(angle) - b.N_r * r -
                   p("quadratic_drag", "cr") * std::abs(r) * r + p("yaw_bias", "n0") -
                   p("sway_yaw_damping", "nv") * va + p("thrust_sway_moment", "c") * F * va -
                   p("directional_yaw_damping", "na") * std::abs(r) -
                   std::abs(ua) * (p("hull_lift", "nv") * va + p("hull_lift", "nr") * r) - cubic("n") -
                   n * (r > 0 ? 1 : -1) + xg * slope_y - yg * slope_x;

  // Fossen 1994, 2.4, term by term
  const double mx = b.m + p("added_mass", "mx"), my = b.m + p("added_mass", "my"), m = b.m;
  Matrix3<double> mass;
  mass << mx, 0, -m * yg, 0, my, m * xg, -m * yg, m * xg, b.I_z + m * (xg * xg + yg * yg);
  const Vector3<double> turning(my * v * r + m * xg * r * r, -mx * u * r + m * yg * r * r,
                                (mx - my) * u * v - m * (xg * u + yg * v) * r);
  return mass.inverse() * (Vector3<double>(X, Y, N) + turning);
}

class Formulas : public testing::TestWithParam<std::vector<std::string>> {};

TEST_P(Formulas, GiveTheAcceleration) {
  const Model model = craftWith(GetParam());
  const Dynamics<double> dynamics(model);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1), input(0.05, 1);
  for (int trial = 0; trial < 50; ++trial) {
    Instant at{10 * input(random),     uniform(random), uniform(random), 4 * uniform(random),
               M_PI * uniform(random), input(random),   input(random),   input(random)};
    // Dry friction passes smoothly through zero, directional damping too.
    at.u += std::copysign(0.5, at.u);
    at.r += std::copysign(4.0, at.r);
    RigidState<double> state;
    state.eta.z() = at.psi;
    state.nu << at.u, at.v, at.r;
    const Vector3<double> found =
        dynamics.derivative(at.t, state, {at.left, at.right}, {at.lift, std::nullopt}).nu;
    const Vector3<double> wanted = accelerationOf(model, at);
    const bool smooth = model.hasEffect("coulomb_friction") || model.hasEffect("skirt_friction") ||
                        model.hasEffect("directional_yaw_damping");
    const double tolerance = smooth ? 3e-3 : 1e-10;
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(found(i), wanted(i), tolerance * (1 + std::abs(wanted(i)))) << i;
  }
}

std::vector<std::vector<std::string>> eachAndAll() {
  std::vector<std::vector<std::string>> found = {{}};
  std::vector<std::string> all, uncoupled;
  for (const auto& [name, values] : kEffects) {
    found.push_back({name});
    all.push_back(name);
    if (name != "com_offset" && name != "added_mass") uncoupled.push_back(name);
  }
  found.push_back(uncoupled);
  found.push_back(all);
  return found;
}

INSTANTIATE_TEST_SUITE_P(All, Formulas, testing::ValuesIn(eachAndAll()), [](const auto& test) {
  const std::size_t count = test.param.size();
  if (count < 2) return count ? test.param[0] : std::string("none");
  return (count == kEffects.size() ? "all" : "some") + std::to_string(count);
});

TEST(DryFriction, IsOddAndPassesThroughZero) {
  for (const char* name : {"coulomb_friction", "skirt_friction"}) {
    const Dynamics<double> with(craftWith({name})), without(craftWith({}));
    const auto friction = [&](double along, double turn) {
      RigidState<double> state;
      state.nu << 0.6 * along, 0.8 * along, turn;
      return Vector3<double>(with.derivative(0, state, {0, 0}, {0.5, std::nullopt}).nu -
                             without.derivative(0, state, {0, 0}, {0.5, std::nullopt}).nu);
    };
    EXPECT_EQ(friction(0, 0).norm(), 0) << name;
    Vector3<double> before = Vector3<double>::Zero();
    for (double speed : {1e-3, 5e-3, 1e-2, 3e-2, 0.1, 1.0}) {
      const Vector3<double> now = friction(speed, 10 * speed);
      EXPECT_LT((now + friction(-speed, -10 * speed)).norm(), 1e-12);
      EXPECT_LT(now.x(), before.x()) << "it grows with the speed";
      EXPECT_LT(now.z(), before.z());
      before = now;
    }
    // Half of it is there at a centimetre a second.
    EXPECT_GT(friction(0.01, 0.1).head<2>().norm(), 0.5 * before.head<2>().norm());
    EXPECT_LT(friction(0.001, 0.01).head<2>().norm(), 0.2 * before.head<2>().norm());
    EXPECT_GT(std::abs(friction(0.01, 0.1).z()), 0.5 * std::abs(before.z()));
    EXPECT_LT(std::abs(friction(0.001, 0.01).z()), 0.2 * std::abs(before.z()));
  }
}

}  // namespace formulas_test
}  // namespace ground
