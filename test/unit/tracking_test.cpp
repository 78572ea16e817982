// References and the tracking law of thesis 4.2.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "ground/control/tracking_law.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"

namespace ground {
namespace {

Model tinyWhoover() { return loadModel("cfg/hovercraft/tiny_whoover.yaml"); }
Model mvwt() { return loadModel("cfg/hovercraft/mvwt.yaml"); }

TrackingGains mvwtGains() {  // (4.10)
  TrackingGains gains;
  gains.k_e = 4;
  gains.k_z = 0.6;
  gains.k_phi_1 = gains.k_phi_2 = 1.5;
  return gains;
}

class Reference : public testing::TestWithParam<std::pair<const char*, ReferencePtr>> {};

TEST_P(Reference, DerivativesAgreeWithFiniteDifferences) {
  const ReferenceTrajectory& reference = *GetParam().second;
  const double h = 1e-4;
  for (double t = 0.013; t < reference.extent() - h; t += reference.extent() / 37) {
    const ReferencePoint a = reference.at(t - h), b = reference.at(t + h), at = reference.at(t);
    EXPECT_LT(((b.p - a.p) / (2 * h) - at.p_dot).norm(), 1e-6);
    EXPECT_LT(((b.p_dot - a.p_dot) / (2 * h) - at.p_ddot).norm(), 1e-6);
    EXPECT_LT(((b.p_ddot - a.p_ddot) / (2 * h) - at.p_dddot).norm(), 1e-6);
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, Reference,
    testing::Values(std::make_pair("circle", makeCircle({0.5, -1}, 2.0, 0.6)),
                    std::make_pair("line", makeLine({0, 0}, {2.5, 2.5}, 0.707, true)),
                    std::make_pair("sharp_line", makeLine({0, 0}, {2.5, 2.5}, 0.707, false)),
                    std::make_pair("rhodonea", makeRhodonea({0.1, 0.2}, 1.5, 1.5, 0.4)),
                    std::make_pair("sinusoid", makeSinusoid({0, 0}, 0.5, 1.0, 0.6))),
    [](const auto& info) { return info.param.first; });

TEST(References, SmoothLineStartsAndEndsAtRestWithItsPeakSpeed) {
  const ReferencePtr line = makeLine({-1, 0}, {2, 1}, 0.8, true);
  double peak = 0;
  for (double t = 0; t < line->extent(); t += 0.001)
    peak = std::max(peak, line->at(t).p_dot.norm());
  EXPECT_NEAR(peak, 0.8, 1e-5);
  for (double t : {0.0, line->extent(), line->extent() + 5}) {
    const ReferencePoint at = line->at(t);
    EXPECT_LT(at.p_dot.norm() + at.p_ddot.norm() + at.p_dddot.norm(), 1e-12);
  }
  EXPECT_LT((line->at(100).p - Vector2<double>(2, 1)).norm(), 1e-12);
  EXPECT_NEAR((makeLine({0, 0}, {3, 4}, 2, false)->at(1.25).p - Vector2<double>(1.5, 2)).norm(), 0,
              1e-12);
}

TEST(References, RhodoneaIsTheRose) {
  const double a = 1.5, k = 1.5, w = 0.4;
  for (double t : {0.0, 1.0, 7.7}) {
    const double s = w * t, radius = a * std::cos(k * s);
    const Vector2<double> rose(radius * std::cos(s), radius * std::sin(s));
    EXPECT_LT((makeRhodonea({0, 0}, a, k, w)->at(t).p - rose).norm(), 1e-12);
  }
}

TEST(References, RefusesNonsense) {
  EXPECT_THROW(makeCircle({0, 0}, 0, 1), std::invalid_argument);
  EXPECT_THROW(makeCircle({0, 0}, 1, 0), std::invalid_argument);
  EXPECT_THROW(makeLine({1, 1}, {1, 1}, 1, true), std::invalid_argument);
  EXPECT_THROW(makeLine({1, 1}, {2, 1}, 0, true), std::invalid_argument);
}

TEST(TrackingLaw, AlphaDotIsTheDerivativeOfAlphaAlongTheMotion) {
  // Along motions under the law's own force, which has to be inside the thrusters' bounds: the law
  // then knows the true acceleration.
  Model model = mvwt();
  model.setValue("X_u", model.body.Y_v);
  const TrackingLaw law(model.body);
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  const ReferencePtr reference = makeSinusoid({0.1, 0}, 0.3, 1.0, 0.3);
  TrackingGains gains = mvwtGains();
  gains.k_phi_2 = 0.7;
  int checked = 0;
  for (int trial = 0; trial < 300; ++trial) {
    gains.delta_2 = trial % 2 ? 0.004 : 0.0;
    const double t = 1.0 + 0.1 * trial;
    RigidState<double> state;
    const ReferencePoint at = reference->at(t);
    state.eta << at.p.x() + 0.01 * normal(random), at.p.y() + 0.01 * normal(random), normal(random);
    state.nu.head<2>() = worldToBody<double>(state.eta.z(), at.p_dot) +
                         0.05 * Vector2<double>(normal(random), normal(random));
    state.nu.z() = 0.3 * normal(random);
    const auto out = law.run(state, at, gains);
    if (out.force <= 0 || out.force >= 9) continue;
    ++checked;
    // motion by Taylor's formula: pose and velocity with the law's force, any yaw acceleration
    const double yaw_acceleration = normal(random), r = state.nu.z();
    const auto alpha = [&](double dt) {
      RigidState<double> moved;
      const Vector2<double> v = state.nu.head<2>();
      const Vector2<double> v_dot(
          out.force / model.body.m + r * v.y() - model.body.Y_v / model.body.m * v.x(),
          -r * v.x() - model.body.Y_v / model.body.m * v.y());
      const Vector2<double> p_dot = bodyToWorld<double>(state.eta.z(), v);
      moved.eta << state.eta.x() + dt * p_dot.x(), state.eta.y() + dt * p_dot.y(),
          state.eta.z() + dt * r;
      moved.nu << v + dt * v_dot, r + dt * yaw_acceleration;
      return law.run(moved, reference->at(t + dt), gains).alpha;
    };
    const auto central = [&](double h) {
      return Vector2<double>((alpha(h) - alpha(-h)) / (2 * h));
    };
    const double h = 2e-4;  // Richardson's extrapolation of central differences
    const Vector2<double> finite = (4 * central(h / 2) - central(h)) / 3;
    EXPECT_LT((finite - out.alpha_dot).norm(), 1e-9 * std::max(1.0, out.alpha_dot.norm())) << trial;
  }
  EXPECT_GT(checked, 50);
}

struct Tracked {
  double last_saturation = 0, rms = 0, largest = 0;
  Vector2<double> inputs;
  double error = 0;
};

/// Closed loop at 50 Hz; the error counts from `settled` on.
Tracked track(const Model& model, const TrackingGains& gains, const ReferenceTrajectory& reference,
              const RigidState<double>& initial, double duration, double settled) {
  const TrackingLaw law(model.body);
  const Dynamics<double> dynamics(model);
  InputSequence inputs;
  Simulation<double> simulation(dynamics, inputs, initial, 0);
  Tracked run;
  int samples = 0;
  for (int i = 0; i < duration * 50; ++i) {
    const double t = i / 50.0;
    simulation.advance(t);
    const auto out = law.run(simulation.state(), reference.at(t), gains);
    run.error = out.error.norm();
    run.inputs = out.inputs;
    if (out.saturated()) run.last_saturation = t;
    if (t >= settled) {
      run.rms += run.error * run.error;
      run.largest = std::max(run.largest, run.error);
      ++samples;
    }
    inputs.add(t, out.inputs.x(), out.inputs.y(), 1);
  }
  run.rms = std::sqrt(run.rms / samples);
  return run;
}

TEST(TrackingLaw, TracksTheCircleWithTheMvwtAsInTheThesis) {
  const Tracked run = track(mvwt(), mvwtGains(), *makeCircle({0, 0}, 1.5, 0.3), {}, 100, 60);
  EXPECT_NEAR(run.error, 11.588e-3, 0.01e-3);
  EXPECT_NEAR(run.inputs.x(), 1.5704, 1e-3);
  EXPECT_NEAR(run.inputs.y(), 0.5704, 1e-3);
  EXPECT_NEAR(run.last_saturation, 2.3, 0.1);
}

TEST(TrackingLaw, TracksTheSinusoidWithTheMvwt) {
  const Tracked run = track(mvwt(), mvwtGains(), *makeSinusoid({0, 0}, 0.3, 1.0, 0.3), {}, 100, 40);
  EXPECT_NEAR(run.rms, 12.0e-3, 0.3e-3);
}

TEST(TrackingLaw, TracksTheCircleWithTheTinyWhooverWithinTheThesisBand) {
  // Gains (4.11) saturate all the time and the loop is chaotic: only distributions can be compared.
  Model model = tinyWhoover();
  model.setValue("X_u", model.body.Y_v);  // table 4.1 has one damping for surge and sway
  std::mt19937 random(11);
  std::normal_distribution<double> normal(0, 0.02);
  std::vector<double> errors;
  for (int trial = 0; trial < 101; ++trial) {
    RigidState<double> start;
    for (int i = 0; i < 3; ++i) {
      start.eta(i) = normal(random);
      start.nu(i) = normal(random);
    }
    errors.push_back(
        track(model, TrackingGains(), *makeCircle({0, 0}, 2.0, 0.6), start, 60, 20).rms);
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_NEAR(errors[5], 0.36, 0.06);
  EXPECT_NEAR(errors[50], 0.44, 0.06);
  EXPECT_NEAR(errors[95], 0.52, 0.08);
}

TEST(TrackingGains, RefuseNonsense) {
  EXPECT_EQ(TrackingGains().validate(), "");
  TrackingGains gains;
  gains.delta_1 = 0;
  EXPECT_NE(gains.validate(), "");
  gains = {};
  gains.k_e = std::nan("");
  EXPECT_NE(gains.validate(), "");
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
