#include "ground/model/thruster.h"

#include <algorithm>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "arguments.h"
#include "ground/model/shortened.h"
#include "ground/model/steering.h"

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

void requireWithin(const Thruster& thruster, const char* key, double value, double least, double most,
                   const char* unit) {
  if (value >= least && value <= most) return;
  fail(thruster, std::string(key) + " must be between " + text(least) + " and " + text(most) + ' ' + unit +
                     ", not " + text(value));
}

void validateAngle(const Thruster& thruster) {
  requireWithin(thruster, "angle", thruster.angle, -360, 360, "degrees");
  if (thruster.angle == 0) fail(thruster, "angle must not be 0: it is the angle at input 1 in degrees");
  requireWithin(thruster, "offset", thruster.offset, -360, 360, "degrees");
  if (thruster.kind == Thruster::Kind::kTurn) return;
  const Foil& foil = thruster.foil;
  if (!(foil.force > 0) || std::isinf(foil.force))
    fail(thruster, "force of its foil must be positive, not " + text(foil.force) +
                       " N s^2/m^2; its angle has the sign");
  if (!(foil.jet >= 0) || std::isinf(foil.jet))
    fail(thruster, "jet of its foil must not be negative, but is " + text(foil.jet) + " m/kg");
  if ((foil.jet > 0) == foil.stream.empty())
    fail(thruster, foil.stream.empty() ? "its foil has a jet, but no stream: name the thruster"
                                       : "its foil is in the stream of " + shortened(foil.stream) +
                                             " and needs jet, the square of its speed per thrust in m/kg");
  requireWithin(thruster, "own_speed", foil.own_speed, 0, 3, "(a share)");
  requireWithin(thruster, "own_sway", foil.own_sway, 0, 3, "(a share)");
  requireWithin(thruster, "drag", foil.drag, 0, 3, "(a share)");
  if (foil.stream.empty() && foil.own_speed == 0)
    fail(thruster, "nothing flows at its foil: it has neither a stream nor own_speed");
}

void validateForce(const Thruster& thruster) {
  if (!(thruster.gain > 0) || std::isinf(thruster.gain))
    fail(thruster, "gain must be positive, not " + text(thruster.gain) +
                       "; turn the direction by 180 for the opposite force");
  if (!(thruster.curve.power >= 0.2 && thruster.curve.power <= 5))
    fail(thruster, "the power of its curve must be between 0.2 and 5, not " + text(thruster.curve.power));
  if (thruster.curve.power != 1 && !thruster.curve.table.empty())
    fail(thruster, "its curve has a power and a table");
  validateTable(thruster);
}

/// The thruster that an angle belongs to; -1 without one.
int thrusterOf(const std::vector<Thruster>& all, const Thruster& one) {
  const bool turns = one.kind == Thruster::Kind::kTurn;
  const std::string& name = turns ? one.turns : one.foil.stream;
  if (name.empty() && !turns) return -1;
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const Thruster& other) { return other.name == name; });
  if (found == all.end() || found->isAngle())
    fail(one, (turns ? "it turns " : "it is in the stream of ") + shortened(name) +
                  ", and no thruster has that name");
  const auto turned = [&](const Thruster& other) { return &other != &one && other.turns == name; };
  if (std::any_of(all.begin(), all.end(), turned))
    fail(one, turns ? "another channel turns " + name + " as well"
                    : "its stream turns with " + name + ": a foil needs the stream of one that is fixed");
  return static_cast<int>(found - all.begin());
}

/// Number of the first thruster on a supply.
int firstOn(const std::vector<Thruster>& all, const std::string& supply) {
  const auto found = std::find_if(all.begin(), all.end(), [&](const Thruster& other) {
    return !other.isAngle() && other.supply == supply;
  });
  return static_cast<int>(found - all.begin());
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
                       (thruster.isAngle() ? "]" : "]; one that only pulls has the opposite direction"));
  if (thruster.isAngle()) return validateAngle(thruster);
  validateForce(thruster);
}

ThrusterLayout::ThrusterLayout() : ThrusterLayout(leftAndRight()) { pair_ = true; }

