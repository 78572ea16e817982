// Jumps between two states that are impossible for a craft.
#include "ground/estimation/jump.h"

#include <gtest/gtest.h>

namespace ground {
namespace {

RigidState<double> at(double x, double y, double psi, double u = 0, double v = 0, double r = 0) {
  return {{x, y, psi}, {u, v, r}};
}

TEST(Jump, IsMeasuredFromThePredictedPose) {
  // Bow along y: 1 m/s ahead is along y, 0.5 m/s to starboard is along -x.
  const RigidState<double> from = at(1, 2, M_PI / 2, 1, 0.5, 0.4);
  const Jump none(from, at(0.95, 2.1, M_PI / 2 + 0.04), 0.1);
  EXPECT_NEAR(none.way, 0, 1e-12);
  EXPECT_NEAR(none.turn, 0, 1e-12);
  EXPECT_FALSE(none.impossible());
  const Jump some(from, at(0.95 + 0.3, 2.1 - 0.4, M_PI / 2 - 0.06), 0.1);
  EXPECT_NEAR(some.way, 0.5, 1e-12);
  EXPECT_NEAR(some.turn, 0.1, 1e-12);
}

TEST(Jump, WrapsHeadings) {
  EXPECT_NEAR(Jump(at(0, 0, 3.1), at(0, 0, -3.1), 0.01).turn, 2 * M_PI - 6.2, 1e-12);
  EXPECT_NEAR(Jump(at(0, 0, 0.1), at(0, 0, 0.1 + 4 * M_PI), 0.01).turn, 0, 1e-12);
}

TEST(Jump, MoreIsPossibleInMoreTime) {
  const auto impossible = [](double way, double turn, double dt) {
    return Jump(at(0, 0, 0), at(way, 0, turn), dt).impossible();
  };
  EXPECT_FALSE(impossible(0.2, 0.6, 0.01));
  EXPECT_TRUE(impossible(0.3, 0, 0.01));
  EXPECT_TRUE(impossible(0, 0.8, 0.01));
  EXPECT_FALSE(impossible(0.3, 0.8, 0.1));
  EXPECT_TRUE(impossible(1.0, 0, 0.1));
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
