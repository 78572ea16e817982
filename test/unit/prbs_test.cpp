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
    // Every window of `order` bits but all zeros occurs exactly once in a period.
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

TEST(Prbs, AppliesEachBitForExactlyItsTime) {
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
  EXPECT_EQ(readPrbs(fileWith("-1,1\n1,-1\n1,1\n")), expected);
  EXPECT_EQ(readPrbs(fileWith("0, 1\r\n1.0,0\r\n\n1,1")), expected);
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
