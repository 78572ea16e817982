// The origin of the model's time t: the begin of a drive, the same wherever a model is simulated.
#include "ground/model/drive_clock.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "../crafts.h"
#include "ground/control/input_design.h"
#include "ground/estimation/model_monitor.h"
#include "ground/identification/grey_box.h"
#include "ground/identification/simulation_error.h"
#include "ground/model/expression_effect.h"
#include "ground/model/simulation.h"
#include "ground/simulation/experiment.h"

namespace ground {
namespace drive_clock_test {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Model sagging(double tau) { return withValues(tinyWhoover(), {{"battery_sag.tau", tau}}); }

TEST(DriveClock, ADriveBeginsWithTheFirstLift) {
  DriveClock clock;
  EXPECT_EQ(clock.origin(7), kInfinity);
  EXPECT_EQ(clock.since(7), 0);
  EXPECT_FALSE(clock.command(1000, 0));
  EXPECT_TRUE(clock.command(1003, 0.1));
  EXPECT_FALSE(clock.command(1004, 1));
  EXPECT_EQ(clock.since(1000), 0);
  EXPECT_EQ(clock.since(1003), 0);
  EXPECT_EQ(clock.since(1013), 10);
}

TEST(DriveClock, OnlyALongPauseOfTheLiftEndsADrive) {
  DriveClock clock;
  clock.command(10, 1);
  clock.command(20, 0);
  EXPECT_FALSE(clock.command(20 + DriveClock::kPause, 1));
  EXPECT_EQ(clock.since(25), 15);
  // A command is held until the next: a time without commands is not a pause of the lift.
  EXPECT_FALSE(clock.command(60, 1));
  clock.command(70, 0);
  EXPECT_EQ(clock.since(80), 70);
  EXPECT_TRUE(clock.command(80, 1));
  EXPECT_EQ(clock.since(81), 1);
  EXPECT_EQ(clock.since(75), 65);
  EXPECT_EQ(clock.starts(), std::vector<double>({10, 80}));
}

TEST(DriveClock, ARecordGivesTheBeginOfAnEarlierDrive) {
  DriveClock late;  // gets commands from the middle of a drive on
  EXPECT_TRUE(late.command(3, 1));
  late.record(-40, 3.4);
  EXPECT_EQ(late.since(5), 45);
  late.record(-40, 5.4);
  EXPECT_EQ(late.starts(), std::vector<double>({-40}));
  // The record comes before the first command.
  DriveClock early;
  early.record(-40, 0);
  EXPECT_FALSE(early.command(0.1, 1));
  EXPECT_EQ(early.since(5), 45);
  // A record that is older than a new drive does not change it.
  late.command(10, 0);
  EXPECT_TRUE(late.command(20, 1));
  late.record(-40, 19.9);
  EXPECT_EQ(late.since(21), 1);
  late.record(20.001, 20.5);  // the same drive, by the sender's clock
  EXPECT_EQ(late.starts(), std::vector<double>({-40, 20.001}));
}

/// Run of a craft with battery sag: rest until 3 s, then lift, then a PRBS; exact mocap. The room
/// starts at an arbitrary time.
struct DrivenRun {
  static constexpr double kLift = 3.0, kEnd = 23.0;
  Model truth = sagging(20);
  RunData run;  ///< from the room's start on

  explicit DrivenRun(double start = 1000) {
    MocapParams mocap;
    mocap.position_noise = mocap.heading_noise = mocap.latency = 0;
    SimulatedLab::Params params;
    params.start = start;
    ModelCraft craft(truth, params);
    SimulatedLab room(craft, mocap, params);
    const InputSignal signal = playBits({makePrbs(9, 5), 1}, {});
    std::vector<Vector3<double>> eta, nu;
    for (int i = 0; i < 100 * kEnd; ++i) {
      const double t = i * 0.01;
      room.advance(start + t);
      eta.push_back(room.state().eta);
      nu.push_back(room.state().nu);
      run.times.push_back(t);
      if (i % 2 != 0) continue;
      const Thrusters<double> thrust =
          t < kLift + 1 ? Thrusters<double>::zero(2) : signal.at(std::fmod(t, 19.0)).thrusters;
      room.command(thrust, t >= kLift);
      run.inputs.add(t, thrust, t >= kLift);
    }
    run.name = "driven";
    run.eta.resize(static_cast<Eigen::Index>(eta.size()), 3);
    run.nu.resize(run.eta.rows(), 3);
    for (std::size_t i = 0; i < eta.size(); ++i) {
      run.eta.row(static_cast<Eigen::Index>(i)) = eta[i];
      run.nu.row(static_cast<Eigen::Index>(i)) = nu[i];
    }
  }

