// Pseudo-random binary sequences and how they are played.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <set>

#include "../crafts.h"
#include "ground/control/input_design.h"

namespace ground {
namespace prbs_test {

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
  EXPECT_EQ(readPrbs(fileWith("1,0\n1,0\n0,1\n0,1\n1,0\n1,0\n")).rows_per_bit, 1) << "too short to judge";
  EXPECT_EQ(readPrbs(fileWith(recorded(makePrbs(6, 3), 4, 0)), 2).rows_per_bit, 2) << "as given";
  EXPECT_THROW(readPrbs(fileWith("1,0\n"), -1), std::invalid_argument);
  EXPECT_EQ(PrbsFile({PrbsBits(900), 3}).describe(15),
            "900 rows, 3 rows per bit: a clock of 15 Hz plays 45 rows per second, all in 20 s");
}

TEST(PrbsFile, ComplaintsNameFileAndLine) {
  for (const char* text : {"1,0\n1\n", "1,0\n1,x\n", "1,0\n2,0\n", "1,0\n1,0,1\n", "1,0\nleft,right\n"}) {
    const std::string said = refusal([&] { readPrbs(fileWith(text)); });
    EXPECT_NE(said.find("prbs_test.csv, line 2"), std::string::npos) << text << said;
  }
  EXPECT_THROW(readPrbs(fileWith("\n")), std::runtime_error);
  EXPECT_THROW(readPrbs("no/such/file.csv"), std::runtime_error);
}

}  // namespace prbs_test
}  // namespace ground
