// References and the tracking law of thesis 4.2.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iomanip>
#include <limits>
#include <random>
#include <sstream>

#include "ground/control/controllers.h"
#include "ground/control/feasibility.h"
#include "ground/control/tracking_law.h"
#include "ground/control/tracking_watch.h"
#include "ground/model/effect_registry.h"
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
    testing::Values(std::make_pair("circle", makeCircle({0.5, -1}, 2.0, 0.6)),
                    std::make_pair("line", makeLine({0, 0}, {2.5, 2.5}, 0.707, true)),
                    std::make_pair("sharp_line", makeLine({0, 0}, {2.5, 2.5}, 0.707, false)),
                    std::make_pair("rhodonea", makeRhodonea({0.1, 0.2}, 1.5, 1.5, 0.4)),
                    std::make_pair("sinusoid", makeSinusoid({0, 0}, 0.5, 1.0, 0.6)),
                    std::make_pair("spline", makeSpline({0, 1, 2.5, 3, 4.2, 6, 7}, {{0, 0},
                                                                                    {0.3, 0.1},
                                                                                    {0.9, 0.5},
                                                                                    {1, 0.7},
                                                                                    {1, 1.2},
                                                                                    {0.3, 1.5},
                                                                                    {-0.2, 1.4}})),
                    std::make_pair("waypoints", makeWaypoints(corners(), 0.4, true)),
                    std::make_pair("sharp_waypoints", makeWaypoints(corners(), 0.4, false))),
    [](const auto& test) { return test.param.first; });

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

TEST(References, TheExtentIsThePeriodOrTheEnd) {
  const ReferencePtr circle = makeCircle({0.5, -1}, 2, -0.6),
                     rose = makeRhodonea({0, 0}, 1, 1.5, 0.4),
                     wave = makeSinusoid({0.3, -0.2}, 0.5, 0.8, -0.6);
  for (const ReferencePtr& reference : {circle, rose}) {
    const double period = reference->extent();
    for (const double t : {0.4, 3.0}) {
      EXPECT_LT((reference->at(t + period).p - reference->at(t).p).norm(), 1e-9);
      EXPECT_GT((reference->at(t + 0.5 * period).p - reference->at(t).p).norm(), 0.1);
    }
  }
  EXPECT_LT((circle->at(0).p - Vector2<double>(2.5, -1)).norm(), 1e-12);
  EXPECT_NEAR((circle->at(1.7).p - Vector2<double>(0.5, -1)).norm(), 2, 1e-12);
  // Two waves: it returns to its line, as after one of them.
  for (const double waves : {1.0, 2.0}) {
    const double t = 0.5 * waves * wave->extent();
    EXPECT_LT((wave->at(t).p - Vector2<double>(0.3 + 0.5 * t, -0.2)).norm(), 1e-9);
  }
  EXPECT_NEAR(wave->at(wave->extent() / 8).p.y(), -0.2 - 0.8, 1e-9);
  EXPECT_NEAR(makeLine({0, 0}, {3, 4}, 2, false)->extent(), 2.5, 1e-12);
  // A smooth pace is the same forwards and backwards.
  const ReferencePtr line = makeLine({0, 0}, {3, 4}, 2, true);
  for (double t = 0; t < line->extent(); t += 0.1) {
    const Vector2<double> both = line->at(t).p + line->at(line->extent() - t).p;
    EXPECT_LT((both - Vector2<double>(3, 4)).norm(), 1e-12);
  }
}

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

TEST(References, ASplineThroughACircleIsTheCircle) {
  const ReferencePtr circle = makeCircle({0.5, 0}, 1.2, 0.7);
  std::vector<double> times;
  std::vector<Vector2<double>> points;
  for (int i = 0; i <= 2000; ++i) {
    times.push_back(0.01 * i);
    points.push_back(circle->at(times.back()).p);
  }
  const ReferencePtr spline = makeSpline(times, points);
  for (double t : {1.234, 7.777, 15.0}) {
    EXPECT_LT((spline->at(t).p - circle->at(t).p).norm(), 1e-10);
    EXPECT_LT((spline->at(t).p_ddot - circle->at(t).p_ddot).norm(), 1e-6);
    EXPECT_LT((spline->at(t).p_dddot - circle->at(t).p_dddot).norm(), 1e-4);
  }
}