  /// The part that a recording started at `from` [s] has, on its own clock.
  RunData recordedFrom(double from) const {
    RunData part;
    part.name = "late";
    const auto first = static_cast<Eigen::Index>(std::lround(from * 100));
    for (auto i = static_cast<std::size_t>(first); i < run.times.size(); ++i)
      part.times.push_back(run.times[i] - from);
    part.eta = run.eta.bottomRows(run.eta.rows() - first);
    part.nu = run.nu.bottomRows(run.nu.rows() - first);
    for (std::size_t i = 0; i < run.inputs.size(); ++i)
      if (run.inputs.times[i] >= from)
        part.inputs.add(run.inputs.times[i] - from, run.inputs.thrusters[i], run.inputs.lift[i]);
    part.inputs.drive.record(kLift - from, 0.5);
    return part;
  }
};

TEST(OneOriginOfTime, IdentificationFindsTheSagOfTheSimulatedCraft) {
  const DrivenRun driven;
  for (const RunData& run : {driven.run, driven.recordedFrom(13)}) {
    const SimulationError problem({run}, cutWindows(run, 0, 0, 1e9, 1.5));
    FitOptions options;
    options.free = {"k", "battery_sag.tau"};
    const Model found = problem.fit(sagging(100), options).model;
    EXPECT_NEAR(found.value("battery_sag.tau"), 20, 0.1) << run.name;
    // An origin that is wrong by 1 s changes k by 5%.
    EXPECT_NEAR(found.value("k"), driven.truth.body.k, 1e-4) << run.name;
  }
}

TEST(OneOriginOfTime, PredictionAndMissingWrenchAgreeWithTheSimulatedCraft) {
  const DrivenRun driven;
  for (const double from : {0.0, 13.0}) {
    const RunData run = driven.recordedFrom(from);
    const std::vector<Window> windows = cutWindows(run, 0, 5, 1e9, 1.5);
    Eigen::MatrixX3d nu(static_cast<Eigen::Index>(windows.size()), 3);
    for (std::size_t w = 0; w < windows.size(); ++w)
      nu.row(static_cast<Eigen::Index>(w)) = run.nu.row(windows[w].first);
    const WindowSimulation found = predict(driven.truth, run, windows, nu);
    for (std::size_t w = 0; w < windows.size(); ++w) {
      const auto measured = run.nu.middleRows(windows[w].first, found.nu[w].rows());
      EXPECT_LT((found.nu[w] - measured).cwiseAbs().maxCoeff(), 1e-4) << windows[w].first;
    }
    // Nothing is missing; an origin that is wrong by 1 s would be 5% of the thrust.
    const GreyBox box({run}, driven.truth.body);
    const SmoothedWrench missing = box.smooth(box.start(driven.truth), 0, 25);
    EXPECT_LT(missing.wrench.leftCols<2>().cwiseAbs().bottomRows(500).maxCoeff(), 0.01 * driven.truth.body.k);
  }
}

TEST(OneOriginOfTime, ALiveComparisonStartedDuringADrivePredictsTheSimulatedCraft) {
  const DrivenRun driven;
  for (const double from : {0.0, 13.0}) {
    const RunData run = driven.recordedFrom(from);
    ModelMonitor monitor(driven.truth, {});
    monitor.setDrive(run.inputs.drive);
    std::optional<ModelMonitor::Error> last;
    double wrench = 0;
    std::size_t next = 0;
    for (std::size_t i = 0; i < run.times.size(); ++i) {
      for (; next < run.inputs.size() && run.inputs.times[next] < run.times[i]; ++next)
        monitor.command(run.inputs.times[next], run.inputs.thrusters[next], run.inputs.lift[next]);
      const auto row = static_cast<Eigen::Index>(i);
      const auto found = monitor.measure(run.times[i], {run.eta.row(row), run.nu.row(row)},
                                         poseMeasurement(run.eta.row(row), 3e-4, 5e-3));
      if (found) last = found;
      if (found && run.times[i] > 5) wrench = std::max(wrench, std::abs(found->wrench.x()));
    }
    ASSERT_TRUE(last);
    EXPECT_LT(last->rms.position, 1e-3);
    EXPECT_LT(wrench, 2e-3);  // 0.06 N with a wrong origin
  }
}

TEST(OneOriginOfTime, APlanUsesTheThrustOfItsTime) {
  // With battery sag, steady motion against drag needs more input late in a drive.
  Model model = sagging(20);
  model.setValue("X_u", 0.05);
  ReferenceParams line;
  line.kind = "line";
  line.speed = 0.4;
  line.end_x = 50;
  line.end_y = 0;
  line.smooth = false;
  const ReferencePtr reference = makeReference(line);
  PredictiveParams params;
  params.iterations = 50;
  for (const double elapsed : {0.0, 20.0}) {
    PredictiveControl control(model, params);
    Observation seen{0, 0, {}, nullptr, 0, {1, std::nullopt}, 0};
    seen.stamp = seen.now = seen.reference_start = 1000;
    seen.state.nu << line.speed, 0, 0;
    seen.reference = reference.get();
    seen.pose = poseMeasurement(seen.state.eta, 3e-4, 5e-3);
    seen.drive_start = seen.now - elapsed;
    const double input = 0.05 * line.speed / (model.body.k * std::exp(-elapsed / 20));
    EXPECT_NEAR(asVector(control.decide(seen)).sum(), input, 0.1 * input) << elapsed;
  }
}

}  // namespace drive_clock_test
}  // namespace ground
