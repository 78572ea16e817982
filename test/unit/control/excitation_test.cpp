// Excitation inside a room: bursts of an input design between returns home.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <random>

#include "../crafts.h"
#include "ground/control/excitation_pilot.h"
#include "ground/simulation/experiment.h"

namespace ground {
namespace excitation_test {

using Mark = ExcitationPilot::Mark;
using Stage = ControllerLifecycle::State;

constexpr double kDriveBegin = 1.5;  // after 0.5 s of rest and 1 s of lift alone [s]
constexpr double kTolerance = 1e-6;  // tolerance of equal times [s]

/// The craft with mass, inertia, thrust and lever arm times 0.8 or 1.2.
Model wrongCraft(unsigned long seed) {
  Model model = tinyWhoover();
  std::mt19937_64 random(seed);
  for (const char* name : {"m", "I_z", "k", "l"})
    model.setValue(name, model.value(name) * (random() % 2 == 0 ? 0.8 : 1.2));
  return model;
}

Room square() { return loadRoom("cfg/room/room_4x4.yaml"); }

ExcitationParams inRoom(const Room& room, unsigned long seed, double duration = 20) {
  ExcitationParams params;
  params.design.seed = seed;
  params.duration = duration;
  params.room = room;
  return params;
}

ExperimentParams place(unsigned long seed, bool gaps = false) {
  ExperimentParams params;
  params.seed = seed;
  if (!gaps) return params;
  params.mocap.gap_rate = 0.1;
  params.mocap.gap_length = 0.3;
  params.mocap.gaps_vary = false;
  return params;
}

/// The least distance of the true craft from the walls [m].
double leastClearance(const ExperimentLog& log, const Room& room) {
  double least = std::numeric_limits<double>::infinity();
  for (const auto& truth : log.truth) least = std::min(least, room.clearance(truth.state.eta.head<2>()));
  return least;
}

/// Time at which the controller ends [s].
double drivenUntil(const ExperimentLog& log) {
  for (const auto& stage : log.stages)
    if (stage.state == Stage::kDone || stage.state == Stage::kStopped) return stage.time;
  return log.truth.back().time;
}

/// Whether the thrust was off at `time` [s] because the state was lost.
bool recovering(const ExperimentLog& log, double time) {
  double since = std::numeric_limits<double>::infinity();
  for (const auto& stage : log.stages) {
    if (stage.state == Stage::kRecovering) since = stage.time;
    if (stage.state == Stage::kRunning) {
      if (time >= since - kTolerance && time <= stage.time + kTolerance) return true;
      since = std::numeric_limits<double>::infinity();
    }
  }
  return time >= since - kTolerance;
}

/// Checks that bursts and returns alternate, are numbered from 1 on, and have reasons and ascending
/// times; and that decisions are made during returns only.
void expectTurns(const ExperimentLog& log) {
  ASSERT_FALSE(log.marks.empty());
  EXPECT_NEAR(log.marks.front().time, kDriveBegin, 0.02);
  EXPECT_EQ(log.marks.front().reason, "the first one");
  for (std::size_t i = 0; i < log.marks.size(); ++i) {
    const Mark& mark = log.marks[i];
    EXPECT_EQ(mark.burst, i % 2 == 0) << i;
    EXPECT_EQ(mark.number, static_cast<int>(i / 2) + 1) << i;
    EXPECT_FALSE(mark.reason.empty()) << i;
    if (i > 0) {
      EXPECT_GE(mark.time, log.marks[i - 1].time) << i;
    }
  }
  EXPECT_LT(log.marks.back().time, drivenUntil(log) + kTolerance);
  for (const auto& decision : log.decisions) {
    const auto next = std::find_if(log.marks.begin(), log.marks.end(),
                                   [&](const Mark& mark) { return mark.time > decision.now; });
    const Mark& last = *(next - 1);
    const bool ends_now = last.burst && last.time == decision.now;
    EXPECT_TRUE(!last.burst || ends_now) << "a decision within a burst, " << decision.now;
  }
}

/// Checks that the commands in every burst are the rows of the design at their times. Rows continue
/// from burst to burst, and from the last to the first; a return skips the rest of a row. Returns
/// the number of rows played.
std::size_t expectDesign(const ExperimentLog& log, const InputSignal& signal, double spacing) {
  std::size_t row = 0, edges = 0, missed = 0;
  double latest = 0;
  for (std::size_t i = 0; i < log.marks.size(); i += 2) {
    const double begin = log.marks[i].time;
    const double end = i + 1 < log.marks.size() ? log.marks[i + 1].time : drivenUntil(log);
    const auto rowAt = [&](double time) {
      const auto since = static_cast<std::size_t>(std::floor((time - begin) / spacing + kTolerance));
      return (row + since) % signal.inputs.size();
    };
    std::vector<double> seen;
    for (std::size_t k = 0; k < log.commands.size(); ++k) {
      const auto& command = log.commands[k];
      if (command.time < begin || command.time >= end || recovering(log, command.time)) continue;
      // At its end, the last command of a return precedes the first of the burst.
      if (k + 1 < log.commands.size() && log.commands[k + 1].time == command.time) continue;
      const std::size_t now = rowAt(command.time);
      EXPECT_EQ(command.thrusters(0), signal.inputs[now].thrusters(0)) << command.time << " row " << now;
      EXPECT_EQ(command.thrusters(1), signal.inputs[now].thrusters(1)) << command.time << " row " << now;
      EXPECT_EQ(command.lift, 1) << command.time;
      seen.push_back(command.time);
    }
    for (double edge = begin; edge < end - kTolerance; edge += spacing) {
      if (recovering(log, edge)) continue;
      ++edges;
      const auto met =
          std::find_if(seen.begin(), seen.end(), [&](double time) { return time > edge - kTolerance; });
      const double late = (met == seen.end() ? end : *met) - edge;
      missed += late > kTolerance;
      latest = std::max(latest, late);
    }
    row = (rowAt(end) + 1) % signal.inputs.size();
  }
  EXPECT_EQ(missed, 0u) << "of " << edges << " rows began late, by up to " << latest << " s";
  return edges;
}

TEST(Excitation, ATrueCraftStaysInsideAndPlaysTheDesign) {
  for (unsigned long seed = 1; seed <= 2; ++seed) {
    SCOPED_TRACE(seed);
    const ExcitationParams params = inRoom(square(), seed);
    const ExperimentLog log = excite(tinyWhoover(), tinyWhoover(), params, place(seed));
    EXPECT_EQ(log.stopped, "");
    EXPECT_NEAR(drivenUntil(log), kDriveBegin + 20, 0.02);
    EXPECT_GT(leastClearance(log, square()), 0.2);
    EXPECT_GT(log.marks.size(), 6u) << "several bursts and returns";
    expectTurns(log);
    const std::size_t rows = expectDesign(log, makeDesign(params.design, 20), 1 / 15.0);
    EXPECT_GT(rows, 60u);
  }
}

TEST(Excitation, AWrongCraftWithLossesOfTheMocapStaysInside) {
  int gaps = 0;
  for (unsigned long seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE(seed);
    const ExcitationParams params = inRoom(square(), seed);
    const ExperimentLog log = excite(wrongCraft(seed), tinyWhoover(), params, place(seed, true));
    EXPECT_GT(leastClearance(log, square()), 0);
    EXPECT_GT(log.marks.size(), 6u);
    expectTurns(log);
    expectDesign(log, makeDesign(params.design, 20), 1 / 15.0);
    for (std::size_t i = 1; i < log.frames.size(); ++i)
      gaps += log.frames[i].captured - log.frames[i - 1].captured > 0.29;
  }
  EXPECT_GT(gaps, 3) << "the mocap was lost";
}

TEST(Excitation, ReturnsComeHome) {
  const Room room = square();
  const ExperimentLog log = excite(tinyWhoover(), tinyWhoover(), inRoom(room, 1, 15), place(1));
  int returns = 0;
  for (std::size_t i = 2; i < log.marks.size(); i += 2) {
    const auto truth = std::find_if(log.truth.begin(), log.truth.end(),
                                    [&](const auto& t) { return t.time >= log.marks[i].time; });
    ASSERT_NE(truth, log.truth.end());
    EXPECT_LT((truth->state.eta.head<2>() - room.home).norm(), 0.5 * room.clearance(room.home) + 0.05);
    ++returns;
  }
  EXPECT_GE(returns, 3);
}

TEST(Excitation, WithoutARoomItIsTheOpenLoopSignal) {
  ExcitationParams params;
  params.design.seed = 5;
  params.duration = 10;
  const InputSignal signal = makeDesign(params.design, 10);
  const ExperimentLog log = excite(tinyWhoover(), tinyWhoover(), params, place(5));
  EXPECT_EQ(log.stopped, "");
  ASSERT_EQ(log.marks.size(), 1u);
  EXPECT_TRUE(log.marks.front().burst);
  const double begins = log.marks.front().time;
  EXPECT_EQ(expectDesign(log, signal, 1 / 15.0), signal.inputs.size());

  InputSequence schedule;
  schedule.add(0, 0, 0, 0);
  schedule.add(log.stages.at(1).time, 0, 0, 1);
  for (std::size_t i = 0; i < signal.times.size(); ++i)
    schedule.add(begins + signal.times[i], signal.inputs[i].thrusters(0), signal.inputs[i].thrusters(1), 1);
  const double end = begins + 10;
  const ExperimentLog open = playSchedule(tinyWhoover(), schedule, end, place(5));
  ASSERT_LE(open.truth.size(), log.truth.size());
  double moved = 0;
  for (std::size_t i = 0; i < open.truth.size(); ++i) {
    const RigidState<double>&a = open.truth[i].state, &b = log.truth[i].state;
    ASSERT_LT((a.eta - b.eta).norm() + (a.nu - b.nu).norm(), 1e-4) << open.truth[i].time;
    moved = std::max(moved, a.eta.head<2>().norm());
  }
  EXPECT_GT(moved, 1) << "the craft moves";
}

TEST(Excitation, EndsWithTheRowsOfAFileAndPlaysItsLift) {
  const std::string path = testing::TempDir() + "excitation_test.csv";
  std::ofstream(path) << "time,left,right,lift\n0,0.1,0.1,0.9\n0.4,0.05,0.1,0.8\n0.8,0.1,0.05,0.7\n"
                         "1.2,0,0,0\n";
  ExcitationParams params = inRoom(square(), 1);
  params.design.kind = "file";
  params.design.file = path;
  const ExperimentLog log = excite(tinyWhoover(), tinyWhoover(), params, place(1));
  EXPECT_EQ(log.stopped, "");
  EXPECT_EQ(log.stages.back().state, Stage::kDone);
  EXPECT_NEAR(drivenUntil(log), kDriveBegin + 1.2, 0.03);
  const double begins = log.marks.front().time;
  int played = 0;
  for (const auto& command : log.commands) {
    const double at = command.time - begins;
    if (at < 0 || at > 1.2 - kTolerance) continue;
    ++played;
    EXPECT_EQ(command.lift, at < 0.4 - kTolerance ? 0.9 : at < 0.8 - kTolerance ? 0.8 : 0.7) << at;
    EXPECT_EQ(command.thrusters(0), at < 0.4 - kTolerance || at > 0.8 - kTolerance ? 0.1 : 0.05) << at;
  }
  EXPECT_GT(played, 55);
}

TEST(Excitation, AStrongDisturbanceStopsTheCraftBeforeAWall) {
  int stopped = 0, late = 0;
  for (unsigned long seed = 1; seed <= 6; ++seed) {
    ExperimentParams where = place(seed);
    where.disturbance.sigma << 0.1, 0.1, 0;  // full thrust is 0.124 N
    where.disturbance.time.setConstant(1.0);
    const ExperimentLog log = excite(tinyWhoover(), tinyWhoover(), inRoom(square(), seed, 8), where);
    if (log.stopped.empty()) continue;
    ++stopped;
    EXPECT_NE(log.stopped.find("of the room"), std::string::npos) << log.stopped;
    for (const auto& command : log.commands)
      if (command.time > log.stopped_at) {
        EXPECT_EQ(command.thrusters(0) + command.thrusters(1) + command.lift, 0) << command.time;
      }
    const double after = log.stopped_at + 0.001;
    for (const auto& truth : log.truth)
      late += truth.time <= after && square().clearance(truth.state.eta.head<2>()) < 0;
  }
  EXPECT_GT(stopped, 1);
  EXPECT_EQ(late, 0) << "it must be stopped inside";
}

/// A signal of one row.
InputSignal constant(double left) {
  InputSignal signal;
  signal.times = {0};
  signal.inputs = {{{left, 0.0}, 0.0}};
  signal.end = 100;
  return signal;
}

TEST(ExcitationPilot, ASignalGivenInADrivePlaysFromTheNextOneOn) {
  double now = 0;
  ExcitationPilot pilot([&] { return now; }, [](const Mark&) {}, [](const ReferencePilot::Decision&) {});
  const RigidState<double> rest{};
  pilot.play(constant(0.2), 50);
  pilot.activate(0);
  pilot.play(constant(0.7), 50);
  EXPECT_EQ(pilot.update(1, 1, rest, 1).thrusters(0), 0.2);
  pilot.deactivate();
  pilot.activate(now = 2);
  EXPECT_EQ(pilot.update(1, 3, rest, 1).thrusters(0), 0.7);
}

}  // namespace excitation_test
}  // namespace ground
