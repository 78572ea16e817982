// Input designs: the properties of all, and the pattern of each.
#include "ground/control/input_design.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <memory>

#include "../crafts.h"
#include "ground/control/prbs.h"

namespace ground {
namespace input_design_test {

using Row = std::array<double, 2>;
using Rows = std::vector<Row>;

constexpr char kTimed[] = "time,left,right\n0,0.2,0.8\n0.5,0.9,0\n2,0,0\n";
constexpr char kLifted[] = "time,left,right,lift\n0,0,0,1\n1,0.5,0.25,1\n3,0,0,0.5\n4,0,0,0\n";

std::string fileWith(const std::string& text) {
  const std::string path = testing::TempDir() + "input_design_test.csv";
  std::ofstream(path) << text;
  return path;
}

DesignParams design(const std::string& kind) {
  DesignParams params;
  params.kind = kind;
  return params;
}

DesignParams inputFile(const std::string& text) {
  DesignParams params = design("file");
  params.file = fileWith(text);
  return params;
}

/// All designs except file, by name.
std::map<std::string, DesignParams> designs() {
  std::map<std::string, DesignParams> all;
  for (const DesignInfo& info : designTable())
    if (info.name != "file") all[info.name] = design(info.name);
  return all;
}

Rows rowsOf(const InputSignal& signal) {
  Rows rows;
  for (const Inputs& inputs : signal.inputs) rows.push_back({inputs.thrusters(0), inputs.thrusters(1)});
  return rows;
}

/// Checks the properties of every signal.
void expectSound(const InputSignal& signal) {
  ASSERT_FALSE(signal.times.empty());
  ASSERT_EQ(signal.times.size(), signal.inputs.size());
  EXPECT_GE(signal.times.front(), 0);
  for (std::size_t i = 1; i < signal.times.size(); ++i) ASSERT_GT(signal.times[i], signal.times[i - 1]);
  EXPECT_LE(signal.times.back(), signal.end);
  for (const Inputs& inputs : signal.inputs)
    for (double input : {inputs.thrusters(0), inputs.thrusters(1), inputs.lift})
      ASSERT_TRUE(input >= 0 && input <= 1) << input;
}

/// Checks a signal by stepping with nextChange() like a controller.
void expectPlays(const InputSignal& signal) {
  double t = 0;
  for (std::size_t i = 0; i < signal.times.size(); ++i) {
    const double next = i + 1 < signal.times.size() ? signal.times[i + 1] : signal.end;
    if (next == signal.times[i]) break;  // the last row of a file only marks its end
    for (double at : {t, 0.5 * (t + next), next - 1e-6}) {
      ASSERT_EQ(signal.at(at).thrusters(0), signal.inputs[i].thrusters(0)) << at;
      ASSERT_EQ(signal.at(at).thrusters(1), signal.inputs[i].thrusters(1)) << at;
      ASSERT_EQ(signal.at(at).lift, signal.inputs[i].lift) << at;
      ASSERT_EQ(signal.nextChange(at), next) << at;
    }
    // A time just before an edge by rounding has the inputs after the edge.
    if (t > 0) {
      ASSERT_EQ(signal.at(t - 1e-12).thrusters(0), signal.inputs[i].thrusters(0)) << t;
      ASSERT_EQ(signal.at(t - 1e-12).thrusters(1), signal.inputs[i].thrusters(1)) << t;
    }
    t = next;
  }
  EXPECT_EQ(t, signal.end);
  for (double outside : {-0.1, signal.end, signal.end + 1, std::nan("")}) {
    const Inputs inputs = signal.at(outside);
    EXPECT_EQ(inputs.thrusters(0) + inputs.thrusters(1) + inputs.lift, 0) << outside;
  }
  EXPECT_EQ(signal.nextChange(signal.end), std::numeric_limits<double>::infinity());
}

TEST(InputDesign, EveryDesignPlaysItsRowsInTime) {
  for (const auto& [name, params] : designs()) {
    SCOPED_TRACE(name);
    for (double duration : {0.01, 7.3, 20.0, 100.0}) {
      const InputSignal signal = makeDesign(params, duration);
      EXPECT_EQ(signal.times.front(), 0);
      EXPECT_EQ(signal.end, duration);
      EXPECT_FALSE(signal.has_lift);
      EXPECT_EQ(signal.description, "");
      expectSound(signal);
      expectPlays(signal);
    }
  }
}

TEST(InputDesign, InputsStayWithinTheLevelsAndReachThem) {
  for (auto [name, params] : designs()) {
    params.levels = {0.2, 0.7};
    double low = 1, high = 0;
    for (const Row& row : rowsOf(makeDesign(params, 60)))
      for (double input : row) {
        // single-thruster keeps the other thruster off
        if (name == "single-thruster" && input == 0) continue;
        low = std::min(low, input);
        high = std::max(high, input);
      }
    EXPECT_GE(low, 0.2 - 1e-12) << name;
    EXPECT_LE(high, 0.7 + 1e-12) << name;
    if (name == "multisine") continue;  // a push and a turn have half of the levels each
    EXPECT_EQ(low, 0.2) << name;
    EXPECT_EQ(high, 0.7) << name;
  }
}

TEST(InputDesignOfAnyThrusters, PatternsPushAndTurnTheCraft) {
  const Model table = loadModel("cfg/craft/air_table.yaml");
  const auto wrenches = [&](const std::string& kind) {
    DesignParams params = design(kind);
    params.thrusters = table.thrusters;
    std::vector<Vector3<double>> all;
    for (const Inputs& inputs : makeDesign(params, 8).inputs)
      all.push_back(table.thrusters->total(table.thrusters->forces(inputs.thrusters)));
    return all;
  };
  EXPECT_LT((wrenches("coast-down")[0] - Vector3<double>(2, 0, 0)).norm(), 1e-6);
  EXPECT_EQ(wrenches("coast-down")[1].norm(), 0);
  EXPECT_LT((wrenches("spin")[0] - Vector3<double>(0, 0, 4)).norm(), 1e-6);
  EXPECT_LT((wrenches("spin")[4] + Vector3<double>(0, 0, 4)).norm(), 1e-6);
  EXPECT_LT((wrenches("steps")[2] - Vector3<double>(1, 0, 0)).norm(), 1e-6);
  for (const Vector3<double>& wrench : wrenches("differential-prbs"))
    EXPECT_NEAR(std::abs(wrench.z()), 4, 1e-12);
}

TEST(InputDesignOfAnyThrusters, FilesHaveAColumnForEachChannel) {
  std::vector<Thruster> thrusters = thrusterPair()->thrusters();
  thrusters.push_back(thrusters[0]);
  thrusters[2].name = "bow";
  thrusters[2].channel = "bow_motor";
  thrusters[2].least = -1;
  DesignParams params = inputFile("time,left,right,bow_motor,lift\n0,0.5,0.25,-1,1\n1,0,0,0,0.5\n");
  params.thrusters = std::make_shared<const ThrusterLayout>(thrusters);
  const InputSignal signal = makeDesign(params, 1);
  EXPECT_TRUE(signal.at(0) == Inputs(Thrusters<double>{0.5, 0.25, -1.0}, 1));
  EXPECT_EQ(signal.at(2).thrusters.size(), 3);
  const auto complaint = [&](const std::string& text) {
    params.file = fileWith(text);
    return refusal([&] { makeDesign(params, 1); });
  };
  EXPECT_NE(complaint("time,left,right\n0,0,0\n1,0,0\n").find("not time,left,right,bow_motor or"),
            std::string::npos);
  EXPECT_NE(complaint("1,0\n0,1\n").find("not time,left,right,bow_motor"), std::string::npos);
  EXPECT_NE(complaint("time,left,right,bow_motor\n0,0,0,-2\n1,0,0,0\n")
                .find("inputs must be between -1 and 1 for bow_motor"),
            std::string::npos);
}

TEST(InputFile, BitsAreFoundAndPlayedAtTheClock) {
  std::string text;
  const PrbsBits bits = makePrbs(6, 3);
  for (const auto& bit : bits)
    for (int i = 0; i < 3; ++i) text += std::string(bit[0] ? "1," : "-1,") + (bit[1] ? "1\n" : "-1\n");
  DesignParams params = inputFile(text);
  params.levels = {0.1, 0.8};
  params.clock = 20;
  const InputSignal found = makeDesign(params, 63 / 20.0 + 1);
  expectSound(found);
  expectPlays(found);
  EXPECT_EQ(found.description,
            "189 rows, 3 rows per bit: a clock of 20 Hz plays 60 rows per second, all in 3.15 s");
  for (std::size_t i = 0; i < 63 + 20; ++i) {
    const auto& bit = bits[i % 63];
    const Inputs inputs = found.at((static_cast<double>(i) + 0.5) / 20);
    ASSERT_EQ(inputs.thrusters(0), bit[0] ? 0.8 : 0.1) << i;
    ASSERT_EQ(inputs.thrusters(1), bit[1] ? 0.8 : 0.1) << i;
  }
  params.rows_per_bit = 1;
  const InputSignal slow = makeDesign(params, 1);
  EXPECT_EQ(slow.times.size(), 20u) << "rows_per_bit is used";
  EXPECT_EQ(slow.description.rfind("189 rows, 1 row per bit", 0), 0u) << slow.description;
}

TEST(InputFile, TimedRowsAreHeldUntilTheNext) {
  const InputSignal signal = makeDesign(inputFile(kTimed), 20);
  expectSound(signal);
  expectPlays(signal);
  EXPECT_EQ(signal.times, (std::vector<double>{0, 0.5, 2}));
  EXPECT_EQ(rowsOf(signal), (Rows{{0.2, 0.8}, {0.9, 0}, {0, 0}}));
  EXPECT_EQ(signal.end, 2) << "it ends with its last row, whatever the duration";
  EXPECT_FALSE(signal.has_lift);
  EXPECT_EQ(signal.description, "");
  const InputSignal late = makeDesign(inputFile(" time , left , right\r\n1, 0.5 ,0.25\r\n\n 3,0,0\n"), 20);
  EXPECT_EQ(late.times, (std::vector<double>{1, 3}));
  EXPECT_EQ(late.at(0.5).thrusters(0), 0) << "before the first row";
  EXPECT_EQ(late.nextChange(0), 1);
  EXPECT_EQ(late.at(1).thrusters(0), 0.5);
}

TEST(InputFile, AColumnLiftIsPartOfTheInput) {
  const InputSignal signal = makeDesign(inputFile(kLifted), 20);
  expectSound(signal);
  expectPlays(signal);
  EXPECT_TRUE(signal.has_lift);
  EXPECT_EQ(signal.end, 4);
  EXPECT_EQ(signal.at(2).thrusters(0), 0.5);
  EXPECT_EQ(signal.at(2).thrusters(1), 0.25);
  EXPECT_EQ(signal.at(2).lift, 1);
  EXPECT_EQ(signal.at(3.5).lift, 0.5);
}

TEST(InputFile, ComplaintsNameFileAndLine) {
  const struct {
    std::string text, place, words;
  } cases[] = {
      {"time,left\n0,1\n", ", line 1: ", "the columns are time,left, not time,left,right"},
      {"time,left,right\n0,0,0\n1,x,0\n", ", line 3: ", "'1,x,0' is not all numbers"},
      {"time,left,right\n0,0,0\n\n1,0\n", ", line 4: ", "2 values for 3 columns (time,left,right)"},
      {"time,left,right\n0,0,nan\n1,0,0\n", ", line 2: ", "is not all numbers"},
      {"time,left,right\n-1,0,0\n1,0,0\n", ", line 2: ", "times must ascend from 0 or later"},
      {"time,left,right\n0,0,0\n1,0,0\n1,0,0\n", ", line 4: ", "times must ascend"},
      {"time,left,right\n0,0,0\n1,1.1,0\n", ", line 3: ", "inputs must be between 0 and 1"},
      {"time,left,right\n0,0,0\n3601,0,0\n", ", line 3: ", "inputs may last 3600 s"},
      {"time,left,right\n0,0,0\n", ": ", "only 1 rows"},
      {"1,0\n1,2\n", ", line 2: ", "'1,2' is not LEFT,RIGHT with -1, 0 or 1 each"},
      {"left,right\n1,0\n", ", line 1: ", "the columns are left,right, not time,left,right or"},
  };
  for (const auto& bad : cases) {
    const std::string message = refusal([&] { makeDesign(inputFile(bad.text), 20); });
    EXPECT_NE(message.find("input_design_test.csv" + bad.place), std::string::npos) << bad.text << message;
    EXPECT_NE(message.find(bad.words), std::string::npos) << message;
  }
  const std::string empty = refusal([&] { makeDesign(inputFile("\n"), 20); });
  EXPECT_NE(empty.find("input_design_test.csv is empty"), std::string::npos) << empty;
  DesignParams none = design("file");
  none.file = "no/such/file.csv";
  EXPECT_THROW(makeDesign(none, 20), std::runtime_error);
  none.file = "";
  EXPECT_THROW(makeDesign(none, 20), std::invalid_argument);
}

}  // namespace input_design_test
}  // namespace ground
