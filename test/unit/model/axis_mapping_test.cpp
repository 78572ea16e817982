// Conversion between the mocap's frame and world_ned.
#include "ground/estimation/axis_mapping.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "../crafts.h"
#include "ground/model/simulation.h"

namespace ground {
namespace axis_mapping_test {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Every order and sign of the three axes.
std::vector<std::string> allAxes() {
  std::vector<std::string> all;
  for (const char* order : {"xyz", "xzy", "yxz", "yzx", "zxy", "zyx"})
    for (int signs = 0; signs < 8; ++signs) {
      std::string axes;
      for (int i = 0; i < 3; ++i) axes += std::string(i ? ", " : "") + (signs >> i & 1 ? "-" : "") + order[i];
      all.push_back(axes);
    }
  return all;
}

std::string refusalOf(const std::string& axes) {
  return refusal([&] { AxisMapping mapping(axes); });
}
bool accepted(const std::string& axes) { return refusalOf(axes).empty(); }

TEST(AxisMapping, LeftThrustAloneTurnsClockwiseSeenFromAboveInOptiTrack) {
  const Model model = tinyWhoover();
  const Dynamics<double> dynamics(model);
  InputSequence inputs;
  inputs.add(0, 1, 0, 1);
  Simulation<double> simulation(dynamics, inputs, {}, 0.0);
  simulation.advance(0.3);
  const Vector3<double> eta = simulation.state().eta;
  EXPECT_GT(eta.z(), 0.1);
  Vector3d position;
  Quaterniond orientation;
  AxisMapping().toMocap(eta, 0.04, position, orientation);
  // y points up: seen from above, clockwise is the negative sense.
  const AngleAxisd turn(orientation);
  EXPECT_NEAR(turn.angle() * turn.axis().y(), -eta.z(), 1e-12);
  EXPECT_DOUBLE_EQ(position.y(), 0.04);
}

TEST(AxisMapping, RoundTripsAreExactInEveryFrame) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform(-5, 5);
  int frames = 0;
  for (const std::string& axes : allAxes()) {
    if (!accepted(axes)) continue;
    ++frames;
    for (double offset : {0.0, 1.3, -3.0}) {
      const AxisMapping mapping(axes, offset);
      for (int i = 0; i < 20; ++i) {
        const Vector3<double> eta(uniform(random), uniform(random), uniform(random));
        Vector3d position;
        Quaterniond orientation;
        mapping.toMocap(eta, 0.1, position, orientation);
        EXPECT_NEAR(orientation.norm(), 1, 1e-14);
        const auto back = mapping.toPlanar(position, orientation);
        ASSERT_TRUE(back) << axes;
        EXPECT_EQ(back->x(), eta.x()) << axes;
        EXPECT_EQ(back->y(), eta.y()) << axes;
        EXPECT_NEAR(wrapAngle(back->z() - eta.z()), 0, 4e-15) << axes;
        // q and -q are the same rotation.
        orientation.coeffs() *= -1;
        EXPECT_NEAR(wrapAngle(mapping.toPlanar(position, orientation)->z() - eta.z()), 0, 4e-15);
      }
    }
  }
  EXPECT_EQ(frames, 24);  // half of all orders and signs are right-handed
}

TEST(AxisMapping, HeadingIsTheDirectionOfTheBowWhenTheCraftRollsAndPitches) {
  const AxisMapping mapping("x, y, z");
  for (double tilt : {-0.2, 0.15}) {
    const Quaterniond pose = AngleAxisd(0.9, Vector3d::UnitZ()) * AngleAxisd(tilt, Vector3d::UnitY()) *
                             AngleAxisd(2 * tilt, Vector3d::UnitX());
    EXPECT_NEAR(mapping.toPlanar(Vector3d::Zero(), pose)->z(), 0.9, 1e-14);
  }
}

TEST(AxisMapping, GivesTheReasonForABadPose) {
  const AxisMapping mapping;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  const auto why = [&mapping](const Vector3d& position, const Quaterniond& orientation) {
    const char* reason = "";
    EXPECT_FALSE(mapping.toPlanar(position, orientation));  // the argument is optional
    EXPECT_FALSE(mapping.toPlanar(position, orientation, &reason));
    return std::string(reason);
  };
  const Quaterniond level = Quaterniond::Identity();
  EXPECT_EQ(why({nan, 0, 0}, level), "the pose is not finite");
  EXPECT_EQ(why({0, inf, 0}, level), "the pose is not finite");
  EXPECT_EQ(why({0, 0, 0}, Quaterniond(1, nan, 0, 0)), "the pose is not finite");
  EXPECT_NE(why({0, 0, 0}, Quaterniond(0, 0, 0, 0)).find("unit quaternion"), std::string::npos);
  EXPECT_NE(why({0, 0, 0}, Quaterniond(2, 0, 0, 0)).find("unit quaternion"), std::string::npos);
  const Quaterniond on_its_side(AngleAxisd(M_PI / 2, Vector3d::UnitX()));
  EXPECT_NE(why({0, 0, 0}, on_its_side).find("leans too far"), std::string::npos);
  const Quaterniond upright(AngleAxisd(M_PI / 2, Vector3d::UnitZ()));
  EXPECT_NE(why({0, 0, 0}, upright).find("leans too far"), std::string::npos);
}

TEST(AxisMapping, RefusesAxesThatAreNotRightHanded) {
  for (const char* axes : {"", "x", "x, z", "x, z, -y, x", "x, z, -y,", "x, x, y", "a, b, c", "x, z, --y",
                           "x z -y", "x, z, -", "xx, z, -y", "X, Z, -Y"})
    EXPECT_FALSE(accepted(axes)) << axes;
  EXPECT_NE(refusalOf("x, z, y").find("'x, z, y'"), std::string::npos);
  EXPECT_NE(refusalOf("x, z, y").find("right-handed"), std::string::npos);
  EXPECT_THROW(AxisMapping("x, z, -y", NAN), std::invalid_argument);
  EXPECT_TRUE(accepted("+x,z,-y"));
  EXPECT_TRUE(accepted("  x , z , -y  "));
}

}  // namespace axis_mapping_test
}  // namespace ground
