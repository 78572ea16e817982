// Whether a reference fits into a room.
#include "ground/control/feasibility.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "ground/safety/fence.h"

namespace ground {
namespace feasibility_test {

using Point = Vector2<double>;

/// A room of 4 x 4 m with its home in the middle.
Room square() {
  Room room;
  room.corners = {{-2, -2}, {2, -2}, {2, 2}, {-2, 2}};
  return room;
}

/// The number before a word in a message.
double numberBefore(const std::string& word, const std::string& message) {
  const std::size_t end = message.find(" " + word), begin = message.rfind(' ', end - 1);
  return std::stod(message.substr(begin + 1, end - begin - 1));
}

TEST(LeavesRoom, NeedsSpaceToStopAfterALossOfTheMocap) {
  // Straight on along the tangent, until latency and friction have ended it.
  for (const double rate : {0.3, 0.6, 1.0, 1.5}) {
    const std::string message = leavesRoom(*makeCircle({0, 0}, 1.5, rate), square());
    const double speed = 1.5 * rate;
    double least = 2;
    for (double angle = 0; angle < 2 * M_PI; angle += 1e-3) {
      const Point along(-std::sin(angle), std::cos(angle));
      const double way = (Fence::kLoss + square().latency) * speed + 0.5 * speed * speed / square().braking;
      const Point end = 1.5 * Point(std::cos(angle), std::sin(angle)) + way * along;
      least = std::min(least, 2 - end.cwiseAbs().maxCoeff());
    }
    if (least > square().margin) {
      EXPECT_EQ(message, "") << speed;
      continue;
    }
    ASSERT_NE(message.find("or too fast near one"), std::string::npos) << message;
    EXPECT_NEAR(numberBefore("m ", message + " "), std::abs(least), 0.006) << message;
    EXPECT_EQ(message.find("outside") != std::string::npos, least < 0) << message;
    const double when = numberBefore("s it is", message);
    EXPECT_GE(when, 0);
    EXPECT_LE(when, 100) << "ten times the extent is seen";
  }
}

TEST(LeavesRoom, SaysTheLargestSizeThatFits) {
  for (const char* kind : {"circle", "rhodonea", "sinusoid"}) {
    ReferenceParams params;
    params.kind = kind;
    params.size = 2;
    params.speed = 0.001;
    const std::string message = leavesRoom(params, *makeReference(params), square());
    ASSERT_NE(message.find("largest size"), std::string::npos) << message;
    params.size = numberBefore("m", message.substr(message.find("largest size")));
    EXPECT_EQ(leavesRoom(params, *makeReference(params), square()), "") << message;
    params.size += 0.02;
    EXPECT_NE(leavesRoom(params, *makeReference(params), square()), "");
  }
  ReferenceParams line;
  line.kind = "line";
  line.end_x = 5;
  EXPECT_EQ(leavesRoom(line, *makeReference(line), square()), leavesRoom(*makeReference(line), square()));
}

}  // namespace feasibility_test
}  // namespace ground