TEST(References, WaypointsArePassedAtTheGivenSpeed) {
  const ReferencePtr way = makeWaypoints(corners(), 0.4, true);
  for (const Vector2<double>& corner : corners()) {
    double nearest = 10;
    for (double t = 0; t <= way->extent(); t += 0.002)
      nearest = std::min(nearest, (way->at(t).p - corner).norm());
    EXPECT_LT(nearest, 1e-3);
  }
  double peak = 0;
  for (double t = 0; t < way->extent(); t += 0.001) peak = std::max(peak, way->at(t).p_dot.norm());
  EXPECT_NEAR(peak, 0.4, 0.1);  // the path is slightly longer than the polygon
  EXPECT_LT(way->at(0).p_dot.norm() + way->at(way->extent()).p_dot.norm(), 1e-9);
}

/// Writes a file with the text; returns its path.
std::string file(const std::string& text) {
  const std::string path = testing::TempDir() + "/ground_reference.csv";
  std::ofstream(path) << text;
  return path;
}

TEST(References, FilesAreReadOrRefusedByLine) {
  const ReferencePtr timed =
      readReference(file("time,x,y\n5,0,0\n6,1,0\n7,2,1\n"), {1, 0}, 1, true);
  EXPECT_LT((timed->at(1).p - Vector2<double>(2, 0)).norm(), 1e-12);
  EXPECT_EQ(timed->extent(), 2);
  const ReferencePtr way = readReference(file("x,y\n0,0\n3,4\n"), {0, 0}, 2, false);
  EXPECT_LT((way->at(1.25).p - Vector2<double>(1.5, 2)).norm(), 1e-12);
  const std::vector<std::pair<std::string, std::string>> bad = {
      {"a,b\n1,2\n", "line 1"},
      {"x,y\n1,2\nfour,5\n", "line 3"},
      {"x,y\n1,2\n1,2\n", "line 3"},
      {"time,x,y\n0,1,2\n0,2,3\n", "times must ascend"},
      {"x,y\n1,2\n", "at least two"},
      {"x,y\n1,2,3\n4,5,6\n", "line 2"},
      {"x,y\n1,nan\n4,5\n", "line 2"},
      {"x,y\n1,2\n,3,4\n", "line 3"},
      {"x,y\n1,2\n3 4\n", "line 3"},
      {"x,y\n1,2\n8e84,4\n", "line 3"},
      {"time,x,y\n0,1,2\n1,,3\n", "line 3"},
      {"x,y\n1,2\n0x10,4\n", "line 3"},
      {"x,y\n1,2\n3 3,4\n", "line 3"},
      {"x,y\n1,2\n,\n", "line 3"}};
  for (const auto& [text, why] : bad) {
    try {
      readReference(file(text), {0, 0}, 1, true);
      ADD_FAILURE() << text;
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    }
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

TEST(References, AFileBeyondTheLimitIsRefusedWithTheLimit) {
  std::string text = "x,y\n";
  for (int i = 0; i <= 500000; ++i) text += "0,0\n1,0\n";
  try {
    readReference(file(text), {0, 0}, 1, true);
    ADD_FAILURE();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("line 1000002: it has more than 1000000 points"),
              std::string::npos)
        << error.what();
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
  Model model = withEffect("motor_lag", {0.05});
  model.addEffect(makeEffect("wind"));  // neutral: no effect
  model.addEffect(makeEffect("yaw_bias"));
  model.setValue("yaw_bias.n0", 1e-5);
  const EffectUse use = effectUse("TrajectoryTracking", model);
  EXPECT_EQ(use.remark(), "does not use motor_lag, yaw_bias");
  EXPECT_TRUE(use.used.empty());
  EXPECT_EQ(use.refusal, "");
  EXPECT_NE(makeController(model, {}), nullptr);
  EXPECT_EQ(effectUse("OpenLoopPRBS", model).remark(), "");
}

TEST(EffectUse, ModelPredictiveRefusesMoreStatesThanItFollows) {
  Model model = withEffect("motor_lag", {0.05});
  const auto add = [&](const std::string& name) {
    model = withEffect(model,
                       "name: " + name + "\nstates: {p: \"-p\", q: \"p - q\"}\n" +
                           "expression: {X: c*q}\nparameters: {c: {value: 0.1, unit: N}}\n",
                       name);
  };
  add("slow");
  ControllerChoice predictive;
  predictive.kind = "ModelPredictive";
  EXPECT_EQ(effectUse("ModelPredictive", model).refusal, "");
  EXPECT_NE(makeController(model, predictive), nullptr);
  add("slower");
  const EffectUse use = effectUse("ModelPredictive", model);
  EXPECT_NE(use.refusal.find("have 6 states, and the controller follows 4 at most"),
            std::string::npos)
      << use.refusal;
  EXPECT_THROW(makeController(model, predictive), std::invalid_argument);
  EXPECT_EQ(effectUse("TrajectoryTracking", model).remark(),
            "does not use motor_lag, slow, slower");
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
std::pair<double, std::string> stops(TrackingWatch& watch, Error error, double end,
                                     double begin = 0, double step = 0.02) {
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
  const auto [time, reason] = stops(watch, [](double t) { return t < 5 ? 0.1 : 0.83; }, 20);
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
  EXPECT_TRUE(watch.arrived());
  // A reference that starts suddenly moves ahead of the craft before it has arrived.
  watch.restart();
  const auto sudden = [](double t) { return t < 3 ? 0.6 * t : 0.1; };
  EXPECT_EQ(stops(watch, sudden, 10).first, -1);
  // A restart allows another approach.
  watch.restart();
  EXPECT_FALSE(watch.arrived());
  EXPECT_EQ(stops(watch, approach, 30).first, -1);
}

TEST(TrackingWatch, StopsACraftThatNeverArrivesOrDrivesAway) {
  TrackingWatch watch;
  watch.setMaxError(0.5);
  const auto [late, never] = stops(watch, [](double) { return 1.3; }, 100);
  EXPECT_NEAR(late, 20, 0.1);
  EXPECT_EQ(never, "1.30 m from the reference, and never within max_error 0.5 m for 1 s in 20 s");
  watch.restart();
  const auto [early, away] = stops(watch, [](double t) { return 1 + t; }, 100);
  EXPECT_NEAR(early, 2.5 + 1, 0.1);
  EXPECT_NE(away.find("and 1.00 m at the start: it drives away from it"), std::string::npos);
  watch.restart();
  EXPECT_NEAR(stops(watch, [](double) { return NAN; }, 100).first, 1, 0.05);
}

TEST(TrackingWatch, CountsOnlyTheTimeInWhichTheCraftIsSeen) {
  TrackingWatch watch;
  watch.setMaxError(0.5);
  EXPECT_EQ(stops(watch, [](double) { return 0.1; }, 5).first, -1);
  // After a loss of half a second it is seen too far away, and returns within 2.8 s.
  EXPECT_EQ(stops(watch, [](double t) { return t < 8.3 ? 0.7 : 0.1; }, 20, 5.5).first, -1);
  // A mocap at two frames a second does not hide that the craft drives away.
  EXPECT_NEAR(stops(watch, [](double) { return 0.7; }, 60, 20.5, 0.5).first, 20.5 + 2 + 10 * 0.5, 0.6);
}

TEST(TrackingWatch, ALossGivesTimeToCatchUpOnce) {
  TrackingWatch watch;
  watch.setMaxError(0.5);
  EXPECT_EQ(stops(watch, [](double) { return 0.1; }, 5).first, -1);
  // Further losses do not excuse an error that began before them.
  const auto lost = [](double) { return 0.7; };
  EXPECT_EQ(stops(watch, lost, 7.9, 5.5).first, -1);
  EXPECT_NEAR(stops(watch, lost, 20, 8.3).first, 5.5 + 2 + 1 + 0.3, 0.1);
}

TEST(TrackingWatch, AChangedBoundActsAtOnce) {
  TrackingWatch watch;
  watch.setMaxError(0.5);
  const auto error = [](double) { return 0.3; };
  EXPECT_EQ(stops(watch, error, 5).first, -1);
  watch.setMaxError(0.2);
  EXPECT_NEAR(stops(watch, error, 20, 5).first, 6, 0.05);
}

TEST(TrackingWatch, TheDefaultBoundDependsOnTheSizeOfTheReference) {
  EXPECT_NEAR(defaultMaxError(*makeCircle({3, 1}, 1.2, 0.6)), 0.3, 1e-3);
  EXPECT_EQ(defaultMaxError(*makeCircle({0, 0}, 2, 0.6)), 0.5);
  EXPECT_EQ(defaultMaxError(*makeCircle({0, 0}, 20, 0.6)), 0.5);
  EXPECT_EQ(defaultMaxError(*makeCircle({0, 0}, 0.02, 0.6)), 0.05);
  EXPECT_NEAR(defaultMaxError(*makeLine({1, 0}, {1, 2}, 0.5, true)), 0.25, 1e-9);
}

TEST(Feasibility, GivesTheReason) {
  const Model large = mvwt();
  EXPECT_EQ(infeasibility(*makeCircle({0, 0}, 1.5, 0.3), large), "");
  EXPECT_EQ(infeasibility(*makeSinusoid({0, 0}, 0.3, 1.0, 0.3), large), "");
  EXPECT_NE(infeasibility(*makeSinusoid({0, 0}, 0.3, 1.0, 0.5), large).find("yaw moment"),
            std::string::npos);
  EXPECT_NE(infeasibility(*makeCircle({0, 0}, 2.0, 1.5), large).find("a thrust of"),
            std::string::npos);
  const Model small = loadModel("cfg/hovercraft/tiny_whoover_4_1.yaml");
  EXPECT_EQ(infeasibility(*makeCircle({0, 0}, 2, 0.63), small), "");
  EXPECT_EQ(infeasibility(*makeSinusoid({0, 0}, 0.5, 1, 0.6), small), "");
  EXPECT_EQ(infeasibility(*makeRhodonea({0, 0}, 1.5, 1.5, 0.4), small), "");
  // It can brake only after turning round.
  EXPECT_NE(infeasibility(*makeLine({0, 0}, {2.5, 2.5}, 1.5, true), small), "");
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

/// Largest forward and backward thrust that a line takes, by its own formula [N].
std::pair<double, double> thrustsAlong(const ReferenceTrajectory& line, const Body<double>& body) {
  std::pair<double, double> most = {0, 0};
  for (double t = 0; t < line.extent(); t += line.extent() / 20000) {
    const ReferencePoint at = line.at(t);
    const Vector2<double> ahead(0.6, 0.8);
    const double force = body.m * at.p_ddot.dot(ahead) + body.Y_v * at.p_dot.dot(ahead);
    most.first = std::max(most.first, force);
    most.second = std::max(most.second, -force);
  }
  return most;
}

TEST(Feasibility, OfACircleDependsOnTheYawMomentBesideItsThrust) {
  int feasible = 0, refused = 0;
  for (const double resistance : {1.0, 10.0, 40.0, 80.0, 160.0})
    for (const double rate : {0.3, 0.7, -0.7, 1.3}) {
      Model model = tinyWhoover();
      Body<double>& body = model.body;
      body.N_r *= resistance;
      // Inwards and along the circle of 1 m: the heading follows this force at the circle's rate.
      const double inwards = body.m * rate * rate, along = body.Y_v * std::abs(rate);
      const double surge =
          (inwards * inwards + along * body.X_u * std::abs(rate)) / std::hypot(inwards, along);
      const double moment = body.N_r * std::abs(rate), full = body.k * body.l;
      const double limit = body.l * std::min(surge, 2 * body.k - surge);
      const double excess = (moment - limit) / full;
      ASSERT_LT(surge, 2 * body.k);
      if (excess > 0 && excess < 0.02) continue;  // it tolerates 1%
      const std::string said = infeasibility(*makeCircle({0.3, -1}, 1, rate), model);
      EXPECT_EQ(said.empty(), excess <= 0) << resistance << ' ' << rate << ' ' << said;
      said.empty() ? ++feasible : ++refused;
      const std::size_t at = said.find("takes a yaw moment of ");
      if (at == std::string::npos) continue;
      double needed = 0, beside = 0, largest = 0;
      ASSERT_EQ(std::sscanf(said.c_str() + at,
                            "takes a yaw moment of %lf N m, but with a thrust of %lf N the limit "
                            "is %lf N m",
                            &needed, &beside, &largest),
                3)
          << said;
      EXPECT_NEAR(needed, moment, 0.01 * moment);
      EXPECT_NEAR(beside, surge, 0.01 * surge);
      EXPECT_NEAR(largest, limit, 0.01 * limit);
    }
  EXPECT_GT(feasible, 3);
  EXPECT_GT(refused, 3);
}

TEST(Feasibility, AThrusterThatPushesAsideGivesNoMoment) {
  // Its force to the side would have to be held by another thruster, which there is not.
  Model pair = tinyWhoover();
  pair.body.N_r *= 80;
  std::vector<Thruster> thrusters;
  for (int i = 0; i < 3; ++i) {
    Thruster one;
    one.name = one.channel = std::string(1, static_cast<char>('a' + i));
    one.position = {0, i == 0 ? -pair.body.l : pair.body.l};
    if (i == 2) one.position = {pair.body.l, 0};
    if (i == 2) one.direction = 90;
    thrusters.push_back(one);
  }
  Model with_side = pair;
  with_side.thrusters = std::make_shared<const ThrusterLayout>(thrusters);
  const auto limit = [](const Model& model) {
    const std::string said = infeasibility(*makeCircle({0, 0}, 1, 1.3), model);
    double found = 0;
    const std::size_t at = said.find("the limit is");
    EXPECT_NE(at, std::string::npos) << said;
    if (at != std::string::npos) std::sscanf(said.c_str() + at, "the limit is %lf", &found);
    return found;
  };
  EXPECT_NEAR(limit(with_side), limit(pair), 0.01 * limit(pair));
}

TEST(Feasibility, OfALineDependsOnTheThrustForwardsAndBackwards) {
  Model pair = tinyWhoover();
  pair.setValue("X_u", pair.body.Y_v);
  int forwards = 0, backwards = 0, feasible = 0;
  for (double back : {0.0, 0.3, 0.6}) {
    Model model = pair;
    std::vector<Thruster> thrusters;
    for (int side : {-1, 1}) {
      Thruster one;
      one.name = one.channel = side < 0 ? "left" : "right";
      one.position = {0, side * pair.body.l};
      one.least = -back;
      thrusters.push_back(one);
    }
    model.thrusters = std::make_shared<const ThrusterLayout>(thrusters);
    const double full = 2 * model.body.k * model.body.input_max, reverse = back * full;
    for (double speed = 0.1; speed < 4; speed *= 1.04) {
      const ReferencePtr line = makeLine({0, 0}, {1.2, 1.6}, speed, true);
      const auto [push, brake] = thrustsAlong(*line, model.body);
      const double over = std::max(push - full, brake - reverse) / full;
      if (over > 0 && over < 0.03) continue;  // it tolerates 1%
      const std::string said = infeasibility(*line, model);
      EXPECT_EQ(said.empty(), over <= 0) << back << ' ' << speed << ' ' << said;
      feasible += said.empty();
      double needed = 0, largest = 0;
      const auto numbers = [&](const char* words, const char* pattern) {
        const std::size_t at = said.find(words);
        return at != std::string::npos &&
               std::sscanf(said.c_str() + at, pattern, &needed, &largest) == 2;
      };
      if (numbers("takes a thrust", "takes a thrust of %lf N, but full thrust is %lf N")) {
        ++forwards;
        EXPECT_NEAR(needed, push, 0.01 * push) << said;
        EXPECT_NEAR(largest, full, 0.01 * full) << said;
      } else if (numbers("backward", "backward thrust of %lf N, but the largest is %lf N")) {
        ++backwards;
        EXPECT_NEAR(needed, brake, 0.01 * brake) << said;
        EXPECT_NEAR(largest, reverse, 0.01 * reverse) << said;
      }
    }
  }
  EXPECT_GT(feasible, 40);
  EXPECT_GT(forwards, 5);
  EXPECT_GT(backwards, 5);
}

TEST(References, RefusesBadArguments) {
  EXPECT_THROW(makeCircle({0, 0}, 0, 1), std::invalid_argument);
  EXPECT_THROW(makeCircle({0, 0}, 1, 0), std::invalid_argument);
  EXPECT_THROW(makeLine({1, 1}, {1, 1}, 1, true), std::invalid_argument);
  EXPECT_THROW(makeLine({1, 1}, {2, 1}, 0, true), std::invalid_argument);
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double rate : {0.0, infinity, std::nan("")}) {
    EXPECT_THROW(makeCircle({0, 0}, 1, rate), std::invalid_argument);
    EXPECT_THROW(makeRhodonea({0, 0}, 1, 1.5, rate), std::invalid_argument);
    EXPECT_THROW(makeSinusoid({0, 0}, 1, 1, rate), std::invalid_argument);
  }
  EXPECT_THROW(makeRhodonea({0, 0}, 0, 1.5, 1), std::invalid_argument);
  EXPECT_THROW(makeRhodonea({0, 0}, 1, infinity, 1), std::invalid_argument);
  EXPECT_THROW(makeSinusoid({0, 0}, infinity, 1, 1), std::invalid_argument);
  EXPECT_THROW(makeSinusoid({0, 0}, 1, infinity, 1), std::invalid_argument);
  EXPECT_THROW(makeSpline({0}, {{0, 0}}), std::invalid_argument);
  EXPECT_THROW(makeSpline({0, 1, 2}, {{0, 0}, {1, 0}}), std::invalid_argument);
  EXPECT_THROW(makeSpline({0.5, 1}, {{0, 0}, {1, 0}}), std::invalid_argument);
  EXPECT_THROW(makeSpline({0, 0}, {{0, 0}, {1, 0}}), std::invalid_argument);
  EXPECT_THROW(makeSpline({0, infinity}, {{0, 0}, {1, 0}}), std::invalid_argument);
  EXPECT_THROW(makeWaypoints({{0, 0}}, 1, true), std::invalid_argument);
  EXPECT_THROW(makeWaypoints({{0, 0}, {1, 0}}, 0, true), std::invalid_argument);
  EXPECT_THROW(makeWaypoints({{0, 0}, {1, 0}, {1, 0}}, 1, true), std::invalid_argument);
  EXPECT_NO_THROW(makeSpline({0, 1}, {{0, 0}, {1, 0}}));
  EXPECT_NO_THROW(makeWaypoints({{0, 0}, {1, 0}}, 1, true));
  EXPECT_NO_THROW(makeSinusoid({0, 0}, 0, 0, -1));
}

TEST(TrackingLaw, AlphaDotIsTheDerivativeOfAlphaAlongTheMotion) {
  // The motions have the law's own force, which must be within the bounds of the thrusters: then
  // the law knows the true acceleration.
  Model model = mvwt();
  model.setValue("X_u", model.body.Y_v);
  const TrackingLaw law(model);
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
    // motion by Taylor's formula, with the law's force and any yaw acceleration
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

/// A Lyapunov function of the law with its derivative: thesis 4.2 chooses force and torque for it.
struct Lyapunov {
  double value = 0, slope = 0;
  RigidState<double> moving;  ///< derivative of the state
};

Lyapunov lyapunov(const TrackingLaw& law, const Body<double>& body, const RigidState<double>& state,
                  const ReferencePoint& at, const TrackingGains& gains) {
  const auto out = law.run(state, at, gains);
  const double psi = state.eta.z(), r = state.nu.z(), d = body.Y_v;
  const Vector2<double> v = state.nu.head<2>(), delta(gains.delta_1, gains.delta_2);
  const Vector2<double> e = worldToBody<double>(psi, Vector2<double>(state.eta.head<2>() - at.p));
  const Vector2<double> phi =
      v - worldToBody<double>(psi, at.p_dot) + gains.k_e / body.m * e - delta;
  const double z = r - out.alpha.y();
  Lyapunov found;
  found.value = (e.squaredNorm() + body.m * body.m * phi.squaredNorm() + body.I_z * z * z) / 2;
  found.slope = -gains.k_e / body.m * e.squaredNorm() + e.dot(delta) -
                gains.k_phi_1 * phi.x() * phi.x() - gains.k_phi_2 * phi.y() * phi.y() -
                body.m * d * phi.squaredNorm() - (gains.k_z + body.N_r) * z * z;
  found.moving.eta << bodyToWorld<double>(psi, v), r;
  found.moving.nu << out.force / body.m + r * v.y() - d / body.m * v.x(),
      -r * v.x() - d / body.m * v.y(), (out.torque - body.N_r * r) / body.I_z;
  return found;
}

TEST(TrackingLaw, TheErrorsDecayAtTheRateThatTheGainsSet) {
  Model model = mvwt();
  model.setValue("X_u", model.body.Y_v);
  const TrackingLaw law(model);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const ReferencePtr reference = makeSinusoid({0.1, 0}, 0.3, 1.0, 0.3);
  int checked = 0;
  for (int trial = 0; trial < 200; ++trial) {
    TrackingGains gains = mvwtGains();
    gains.k_phi_2 = 0.7;
    gains.delta_2 = 0.004 * (trial % 3);
    const double t = 1.0 + 0.1 * trial;
    const ReferencePoint at = reference->at(t);
    RigidState<double> state;
    state.eta << at.p.x() + 0.02 * uniform(random), at.p.y() + 0.02 * uniform(random),
        M_PI * uniform(random);
    state.nu.head<2>() = worldToBody<double>(state.eta.z(), at.p_dot) +
                         0.1 * Vector2<double>(uniform(random), uniform(random));
    state.nu.z() = 0.5 * uniform(random);
    const auto out = law.run(state, at, gains);
    if (out.force <= 0 || out.force >= 9) continue;  // the law knows its own acceleration only then
    ++checked;
    const Lyapunov here = lyapunov(law, model.body, state, at, gains);
    const auto after = [&](double dt) {
      RigidState<double> moved = state;
      moved.eta += dt * here.moving.eta;
      moved.nu += dt * here.moving.nu;
      return lyapunov(law, model.body, moved, reference->at(t + dt), gains).value;
    };
    const auto central = [&](double h) { return (after(h) - after(-h)) / (2 * h); };
    const double h = 2e-4, slope = (4 * central(h / 2) - central(h)) / 3;
    EXPECT_NEAR(slope, here.slope, 1e-7 * (1 + std::abs(here.slope))) << trial;
  }
  EXPECT_GT(checked, 40);
}

TEST(TrackingLaw, SaysWhichWayACraftCannotBeDriven) {
  const auto problem = [](const char* thrusters) {
    return TrackingLaw::steeringProblem(
        parseModel(std::string("schema: ground/model/1\nname: c\nbody: {m: 0.2, I_z: 4.0e-4, X_u: "
                               "0.05, Y_v: 0.06, N_r: 1.0e-4, k: 0.06, thrusters: [") +
                       thrusters + "]}\neffects: []\n",
                   "craft.yaml"));
  };
  const char* left = "{name: left, position: [0, -0.05], direction: 0}";
  const char* right = "{name: right, position: [0, 0.05], direction: 0}";
  const std::string both = std::string(left) + ", " + right;
  EXPECT_EQ(problem(both.c_str()), "");
  EXPECT_NE(problem(left).find("turn it to port"), std::string::npos) << problem(left);
  EXPECT_NE(problem(right).find("turn it to starboard"), std::string::npos) << problem(right);
  const char* turning =
      "{name: left, position: [0, -0.05], direction: 180}, "
      "{name: right, position: [0, 0.05], direction: 180}";
  EXPECT_NE(problem(turning).find("push it forward"), std::string::npos) << problem(turning);
}

struct Tracked {
  double last_saturation = 0, rms = 0, largest = 0;
  Vector2<double> inputs;
  double error = 0;
};

/// Closed loop at 50 Hz; the error counts from `settled` on.
Tracked track(const Model& model, const TrackingGains& gains, const ReferenceTrajectory& reference,
              const RigidState<double>& initial, double duration, double settled) {
  const TrackingLaw law(model);
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
    run.inputs = asVector(out.inputs);
    if (out.saturated()) run.last_saturation = t;
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

TEST(BacksteppingControl, GivesItsInputsBeforeSaturation) {
  const Model model = tinyWhoover();
  const TrackingLaw law(model);
  BacksteppingControl control(model, TrackingGains());
  const ReferencePtr circle = makeCircle({0, 0}, 2.0, 0.6);
  Observation seen;
  seen.reference = circle.get();
  const Thrusters<double> inputs = control.decide(seen), wanted = control.wanted();
  EXPECT_TRUE(wanted == law.run(seen.state, circle->at(0), TrackingGains()).wanted);
  EXPECT_TRUE(wanted != inputs) << "far from the circle it saturates";
  EXPECT_TRUE(model.thrusters->clipped(wanted, model.body.input_max) == inputs);
}

TEST(TrackingGains, RefuseBadValues) {
  EXPECT_EQ(TrackingGains().validate(), "");
  TrackingGains gains;
  gains.delta_1 = 0;
  EXPECT_NE(gains.validate(), "");
  gains = {};
  gains.k_e = std::nan("");
  EXPECT_EQ(gains.validate(), "k_e must be between 1e-06 and 100 kg/s, not nan");
}

TEST(ControllerTable, DefaultsAndSearchedRangesAreInsideTheRanges) {
  for (const ControllerInfo& info : controllerTable()) {
    EXPECT_EQ(info.validate(ControllerChoice()), "") << info.name;
    for (const TunableInfo& parameter : info.parameters) {
      const double standard = std::get<double>(parameter.standard);
      EXPECT_EQ(parameter.rangeError(standard), "") << parameter.name;
      for (double power : {parameter.search.low, parameter.search.high})
        if (parameter.search.sign != 0) {
          EXPECT_EQ(parameter.rangeError(parameter.search.sign * std::pow(10, power)), "");
        }
    }
  }
}

TEST(ControllerTable, SearchedRangesReachFarBeyondTheDefaults) {
  int searched = 0;
  for (const ControllerInfo& info : controllerTable()) {
    for (const TunableInfo& parameter : info.parameters) {
      const SearchRange& range = parameter.search;
      if (range.sign == 0) continue;
      ++searched;
      const double size = std::log10(range.sign * std::get<double>(parameter.standard));
      EXPECT_LE(range.low, size - 1.3) << parameter.name;
      EXPECT_GE(range.high, size + 1.3) << parameter.name;
    }
    if (info.name != "TrajectoryTracking") continue;
    for (const TunableInfo& gain : info.parameters) {  // up to the largest gains of all
      const double largest = gain.search.sign < 0 ? gain.low : gain.high;
      if (gain.search.sign == 0) continue;
      EXPECT_NEAR(gain.search.sign * std::pow(10, gain.search.high), largest, 1e-9) << gain.name;
    }
  }
  EXPECT_EQ(searched, 10);
}

TEST(ControllerTable, EveryParameterIsReadSetAndChecked) {
  for (const ControllerInfo& info : controllerTable()) {
    ControllerChoice choice;
    choice.kind = info.name;
    for (const auto& one : info.parameters) {
      ControllerChoice changed = choice;
      const double value = std::get<double>(one.standard) == one.high ? one.low : one.high;
      one.set(changed, value);
      EXPECT_EQ(std::get<double>(one.get(changed)), value) << one.name;
      for (const auto& other : info.parameters)
        EXPECT_EQ(other.get(changed) == other.get(choice), other.name != one.name)
            << one.name << " or " << other.name << " is in a wrong place";
      one.set(changed, one.high + 1);
      EXPECT_NE(changed.validate().find(one.name + " must be between"), std::string::npos)
          << changed.validate();
      EXPECT_THROW(makeController(tinyWhoover(), changed), std::invalid_argument);
      EXPECT_THROW(one.set(changed, std::string("1")), std::invalid_argument);
      EXPECT_THROW(one.set(changed, true), std::invalid_argument);
    }
  }
}

/// Inputs before saturation in the first second beside a circle.
std::vector<Vector2<double>> wantedBeside(const ReferenceTrajectory& circle,
                                          TrackingController& controller) {
  std::vector<Vector2<double>> wanted;
  for (int i = 0; i < 50; ++i) {
    Observation seen;
    seen.now = seen.stamp = 0.02 * i;
    seen.reference = &circle;
    seen.state.eta << circle.at(seen.now).p + Vector2<double>(0.01, 0), M_PI / 2 + 0.6 * seen.now;
    seen.state.nu << 1.2, 0, 0.6;
    controller.decide(seen);
    const Thrusters<double> now = controller.wanted();
    wanted.emplace_back(now(0), now(1));
  }
  return wanted;
}

TEST(ControllerTable, ControllersWantNothingBeforeTheirFirstDecision) {
  const Model model = loadModel("cfg/hovercraft/tiny_whoover_4_1.yaml");
  for (const ControllerInfo& info : controllerTable()) {
    const auto controller = info.make(model, ControllerChoice());
    for (const double input : controller->wanted()) EXPECT_EQ(input, 0) << info.name;
  }
}

TEST(ControllerTable, TuningHasTheEffectOfANewController) {
  const Model model = tinyWhoover();
  const ReferencePtr circle = makeCircle({0, 0}, 2.0, 0.6);
  for (const ControllerInfo& info : controllerTable()) {
    ControllerChoice choice, other;
    choice.kind = other.kind = info.name;
    other.gains.k_e = 0.01;
    other.predictive.steps = 20;
    other.prbs_seed = 5;
    const auto before = makeController(model, choice), after = makeController(model, other);
    const auto tuned = makeController(model, choice);
    info.tune(*tuned, other);
    EXPECT_EQ(tuned->follows(), info.follows);
    const auto wanted = wantedBeside(*circle, *tuned);
    EXPECT_EQ(wanted, wantedBeside(*circle, *after)) << info.name;
    EXPECT_NE(wanted, wantedBeside(*circle, *before)) << info.name;
  }
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
      const bool takes =
          std::find(info.takes.begin(), info.takes.end(), one.name) != info.takes.end();
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

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
