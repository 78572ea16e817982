// References and the tracking law of thesis 4.2.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iomanip>
#include <random>
#include <sstream>

#include "../crafts.h"
#include "ground/control/controllers.h"
#include "ground/control/feasibility.h"
#include "ground/control/tracking_law.h"
#include "ground/control/tracking_watch.h"
#include "ground/model/simulation.h"

namespace ground {
namespace tracking_test {

Model mvwt() { return loadModel("cfg/hovercraft/mvwt.yaml"); }

TrackingGains mvwtGains() {  // (4.10)
  TrackingGains gains;
  gains.k_e = 4;
  gains.k_z = 0.6;
  gains.k_phi_1 = gains.k_phi_2 = 1.5;
  return gains;
}

std::vector<Vector2<double>> corners() {
  return {{0, 0}, {1, 0.2}, {1.8, 1}, {1.2, 2}, {0, 2.1}, {-0.8, 1.2}};
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
    testing::Values(
        std::make_pair("circle", makeCircle({0.5, -1}, 2.0, 0.6)),
        std::make_pair("line", makeLine({0, 0}, {2.5, 2.5}, 0.707, true)),
        std::make_pair("sharp_line", makeLine({0, 0}, {2.5, 2.5}, 0.707, false)),
        std::make_pair("rhodonea", makeRhodonea({0.1, 0.2}, 1.5, 1.5, 0.4)),
        std::make_pair("sinusoid", makeSinusoid({0, 0}, 0.5, 1.0, 0.6)),
        std::make_pair(
            "spline",
            makeSpline({0, 1, 2.5, 3, 4.2, 6, 7},
                       {{0, 0}, {0.3, 0.1}, {0.9, 0.5}, {1, 0.7}, {1, 1.2}, {0.3, 1.5}, {-0.2, 1.4}})),
        std::make_pair("waypoints", makeWaypoints(corners(), 0.4, true)),
        std::make_pair("sharp_waypoints", makeWaypoints(corners(), 0.4, false))),
    [](const auto& test) { return test.param.first; });

TEST(References, SplinesPassTheirPointsAndStayAtTheLast) {
  const std::vector<double> times = {0, 0.7, 1.9, 2.2, 4, 5, 6.5};
  std::vector<Vector2<double>> points = corners();
  points.emplace_back(-0.5, 0.1);
  const ReferencePtr spline = makeSpline(times, points);
  for (std::size_t i = 0; i < times.size(); ++i)
    EXPECT_LT((spline->at(times[i]).p - points[i]).norm(), 1e-12);
  EXPECT_LT((spline->at(100).p - points.back()).norm(), 1e-12);
  EXPECT_EQ(spline->at(100).p_dot.norm(), 0);
  // With few points the degree is lower; two make a straight line.
  const ReferencePtr two = makeSpline({0, 2}, {{0, 0}, {1, 3}});
  EXPECT_LT((two->at(0.5).p - Vector2<double>(0.25, 0.75)).norm(), 1e-12);
  EXPECT_LT((two->at(0.5).p_dot - Vector2<double>(0.5, 1.5)).norm(), 1e-12);
  EXPECT_EQ(two->at(0.5).p_dddot.norm(), 0);
}

/// Writes a file with the text; returns its path.
std::string file(const std::string& text) {
  const std::string path = testing::TempDir() + "/ground_reference.csv";
  std::ofstream(path) << text;
  return path;
}

TEST(References, FilesAreReadOrRefusedByLine) {
  const ReferencePtr timed = readReference(file("time,x,y\n5,0,0\n6,1,0\n7,2,1\n"), {1, 0}, 1, true);
  EXPECT_LT((timed->at(1).p - Vector2<double>(2, 0)).norm(), 1e-12);
  EXPECT_EQ(timed->extent(), 2);
  const ReferencePtr way = readReference(file("x,y\n0,0\n3,4\n"), {0, 0}, 2, false);
  EXPECT_LT((way->at(1.25).p - Vector2<double>(1.5, 2)).norm(), 1e-12);
  const std::vector<std::pair<std::string, std::string>> bad = {
      {"a,b\n1,2\n", "line 1"},       {"x,y\n1,2\nfour,5\n", "line 3"},
      {"x,y\n1,2\n1,2\n", "line 3"},  {"time,x,y\n0,1,2\n0,2,3\n", "times must ascend"},
      {"x,y\n1,2\n", "at least two"}, {"x,y\n1,nan\n4,5\n", "line 2"},
      {"x,y\n1,2\n3 4\n", "line 3"},  {"x,y\n1,2\n0x10,4\n", "line 3"},
      {"x,y\n1,2\n,\n", "line 3"}};
  for (const auto& [text, why] : bad) {
    const std::string said = refusal([&, &text = text] { readReference(file(text), {0, 0}, 1, true); });
    EXPECT_NE(said.find(why), std::string::npos) << text << said;
  }
  EXPECT_THROW(readReference("/nowhere.csv", {0, 0}, 1, true), std::runtime_error);
}

/// A file of points on a circle, 100 a second.
std::string circleFile(int count) {
  std::ostringstream text;
  text << std::setprecision(10) << "time,x,y\n";
  for (int i = 0; i < count; ++i)
    text << 0.01 * i << ',' << std::cos(0.004 * i) << ',' << std::sin(0.004 * i) << '\n';
  return file(text.str());
}

TEST(References, ALargeFileIsAsAccurateAsASmallOne) {
  const ReferencePtr circle = makeCircle({0, 0}, 1, 0.4);
  for (int count : {300, 300000}) {
    const ReferencePtr spline = readReference(circleFile(count), {0, 0}, 1, true);
    EXPECT_NEAR(spline->extent(), 0.01 * (count - 1), 1e-6);
    for (double share : {0.1, 0.4, 0.999}) {
      const double t = share * spline->extent();
      EXPECT_LT((spline->at(t).p - circle->at(t).p).norm(), 1e-8) << count << ' ' << t;
      EXPECT_LT((spline->at(t).p_dot - circle->at(t).p_dot).norm(), 1e-5) << count << ' ' << t;
    }
  }
}

Model withEffect(const std::string& name, const std::vector<double>& values) {
  Model model = tinyWhoover();
  model.addEffect(makeEffect(name));
  model.effects.back().values = values;
  return model;
}

TEST(EffectUse, TrajectoryTrackingNamesTheEffectsItDoesNotUse) {
  EXPECT_EQ(effectUse("TrajectoryTracking", tinyWhoover()).remark(), "");
  Model model = withValues(tinyWhoover(), {{"motor_lag.tau", 0.05}, {"yaw_bias.n0", 1e-5}});
  model.addEffect(makeEffect("wind"));  // neutral: no effect
  const EffectUse use = effectUse("TrajectoryTracking", model);
  EXPECT_EQ(use.remark(), "does not use motor_lag, yaw_bias");
  EXPECT_TRUE(use.used.empty());
  EXPECT_EQ(use.refusal, "");
  EXPECT_NE(makeController(model, {}), nullptr);
}

TEST(EffectUse, TrajectoryTrackingRefusesModelsThatMisleadIt) {
  const struct {
    const char* effect;
    std::vector<double> accepted, refused;
    const char* why;
  } cases[] = {{"heading_offset", {-0.04}, {-0.06}, "heading is off by 0.06 rad"},
               {"marker_offset", {0.006, -0.006}, {0.008, -0.008}, "point is off by 0.0113 m"},
               {"input_delay", {0.015}, {0.03}, "late by 0.03 s, and more than 0.02 s"}};
  for (const auto& [effect, accepted, refused, why] : cases) {
    const EffectUse use = effectUse("TrajectoryTracking", withEffect(effect, accepted));
    EXPECT_EQ(use.refusal, "");
    EXPECT_EQ(use.remark(), std::string("does not use ") + effect);
    const Model model = withEffect(effect, refused);
    const std::string refusal = effectUse("TrajectoryTracking", model).refusal;
    EXPECT_NE(refusal.find(why), std::string::npos) << refusal;
    EXPECT_NE(refusal.find("use ModelPredictive"), std::string::npos) << refusal;
    EXPECT_THROW(makeController(model, {}), std::invalid_argument);
    ControllerChoice predictive;
    predictive.kind = "ModelPredictive";
    EXPECT_NE(makeController(model, predictive), nullptr);
    EXPECT_EQ(effectUse("ModelPredictive", model).remark(), std::string("uses ") + effect);
  }
}

/// Time at which a watch stops a craft with an error(time), and its reason; -1 if never.
template <typename Error>
std::pair<double, std::string> stops(TrackingWatch& watch, Error error, double end, double begin = 0,
                                     double step = 0.02) {
  for (int i = 0; begin + i * step < end; ++i) {
    const double t = begin + i * step;
    const std::string reason = watch.look(t, error(t));
    if (!reason.empty()) return {t, reason};
  }
  return {-1, ""};
}

TEST(TrackingWatch, StopsAfterASecondBeyondMaxError) {
  TrackingWatch watch;
  watch.setMaxError(0.5);
  const auto [time, reason] = stops(
      watch, [](double t) { return t < 5 ? 0.1 : 0.83; }, 20);
  EXPECT_NEAR(time, 6, 0.05);
  EXPECT_EQ(reason, "0.83 m from the reference for 1 s, more than max_error 0.5 m");
  watch.restart();
  const auto bursts = [](double t) { return std::fmod(t, 2) < 1.1 ? 0.1 : 0.83; };
  EXPECT_EQ(stops(watch, bursts, 60).first, -1) << "an error that does not last";
}

TEST(TrackingWatch, LeavesTimeToArrive) {
  TrackingWatch watch;
  watch.setMaxError(0.5);
  const auto approach = [](double t) { return std::max(0.05, 3 + t - 0.5 * t * t); };
  EXPECT_EQ(stops(watch, approach, 100).first, -1);
  // A reference that starts suddenly moves ahead of the craft before it has arrived.
  watch.restart();
  const auto sudden = [](double t) { return t < 3 ? 0.6 * t : 0.1; };
  EXPECT_EQ(stops(watch, sudden, 10).first, -1);
  // A restart allows another approach.
  watch.restart();
  EXPECT_EQ(stops(watch, approach, 30).first, -1);
}

TEST(TrackingWatch, StopsACraftThatNeverArrives) {
  TrackingWatch watch;
  watch.setMaxError(0.5);
  const auto [late, never] = stops(
      watch, [](double) { return 1.3; }, 100);
  EXPECT_NEAR(late, 20, 0.1);
  EXPECT_EQ(never, "1.30 m from the reference, and never within max_error 0.5 m for 1 s in 20 s");
}

TEST(Feasibility, AgreesWithTheMotionOfTheModel) {
  // The model can follow its own motion under inputs within their bounds.
  const Model model = tinyWhoover();
  const Dynamics<double> dynamics(model);
  InputSequence inputs;
  RigidState<double> start;
  start.nu.x() = 0.5;
  Simulation<double> simulation(dynamics, inputs, start, 0);
  std::vector<double> times;
  std::vector<Vector2<double>> points;
  for (int i = 0; i <= 800; ++i) {
    const double t = 0.01 * i;
    simulation.advance(t);
    times.push_back(t);
    points.push_back(simulation.state().eta.head<2>());
    inputs.add(t, 0.55 + 0.05 * std::sin(1.1 * t), 0.55 + 0.05 * std::sin(0.9 * t + 0.5), 1);
  }
  EXPECT_EQ(infeasibility(*makeSpline(times, points), model), "");
}

TEST(TrackingLaw, AlphaDotIsTheDerivativeOfAlphaAlongTheMotion) {
  // The motions have the law's own force, which must be within the bounds of the thrusters: then
  // the law knows the true acceleration.
  Model model = mvwt();
  model.setValue("X_u", model.body.Y_v);
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  const ReferencePtr reference = makeSinusoid({0.1, 0}, 0.3, 1.0, 0.3);
  TrackingGains gains = mvwtGains();
  gains.k_phi_2 = 0.7;
  int checked = 0;
  for (int trial = 0; trial < 300; ++trial) {
    gains.delta_2 = trial % 2 ? 0.004 : 0.0;
    const BacksteppingControl law(model, gains);
    const double t = 1.0 + 0.1 * trial;
    RigidState<double> state;
    const ReferencePoint at = reference->at(t);
    state.eta << at.p.x() + 0.01 * normal(random), at.p.y() + 0.01 * normal(random), normal(random);
    state.nu.head<2>() =
        worldToBody<double>(state.eta.z(), at.p_dot) + 0.05 * Vector2<double>(normal(random), normal(random));
    state.nu.z() = 0.3 * normal(random);
    const auto out = law.run(state, at);
    if (out.force <= 0 || out.force >= 9) continue;
    ++checked;
    // motion by Taylor's formula, with the law's force and any yaw acceleration
    const double yaw_acceleration = normal(random), r = state.nu.z();
    const auto alpha = [&](double dt) {
      RigidState<double> moved;
      const Vector2<double> v = state.nu.head<2>();
      const Vector2<double> v_dot(
          out.force / model.body.m + r * v.y() - model.body.Y_v / model.body.m * v.x(),
          -r * v.x() - model.body.Y_v / model.body.m * v.y());
      const Vector2<double> p_dot = bodyToWorld<double>(state.eta.z(), v);
      moved.eta << state.eta.x() + dt * p_dot.x(), state.eta.y() + dt * p_dot.y(), state.eta.z() + dt * r;
      moved.nu << v + dt * v_dot, r + dt * yaw_acceleration;
      return law.run(moved, reference->at(t + dt)).alpha;
    };
    const auto central = [&](double h) { return Vector2<double>((alpha(h) - alpha(-h)) / (2 * h)); };
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
  const BacksteppingControl law(model, gains);
  const Dynamics<double> dynamics(model);
  InputSequence inputs;
  Simulation<double> simulation(dynamics, inputs, initial, 0);
  Tracked run;
  int samples = 0;
  for (int i = 0; i < duration * 50; ++i) {
    const double t = i / 50.0;
    simulation.advance(t);
    const auto out = law.run(simulation.state(), reference.at(t));
    run.error = out.error.norm();
    run.inputs = asVector(out.inputs);
    if (out.wanted != out.inputs) run.last_saturation = t;
    if (t >= settled) {
      run.rms += run.error * run.error;
      run.largest = std::max(run.largest, run.error);
      ++samples;
    }
    inputs.add(t, out.inputs, 1);
  }
  run.rms = std::sqrt(run.rms / samples);
  return run;
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
    errors.push_back(track(model, TrackingGains(), *makeCircle({0, 0}, 2.0, 0.6), start, 60, 20).rms);
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_NEAR(errors[5], 0.36, 0.06);
  EXPECT_NEAR(errors[50], 0.44, 0.06);
  EXPECT_NEAR(errors[95], 0.52, 0.08);
}

TEST(ReferenceTable, EveryKindIsMadeAndUsesExactlyItsParameters) {
  for (const ReferenceInfo& info : referenceTable()) {
    if (info.name == "file") continue;
    ReferenceParams params;
    params.kind = info.name;
    const ReferencePtr made = makeReference(params);
    EXPECT_EQ(info.ends, made->at(1000).p_dot.norm() == 0) << info.name;
    for (const auto& one : ReferenceParams::table()) {
      ReferenceParams changed = params;
      if (one.type == "double") one.set(changed, one.low + 0.4 * (one.high - one.low));
      if (one.type == "bool") one.set(changed, !std::get<bool>(one.standard));
      if (one.type == "str") one.set(changed, std::string("way.csv"));
      EXPECT_FALSE(changed == params) << one.name;
      const bool takes = std::find(info.takes.begin(), info.takes.end(), one.name) != info.takes.end();
      const ReferencePtr other = makeReference(changed);
      EXPECT_EQ(other->at(0.3).p != made->at(0.3).p, takes) << info.name << " " << one.name;
      if (one.type != "double") continue;
      one.set(changed, one.high + 1);
      if (takes) {
        EXPECT_THROW(makeReference(changed), std::invalid_argument) << info.name << one.name;
      } else {
        EXPECT_NO_THROW(makeReference(changed)) << info.name << one.name;
      }
    }
  }
  EXPECT_TRUE(ReferenceParams() == ReferenceParams());
}

}  // namespace tracking_test
}  // namespace ground
