#include "ground/safety/room.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "ground/model/text_file.h"
#include "ground/model/yaml_keys.h"

namespace ground {
namespace {

constexpr char kRoomSchema[] = "ground/room/1";
constexpr std::size_t kLargestRoom = 1000000;  // [bytes]
constexpr std::size_t kMaxCorners = 1000;
constexpr double kMinAdvance = 0.005;  // smallest distance between samples of a way [m]

using Position = Vector2<double>;

double cross(const Position& a, const Position& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Vector from the nearest point of a wall to a point.
Position fromWall(const Position& point, const Position& from, const Position& to) {
  const Position along = to - from;
  const double share = std::clamp((point - from).dot(along) / along.squaredNorm(), 0.0, 1.0);
  return point - (from + share * along);
}

/// Whether two walls touch or cross.
bool meet(const Position& a, const Position& b, const Position& c, const Position& d) {
  const auto side = [](const Position& p, const Position& q, const Position& r) {
    return cross(q - p, r - p);
  };
  if (side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0) return true;
  return fromWall(a, c, d).isZero(0) || fromWall(b, c, d).isZero(0) || fromWall(c, a, b).isZero(0) ||
         fromWall(d, a, b).isZero(0);
}

/// Error message for the corners of a room; empty if they are valid.
std::string wrongCorners(const std::vector<Position>& corners) {
  if (corners.size() < 3 || corners.size() > kMaxCorners) return "a room needs between 3 and 1000 corners";
  for (const Position& corner : corners)
    if (!corner.allFinite() || corner.norm() > 1e4) return "a corner is farther than 10 km away";
  const std::size_t n = corners.size();
  for (std::size_t i = 0; i < n; ++i)
    if ((corners[(i + 1) % n] - corners[i]).norm() < 1e-3) return "two neighbouring corners are the same";
  for (std::size_t i = 0; i < n; ++i) {
    const Position &a = corners[i], &b = corners[(i + 1) % n];
    for (std::size_t j = i + 2; j < n; ++j)
      if ((j + 1) % n != i && meet(a, b, corners[j], corners[(j + 1) % n]))
        return "walls cross: list the corners in order";
  }
  return "";
}

}  // namespace

std::string Room::validate() const {
  const auto within = [](double x, double low, double high) { return x >= low && x <= high; };
  const std::string wrong = wrongCorners(corners);
  if (!wrong.empty()) return wrong;
  if (!within(margin, 0, 100)) return "margin must be between 0 and 100 m";
  if (!within(braking, 0.05, 50)) return "braking must be between 0.05 and 50 m/s^2";
  if (!within(latency, 0, 2)) return "latency must be between 0 and 2 s";
  if (!home.allFinite() || !(clearance(home) > margin))
    return "home must be inside, farther than margin from the walls";
  return "";
}

double Room::clearance(const Position& point, Position& away) const {
  double nearest = std::numeric_limits<double>::infinity();
  bool inside = false;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Position &a = corners[i], &b = corners[(i + 1) % corners.size()];
    const Position from_wall = fromWall(point, a, b);
    if (from_wall.squaredNorm() < nearest) {
      nearest = from_wall.squaredNorm();
      away = from_wall;
    }
    // A ray to the right of the point crosses this wall.
    if ((a.y() > point.y()) != (b.y() > point.y()) &&
        point.x() < a.x() + (b.x() - a.x()) * (point.y() - a.y()) / (b.y() - a.y()))
      inside = !inside;
  }
  const double distance = inside ? std::sqrt(nearest) : -std::sqrt(nearest);
  if (distance != 0) away /= distance;
  return distance;
}

double Room::clearance(const Position& point) const {
  Position away;
  return clearance(point, away);
}

double Room::clearanceOfWay(const Position& from, const Position& to) const {
  const double length = (to - from).norm();
  if (!std::isfinite(length)) return -std::numeric_limits<double>::infinity();
  double least = std::min(clearance(from), clearance(to));
  // Clearance changes by at most one metre per metre: the next sample is where it may be smaller.
  for (double way = 0; way < length;) {
    const double here = clearance(from + way / length * (to - from));
    least = std::min(least, here);
    way += std::max(kMinAdvance, here - least);
  }
  return least;
}

Room loadRoom(const std::string& path) { return parseRoom(readTextFile(path, kLargestRoom), path); }

Room parseRoom(const std::string& yaml, const std::string& source) {
  const YamlReader reader(source);
  const YAML::Node root = reader.parse(yaml);
  std::string schema = reader.requireSchema(root, kRoomSchema, "room file");
  Room room;
  std::vector<std::array<double, 2>> corners;
  YamlKeys keys(reader, "the room file");
  keys.word("schema", schema);
  keys.value("name", room.name);
  keys.value("corners", corners);
  keys.value("margin", room.margin);
  keys.pair("home", room.home.x(), room.home.y());
  keys.value("braking", room.braking);
  keys.value("latency", room.latency);
  keys.read(root);
  room.corners.clear();
  for (const auto& [x, y] : corners) room.corners.emplace_back(x, y);
  const std::string wrong = room.validate();
  if (!wrong.empty()) {
    // The message begins with the key, unless it is about the corners.
    const std::string key = wrong.substr(0, wrong.find(' '));
    reader.fail(root[key] ? root[key] : root["corners"] ? root["corners"] : root, wrong);
  }
  return room;
}

}  // namespace ground