ThrusterLayout::ThrusterLayout(std::vector<Thruster> thrusters, std::string lift_channel)
    : thrusters_(std::move(thrusters)), lift_channel_(std::move(lift_channel)) {
  validateAll();
  link();
  double squares = 0;
  int levers = 0;
  for (std::size_t i = 0; i < thrusters_.size(); ++i) {
    const Thruster& one = thrusters_[i];
    if (one.isAngle()) {
      const double lever = leverOf(i);
      squares += lever * lever;
      levers += lever != 0;
      continue;
    }
    const double c = cosine(one.direction), s = cosine(one.direction - 90);
    const double x = one.position.x(), y = one.position.y();
    arms_[i] = {c, s, x * s - y * c, x * c + y * s, firstOn(thrusters_, one.supply)};
    sways_ = sways_ || s != 0;
    linear_ = linear_ && one.gain == 1 && one.curve.linear();
    const double lever = steers() ? leverOf(i) : arms_[i].lever;
    squares += lever * lever;
    levers += !steers() || lever != 0;
  }
  linear_ = linear_ && !steers();
  lever_ = std::sqrt(squares / std::max(levers, 1));
  if (!(lever_ > 0))
    throw std::invalid_argument(
        "no thruster turns the craft: all of them push through the body's origin; check positions "
        "and directions");
  for (int i = 0; i < size(); ++i) {
    arms_[static_cast<std::size_t>(i)].lever /= lever_;
    arms_[static_cast<std::size_t>(i)].along /= lever_;
  }
  for (Link& one : links_) {
    one.x /= lever_;
    one.y /= lever_;
  }
}

/// Sets what the angles act on, places in m.
void ThrusterLayout::link() {
  for (int i = 0; i < size(); ++i) {
    const Thruster& one = (*this)[i];
    if (!one.isAngle()) continue;
    const bool foil = one.kind == Thruster::Kind::kFoil;
    const int of = thrusterOf(thrusters_, one);
    const double direction = of < 0 ? 0 : (*this)[of].direction;
    const Vector2<double>& place = foil ? one.position : (*this)[of].position;
    links_.push_back({i, of, cosine(direction), cosine(direction - 90), place.x(), place.y(), foil});
  }
}

/// The lever of a channel of a craft that steers [m].
double ThrusterLayout::leverOf(std::size_t i) const {
  for (const Link& one : links_) {
    const double across = one.x * one.forward + one.y * one.starboard;
    if (one.foil && one.channel == static_cast<int>(i)) return across;
    if (!one.foil && one.thruster == static_cast<int>(i)) return std::hypot(one.x, one.y);
  }
  return pushes(static_cast<int>(i)) ? arms_[i].lever : 0;
}

Vector3<double> ThrusterLayout::atRest(const Thrusters<double>& input) const {
  const Thrusters<double> force = forces(input);
  Vector3<double> wrench = total(force);
  if (!steers()) return wrench;
  const std::vector<Steered<double>> steering = steeringOf<double>(*this);
  addSteering(*this, steering, Angles<double>(*this, steering, input), force, Vector3<double>(0, 0, 0), 1.0,
              wrench);
  return wrench;
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

namespace {

/// Of a craft with angles: from full thrust, one channel after the other takes what turns it most.
Thrusters<double> fastestSteered(const ThrusterLayout& layout, bool starboard, double full) {
  Thrusters<double> inputs = Thrusters<double>::zero(layout.size());
  for (int i = 0; i < inputs.size(); ++i) inputs(i) = layout.pushes(i) ? full * layout[i].most : 0;
  const auto turn = [&] { return (starboard ? 1 : -1) * layout.atRest(inputs).z(); };
  for (int round = 0; round < 2; ++round) {
    for (int j = inputs.size() - 1; j >= 0; --j) {  // angles are often listed after their thrusters
      double best = turn(), chosen = inputs(j);
      for (const double share :
           {layout[j].least, 0.5 * layout[j].least, 0.0, 0.5 * layout[j].most, layout[j].most}) {
        inputs(j) = full * share;
        if (turn() <= best) continue;
        best = turn();
        chosen = inputs(j);
      }
      inputs(j) = chosen;
    }
  }
  return inputs;
}

}  // namespace

Thrusters<double> fastestTurn(const ThrusterLayout& layout, bool starboard, double full) {
  if (layout.steers()) return fastestSteered(layout, starboard, full);
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
