// Pseudo-random binary sequences and how they are played.
#include "ground/control/prbs.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <set>

namespace ground {
namespace {

TEST(Prbs, HasMaximumLengthForEveryOrder) {
  for (int order = 2; order <= 20; ++order) {
    const PrbsBits bits = makePrbs(order, 0);
    const std::size_t period = (std::size_t{1} << order) - 1;
    ASSERT_EQ(bits.size(), period);
    // Every window of `order` bits except all zeros occurs exactly once in a period.
    std::set<std::size_t> windows;
    std::size_t window = 0;
    for (std::size_t i = 0; i < period + order - 1; ++i) {
      window = ((window << 1) | bits[i % period][0]) & period;
      if (i + 1 >= static_cast<std::size_t>(order)) windows.insert(window);
    }
    EXPECT_EQ(windows.size(), period) << "order " << order;
    EXPECT_EQ(windows.count(0), 0u);
  }
}

TEST(Prbs, ChannelsAreUncorrelated) {
  const PrbsBits bits = makePrbs(9, 3);
  double sum = 0;
  for (const auto& bit : bits) sum += (bit[0] ? 1 : -1) * (bit[1] ? 1 : -1);
  EXPECT_LE(std::abs(sum / bits.size()), 1.0 / bits.size() + 1e-12);
}

TEST(Prbs, SeedChoosesTheSequence) {
  EXPECT_EQ(makePrbs(8, 5), makePrbs(8, 5));
  EXPECT_NE(makePrbs(8, 5), makePrbs(8, 6));
  EXPECT_THROW(makePrbs(1, 0), std::invalid_argument);
  EXPECT_THROW(makePrbs(21, 0), std::invalid_argument);
}

TEST(Prbs, HoldsEachBitForExactlyItsTime) {
  const PrbsBits bits = makePrbs(7, 1);
  PrbsParams params;
  params.clock = 15;
  params.left_low = 0.1;
  params.left_high = 0.8;
  params.right_low = 0.2;
  params.right_high = 0.9;
  params.duration = 100;  // several periods
  const PrbsSignal signal(bits, params);
  double t = 0;
  for (int i = 0; i < 1500; ++i) {
    const auto& bit = bits[i % bits.size()];
    const Vector2<double> expected(bit[0] ? 0.8 : 0.1, bit[1] ? 0.9 : 0.2);
    EXPECT_EQ(signal.at(t), expected) << i;
    EXPECT_EQ(signal.at(t + 0.9999 / 15), expected) << i;
    const double next = signal.nextChange(t);
    EXPECT_DOUBLE_EQ(next, (i + 1) / 15.0);
    t = next;
  }
  EXPECT_EQ(signal.at(100).norm(), 0);
  EXPECT_EQ(signal.at(-0.1).norm(), 0);
  EXPECT_EQ(signal.at(std::nan("")).norm(), 0);
  EXPECT_EQ(signal.nextChange(100), std::numeric_limits<double>::infinity());
}

TEST(Prbs, EndsInsideABit) {
  PrbsParams params;
  params.clock = 10;
  params.duration = 0.25;
  const PrbsSignal signal({{{true, true}}}, params);
  EXPECT_EQ(signal.at(0.249), Vector2<double>(1, 1));
  EXPECT_EQ(signal.nextChange(0.2), 0.25);
  EXPECT_EQ(signal.at(0.25).norm(), 0);
}

TEST(Prbs, RefusesBadParameters) {
  PrbsParams params;
  params.clock = 0;
  EXPECT_THROW(PrbsSignal(makePrbs(5, 0), params), std::invalid_argument);
  params.clock = 10;
  params.left_low = 2;
  EXPECT_THROW(PrbsSignal(makePrbs(5, 0), params), std::invalid_argument);
  EXPECT_THROW(PrbsSignal({}, PrbsParams()), std::invalid_argument);
}

std::string fileWith(const std::string& text) {
  const std::string path = testing::TempDir() + "prbs_test.csv";
  std::ofstream(path) << text;
  return path;
}

TEST(PrbsFile, ReadsBothConventions) {
  const PrbsBits expected = {{{false, true}}, {{true, false}}, {{true, true}}};
  EXPECT_EQ(readPrbs(fileWith("-1,1\n1,-1\n1,1\n")).rows, expected);
  EXPECT_EQ(readPrbs(fileWith("0, 1\r\n1.0,0\r\n\n1,1")).rows, expected);
}

/// File text of the sequence with `rows_per_bit` rows per bit, without the first `late` rows.
std::string recorded(const PrbsBits& bits, int rows_per_bit, int late) {
  std::string text;
  for (int row = late; row < rows_per_bit * static_cast<int>(bits.size()); ++row) {
    const auto& bit = bits[row / rows_per_bit];
    text += std::string(bit[0] ? "1," : "-1,") + (bit[1] ? "1\n" : "-1\n");
  }
  return text;
}

TEST(PrbsFile, FindsTheRowsPerBit) {
  for (int rows_per_bit : {1, 2, 3, 5, 12}) {
    for (int late : {0, rows_per_bit - 1}) {
      const PrbsFile file = readPrbs(fileWith(recorded(makePrbs(6, 3), rows_per_bit, late)));
      EXPECT_EQ(file.rows_per_bit, rows_per_bit) << late << " rows late";
      EXPECT_EQ(file.rows.size(), 63u * rows_per_bit - late);
    }
  }
  EXPECT_EQ(readPrbs(fileWith("1,0\n1,0\n0,1\n0,1\n1,0\n1,0\n")).rows_per_bit, 1)
      << "too short to judge";
  EXPECT_EQ(readPrbs(fileWith(recorded(makePrbs(6, 3), 4, 0)), 2).rows_per_bit, 2) << "as given";
  EXPECT_THROW(readPrbs(fileWith("1,0\n"), -1), std::invalid_argument);
  EXPECT_EQ(PrbsFile({PrbsBits(900), 3}).describe(15),
            "900 rows, 3 rows per bit: a clock of 15 Hz plays 45 rows per second, all in 20 s");
}

TEST(PrbsFile, AsksEveryWholeRunForTheRowsPerBit) {
  // The first and the last run may have been cut; all others count, wherever they are.
  for (const std::size_t odd : {1, 15, 28, 99}) {  // 99: none is odd
    PrbsBits rows;
    for (std::size_t run = 0; run < 30; ++run) {
      const bool cut = run == 0 || run == 29;
      rows.insert(rows.end(), cut ? 1 : run == odd ? 3 : 4, {run % 2 == 0, run % 2 == 1});
    }
    EXPECT_EQ(rowsPerBit(rows), odd == 99 ? 4 : 1) << "run " << odd;
  }
}

/// Shortest time between two changes of the inputs [s].
double shortestHold(const PrbsSignal& signal, double until) {
  double shortest = until, last = 0;
  for (double t = 0; t < until; t = signal.nextChange(t)) {
    if (t == 0 || signal.at(t) == signal.at(t - 1e-6)) continue;
    if (last > 0) shortest = std::min(shortest, t - last);
    last = t;
  }
  return shortest;
}

TEST(PrbsFile, ClockIsBitsPerSecondForAnyNumberOfRowsPerBit) {
  const PrbsBits bits = makePrbs(7, 2);
  const PrbsFile file = readPrbs(fileWith(recorded(bits, 3, 0)));
  PrbsParams params;
  params.duration = 127 / params.clock;
  const PrbsSignal direct(bits, params), read(file.rows, params, file.rows_per_bit);
  for (int i = 0; i < 3 * 127; ++i) {
    const double middle = (i + 0.5) / (3 * params.clock);
    ASSERT_EQ(read.at(middle), direct.at(middle)) << "row " << i;
  }
  EXPECT_THROW(PrbsSignal(bits, params, 0), std::invalid_argument);
}

TEST(PrbsFile, SequencesOfTheRealExperimentsPlayAtTheirClock) {
  // The clock is that of the file's name; rows per bit and rows are counted by hand.
  const struct {
    int clock, rows_per_bit, rows;
  } files[] = {{10, 5, 501}, {15, 3, 801}, {20, 2, 801}, {25, 2, 501}, {50, 1, 1001}};
  for (const auto& real : files) {
    const std::string path =
        "../shared/data/epfl_2019/differential_prbs_" + std::to_string(real.clock) + "Hz.csv";
    if (!std::ifstream(path)) GTEST_SKIP() << path << " is not beside the workspace";
    const PrbsFile file = readPrbs(path);
    EXPECT_EQ(file.rows_per_bit, real.rows_per_bit) << path;
    EXPECT_EQ(static_cast<int>(file.rows.size()), real.rows) << path;
    PrbsParams params;
    params.clock = real.clock;
    const PrbsSignal signal(file.rows, params, file.rows_per_bit);
    EXPECT_NEAR(shortestHold(signal, 10), 1.0 / real.clock, 1e-9) << path;
  }
}

TEST(PrbsFile, ComplaintsNameFileAndLine) {
  for (const char* text :
       {"1,0\n1\n", "1,0\n1,x\n", "1,0\n2,0\n", "1,0\n1,0,1\n", "1,0\nleft,right\n"}) {
    try {
      readPrbs(fileWith(text));
      ADD_FAILURE() << text;
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find("prbs_test.csv, line 2"), std::string::npos)
          << error.what();
    }
  }
  EXPECT_THROW(readPrbs(fileWith("\n")), std::runtime_error);
  EXPECT_THROW(readPrbs("no/such/file.csv"), std::runtime_error);
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
