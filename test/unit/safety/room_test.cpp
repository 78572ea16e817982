// A room's plan: distances from its walls, room files, and the fence that keeps a craft inside.
#include "ground/safety/room.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <random>

#include "../crafts.h"
#include "ground/model/simulation.h"
#include "ground/safety/fence.h"

namespace ground {
namespace room_test {

using Point = Vector2<double>;
using Points = std::vector<Point>;

/// A room of 4 x 4 m with its home in the middle.
Room square() {
  Room room;
  room.corners = {{-2, -2}, {2, -2}, {2, 2}, {-2, 2}};
  return room;
}

/// An L-shaped room of 4 x 4 m without its quarter x > 0, y > 0.
Room lShaped() {
  Room room;
  room.corners = {{-2, -2}, {2, -2}, {2, 0}, {0, 0}, {0, 2}, {-2, 2}};
  room.home = {-1, -1};
  return room;
}

/// A star around the origin: a simple polygon, rarely convex.
Room star(std::mt19937_64& random, int corners) {
  std::uniform_real_distribution<double> radius(0.5, 3), shift(-0.3, 0.3);
  Room room;
  room.corners.clear();
  for (int i = 0; i < corners; ++i) {
    const double angle = 2 * M_PI * (i + shift(random)) / corners;
    room.corners.emplace_back(radius(random) * Point(std::cos(angle), std::sin(angle)));
  }
  if (random() % 2 == 0) std::reverse(room.corners.begin(), room.corners.end());
  return room;
}

std::vector<Room> rooms() {
  std::vector<Room> all = {square(), lShaped()};
  std::mt19937_64 random(7);
  for (int i = 0; i < 30; ++i) all.push_back(star(random, 5 + i % 8));
  return all;
}

Point somewhere(std::mt19937_64& random, double reach = 3.5) {
  std::uniform_real_distribution<double> uniform(-reach, reach);
  const double x = uniform(random);
  return {x, uniform(random)};
}

TEST(Room, ClearanceIsTheDistanceFromTheNearestWallNegativeOutside) {
  const Room plain = square(), corner = lShaped();
  const struct {
    const Room& room;
    Point point;
    double clearance;
  } cases[] = {{plain, {0, 0}, 2},        {plain, {1.5, 0.2}, 0.5},   {plain, {3, 0}, -1},
               {plain, {3, 3}, -M_SQRT2}, {corner, {0.3, 0.5}, -0.3}, {corner, {-1, 1}, 1},
               {corner, {1, -0.4}, 0.4},  {corner, {-0.3, -0.4}, 0.5}};
  for (const auto& [room, point, clearance] : cases)
    EXPECT_NEAR(room.clearance(point), clearance, 1e-12) << point.transpose();
}

TEST(Room, ClearanceOfAPathIsItsSmallestClearance) {
  std::mt19937_64 random(3);
  int narrower_than_its_ends = 0;
  for (const Room& room : rooms()) {
    for (int i = 0; i < 30; ++i) {
      Point from = somewhere(random), to = somewhere(random);
      while (i % 3 > 0 && room.clearance(from) < 0.05) from = somewhere(random);
      while (i % 3 > 0 && room.clearance(to) < 0.05) to = somewhere(random);
      double least = std::numeric_limits<double>::infinity();
      for (int k = 0; k <= 7000; ++k)
        least = std::min(least, room.clearance(from + k / 7000.0 * (to - from)));
      const double found = room.clearanceOfWay(from, to);
      ASSERT_NEAR(found, least, 0.005) << from.transpose() << " to " << to.transpose();
      EXPECT_DOUBLE_EQ(room.clearanceOfWay(from, from), room.clearance(from));
      const double ends = std::min(room.clearance(from), room.clearance(to));
      EXPECT_LE(found, ends) << from.transpose() << " to " << to.transpose();
      narrower_than_its_ends += least < ends - 0.05;
    }
  }
  EXPECT_GT(narrower_than_its_ends, 40);
}

/// A room file; `lines` replace those that start with the same word, and are added otherwise.
std::string roomFile(const std::vector<std::string>& lines) {
  std::vector<std::string> text = {
      "schema: ground/room/1", "name: test",        "corners: [[-2, -2], [2, -2], [2, 2], [-2, 2]]",
      "margin: 0.3",           "home: [0.5, -0.5]", "braking: 1.2",
      "latency: 0.15"};
  for (const std::string& line : lines) {
    const std::string word = line.substr(0, line.find(':') + 1);
    const auto at = std::find_if(text.begin(), text.end(), [&](const std::string& old) {
      return old.compare(0, word.size(), word) == 0;
    });
    if (at == text.end()) {
      text.push_back(line);
    } else {
      *at = line;
    }
  }
  const std::string path = testing::TempDir() + "room_plan_test.yaml";
  std::ofstream file(path);
  for (const std::string& line : text) file << line << "\n";
  return path;
}

std::string complaintOf(const std::string& path) {
  return refusal([&] { loadRoom(path); });
}

TEST(RoomFile, ComplaintsNameFileLineAndKey) {
  const struct {
    std::string line, place, words;
  } cases[] = {
      {"schema: ground/model/1", "line 1", "schema: ground/room/1"},
      {"corners: 5", "line 3", "corners must be a list"},
      {"corners: [[-2, -2], [2, -2], [2, 2, 1], [-2, 2]]", "line 3", "corners must be a list of 2 numbers"},
      {"corners: [[-2, -2], [2, -2], [2, x], [-2, 2]]", "line 3", "corners must be a number"},
      {"margin: wide", "line 4", "margin must be a number"},
      {"margin: .nan", "line 4", "margin must not be NaN"},
      {"home: 0", "line 5", "home must be a list of 2 numbers"},
      {"home: [0]", "line 5", "home must be a list of 2 numbers"},
      {"braking: [1]", "line 6", "braking must be a number"},
      {"latency: {}", "line 7", "latency must be a number"},
      {"height: 3", "line 8", "unknown key 'height'"},
      {"name : again", "line 8", "duplicate key 'name'"},
      {"name: [a]", "line 2", "name must be"},
      {"margin: [", "line ", ""},
  };
  for (const auto& bad : cases) {
    const std::string message = complaintOf(roomFile({bad.line}));
    const std::string place = "room_plan_test.yaml, " + bad.place;
    EXPECT_NE(message.find(place), std::string::npos) << bad.line << ": " << message;
    EXPECT_NE(message.find(bad.words), std::string::npos) << bad.line << ": " << message;
  }
}

RigidState<double> moving(const Point& at, double psi, double u, double v) {
  RigidState<double> state;
  state.eta << at, psi;
  state.nu << u, v, 1.3;
  return state;
}

/// Position at rest of a craft that coasts for `coasting` [s] and is then braked, simulated.
Point simulatedRest(const RigidState<double>& state, double coasting, double braking) {
  const double psi = state.eta.z(), u = state.nu.x(), v = state.nu.y();
  Point velocity(std::cos(psi) * u - std::sin(psi) * v, std::sin(psi) * u + std::cos(psi) * v);
  Point at = state.eta.head<2>();
  constexpr double dt = 1e-4;
  for (double t = 0; t < coasting - dt / 2; t += dt) at += dt * velocity;
  while (velocity.norm() > 0) {
    const double slower = std::max(0.0, velocity.norm() - braking * dt);
    const Point after = slower * velocity.normalized();
    at += 0.5 * dt * (velocity + after);
    velocity = after;
  }
  return at;
}

TEST(Fence, RestIsTheStoppingPositionOfABrakedCraft) {
  Room room = square();
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> speed(-2, 2), angle(-4, 4), time(0, 0.5);
  for (int i = 0; i < 50; ++i) {
    room.braking = 0.5 + time(random) * 5;
    room.latency = time(random);
    const double age = time(random);
    const double u = speed(random), v = speed(random);
    const RigidState<double> state = moving(somewhere(random), angle(random), u, v);
    const Point expected = simulatedRest(state, room.latency + age, room.braking);
    EXPECT_LT((Fence(room, 0.2).stoppingPoint(state, age) - expected).norm(), 1e-3);
  }
}

TEST(Fence, ExcessIsMarginMinusClearanceAtRestWithExactDerivatives) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> speed(-2, 2), angle(-4, 4);
  constexpr double h = 1e-6;
  int positive = 0, none = 0;
  for (const Room& room : {square(), lShaped()}) {
    const Fence fence(room, 0.25);
    for (int i = 0; i < 1000; ++i) {
      const double u = speed(random), v = speed(random);
      const RigidState<double> state = moving(somewhere(random, 2), angle(random), u, v);
      Eigen::Matrix<double, 1, 5> derivative;
      const double excess = fence.violation(state, 0.1, derivative);
      const double expected = 0.25 - room.clearance(fence.stoppingPoint(state, 0.1));
      EXPECT_NEAR(excess, std::max(0.0, expected), 1e-12);
      if (excess == 0) {
        ++none;
        continue;
      }
      const auto off = [&](int j, double by) {
        RigidState<double> other = state;
        (j < 3 ? other.eta(j) : other.nu(j - 3)) += by;
        return 0.25 - room.clearance(fence.stoppingPoint(other, 0.1));
      };
      // Skips states whose rest is equally near to two walls, where there is no derivative.
      Eigen::Matrix<double, 1, 5> differences;
      bool smooth = true;
      for (int j = 0; j < 5; ++j) {
        const double right = (off(j, h) - off(j, 0)) / h, left = (off(j, 0) - off(j, -h)) / h;
        smooth = smooth && std::abs(right - left) < 1e-3;
        differences(j) = 0.5 * (left + right);
      }
      if (!smooth) continue;
      ASSERT_LT((derivative - differences).norm(), 1e-3 * (1 + differences.norm()));
      ++positive;
    }
  }
  EXPECT_GT(positive, 500);
  EXPECT_GT(none, 100);
}

TEST(Fence, ObjectsToLeavingTheRoomWithAReason) {
  const Fence fence(square(), 0.2);
  const auto objection = [&](const Point& at, double u, double age) {
    return fence.objection(moving(at, 0, u, 0), age);  // u points to the wall x = 2
  };
  EXPECT_EQ(objection({0, 0}, 0, 0), "");
  EXPECT_EQ(objection({1.5, 0}, 0, 0), "");
  EXPECT_EQ(objection({1.85, 0}, 0, 0), "the craft is 0.15 m from a wall of the room");
  EXPECT_EQ(objection({1.85, 0}, -1, 0), "the craft is 0.15 m from a wall of the room");
  EXPECT_EQ(objection({2.25, 0}, 0, 0), "the craft is 0.25 m outside of the room");
  EXPECT_EQ(objection({2.25, 0}, -1, 0), "the craft is 0.25 m outside of the room");
  // 1 m/s needs 0.1 m of latency and 1 / (2 * 1.5) m of braking.
  EXPECT_EQ(objection({1.3, 0}, 1, 0), "");
  EXPECT_EQ(objection({1.5, 0}, 1, 0),
            "the craft would come to rest 0.07 m from a wall of the room if it were stopped later");
  EXPECT_EQ(objection({1.7, 0}, 1, 0),
            "the craft would come to rest 0.13 m outside of the room if it were stopped later");
  EXPECT_EQ(objection({1.7, 0}, -1, 0), "") << "it moves inward";
  // The older the state, the farther it may have gone.
  EXPECT_EQ(objection({1.3, 0}, 1, 0.05), "");
  EXPECT_EQ(objection({1.3, 0}, 1, 0.2),
            "the craft would come to rest 0.07 m from a wall of the room if it were stopped later");
}

TEST(Fence, AnImpossibleSpeedIsAnObjectionAndNotAnEndlessSearch) {
  const Fence fence(square(), 0.2);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> exponent(100, 308), heading(-3, 3);
  for (int i = 0; i < 200; ++i) {
    const double speed = std::pow(10, exponent(random)), sign = i % 2 ? 1 : -1;
    RigidState<double> state = moving({0.1, 0.2}, heading(random), sign * speed, i % 3 ? speed : 0);
    EXPECT_NE(fence.objection(state, 0.1), "") << speed;
  }
}

}  // namespace room_test
}  // namespace ground
