#include "ground/model/thruster.h"

#include <algorithm>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "arguments.h"
#include "ground/model/shortened.h"

namespace ground {
namespace {

constexpr double kSmallForce = 1e-12;             // relative to full force: that of rounding
constexpr std::size_t kLongestThrusterName = 40;  // [characters]

/// Cosine of an angle [deg], exact at multiples of 90.
double cosine(double degrees) {
  const double rest = std::abs(std::remainder(degrees, 360));
  if (rest == 90) return 0;
  if (rest == 180) return -1;
  return std::cos(rest * M_PI / 180);
}

[[noreturn]] void fail(const Thruster& thruster, const std::string& what) {
  throw std::invalid_argument("thruster " + shortened(thruster.name) + ": " + what);
}

std::string text(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

/// The relative force that a table has at input 0, to the precision of its sum.
double atZero(const std::vector<std::array<double, 2>>& table) {
  double force = table.front()[1];
  for (std::size_t i = 1; i < table.size(); ++i) {
    const double width = table[i][0] - table[i - 1][0];
    force += (table[i][1] - table[i - 1][1]) * std::clamp(-table[i - 1][0] / width, 0.0, 1.0);
  }
  return force;
}

void validateTable(const Thruster& thruster) {
  const auto& table = thruster.curve.table;
  if (table.empty()) return;
  if (table.size() < 2) fail(thruster, "the table of its curve needs two points or more");
  for (std::size_t i = 0; i < table.size(); ++i) {
    if (!std::isfinite(table[i][0]) || !std::isfinite(table[i][1]))
      fail(thruster, "a number in the table of its curve is not finite");
    if (i > 0 && (table[i][0] <= table[i - 1][0] || table[i][1] < table[i - 1][1]))
      fail(thruster,
           "inputs in the table of its curve must ascend and forces must not fall, as "
           "they do at " +
               text(table[i][0]));
  }
  if (table.front()[0] > thruster.least || table.back()[0] < thruster.most)
    fail(thruster, "the table of its curve must reach from " + text(thruster.least) + " to " +
                       text(thruster.most) + ", its range");
  if (std::abs(atZero(table)) > kSmallForce)
    fail(thruster, "the table of its curve must have no force at input 0; add [0, 0]");
}

std::vector<Thruster> leftAndRight() {
  Thruster left, right;
  left.name = left.channel = "left";
  right.name = right.channel = "right";
  left.position = {0, -1};
  right.position = {0, 1};
  return {left, right};
}

}  // namespace

void validate(const Thruster& thruster) {
  if (!isIdentifier(thruster.name, kLongestThrusterName))
    throw std::invalid_argument("the name of thruster '" + shortened(thruster.name) +
                                "' must be a letter and then letters, digits or _, at most " +
                                std::to_string(kLongestThrusterName) + " characters");
  if (thruster.channel.empty()) fail(thruster, "its channel has no name");
  if (!thruster.position.allFinite()) fail(thruster, "its position is not finite");
  if (!(std::abs(thruster.direction) <= 360))
    fail(thruster, "direction must be between -360 and 360 degrees, not " + text(thruster.direction));
  if (!(thruster.least >= -1 && thruster.least <= 0 && thruster.most > 0 && thruster.most <= 1))
    fail(thruster, "range must be [LEAST, MOST] with -1 <= LEAST <= 0 < MOST <= 1, not [" +
                       text(thruster.least) + ", " + text(thruster.most) +
                       "]; one that only pulls has the opposite direction");
  if (!(thruster.gain > 0) || std::isinf(thruster.gain))
    fail(thruster, "gain must be positive, not " + text(thruster.gain) +
                       "; turn the direction by 180 for the opposite force");
  if (!(thruster.curve.power >= 0.2 && thruster.curve.power <= 5))
    fail(thruster, "the power of its curve must be between 0.2 and 5, not " + text(thruster.curve.power));
  if (thruster.curve.power != 1 && !thruster.curve.table.empty())
    fail(thruster, "its curve has a power and a table");
  validateTable(thruster);
}

ThrusterLayout::ThrusterLayout() : ThrusterLayout(leftAndRight()) { pair_ = true; }

ThrusterLayout::ThrusterLayout(std::vector<Thruster> thrusters, std::string lift_channel)
    : thrusters_(std::move(thrusters)), lift_channel_(std::move(lift_channel)) {
  validateAll();
  double squares = 0;
  for (std::size_t i = 0; i < thrusters_.size(); ++i) {
    const Thruster& one = thrusters_[i];
    const double c = cosine(one.direction), s = cosine(one.direction - 90);
    const double x = one.position.x(), y = one.position.y();
    arms_[i] = {c, s, x * s - y * c, x * c + y * s};
    sways_ = sways_ || s != 0;
    linear_ = linear_ && one.gain == 1 && one.curve.linear();
    squares += arms_[i].lever * arms_[i].lever;
  }
  lever_ = std::sqrt(squares / size());
  if (!(lever_ > 0))
    throw std::invalid_argument(
        "no thruster turns the craft: all of them push through the body's origin; check positions "
        "and directions");
  for (int i = 0; i < size(); ++i) {
    arms_[static_cast<std::size_t>(i)].lever /= lever_;
    arms_[static_cast<std::size_t>(i)].along /= lever_;
  }
}

void ThrusterLayout::validateAll() const {
  if (thrusters_.empty() || thrusters_.size() > kMaxThrusters)
    throw std::invalid_argument("a craft has 1 to " + std::to_string(kMaxThrusters) + " thrusters, not " +
                                std::to_string(thrusters_.size()));
  if (lift_channel_.empty()) throw std::invalid_argument("the channel of the lift has no name");
  std::set<std::string> names;
  for (const Thruster& one : thrusters_) {
    validate(one);
    if (!names.insert(one.name).second)
      throw std::invalid_argument("two thrusters are named " + one.name + ": rename one");
    if (one.channel == lift_channel_)
      fail(one, "its channel " + shortened(one.channel) + " is that of the lift");
  }
}

std::vector<std::string> ThrusterLayout::channels() const {
  std::vector<std::string> channels;
  for (const Thruster& one : thrusters_) channels.push_back(one.channel);
  channels.push_back(lift_channel_);
  return channels;
}

std::string ThrusterLayout::names() const {
  std::string list;
  for (const Thruster& one : thrusters_) list += (list.empty() ? "" : ", ") + one.name;
  return list;
}

Thrusters<double> ThrusterLayout::clipped(const Thrusters<double>& input, double full) const {
  Thrusters<double> inside = input;
  for (int i = 0; i < inside.size(); ++i)
    inside(i) = std::clamp(input(i), (*this)[i].least * full, (*this)[i].most * full);
  return inside;
}

double ThrusterLayout::fullThrust() const {
  double best = 0;
  for (int j = 0; j < size(); ++j) {
    double along = 0;
    for (int i = 0; i < size(); ++i) {
      const double share = forward(i) * forward(j) + starboard(i) * starboard(j);
      const Thruster& one = (*this)[i];
      along += one.gain * std::max(share * one.curve.at(one.most), share * one.curve.at(one.least));
    }
    best = std::max(best, along);
  }
  return best;
}

Thrusters<double> fastestTurn(const ThrusterLayout& layout, bool starboard, double full) {
  Thrusters<double> inputs = Thrusters<double>::zero(layout.size());
  for (int i = 0; i < inputs.size(); ++i) {
    const bool helps = (layout.lever(i) > 0) == starboard;
    inputs(i) = full * (helps ? layout[i].most : layout[i].least);
  }
  return inputs;
}

const ThrusterLayoutPtr& thrusterPair() {
  static const ThrusterLayoutPtr pair = std::make_shared<const ThrusterLayout>();
  return pair;
}

}  // namespace ground
