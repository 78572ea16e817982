#include "ground/model/plausibility.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include "ground/model/capability.h"
#include "ground/model/typical.h"

namespace ground {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kMinAcceleration = 1e-4;  // [m/s^2]
constexpr double kMaxAcceleration = 1e4;   // [m/s^2]

double acceleration(const Body<double>& b) { return typical::force(b) / b.m; }

/// A parameter of the body: name, SI unit, member, and value on a typical craft.
struct Key {
  const char* name;
  const char* unit;
  double Body<double>::*place;
  double typical;
};

const std::vector<Key>& keys() {
  using B = Body<double>;
  static const std::vector<Key> all = {{"m", "kg", &B::m, 0.5},          {"l", "m", &B::l, 0.06},
                                       {"I_z", "kg m^2", &B::I_z, 1e-3}, {"X_u", "N s/m", &B::X_u, 0.1},
                                       {"Y_v", "N s/m", &B::Y_v, 0.1},   {"N_r", "N m s", &B::N_r, 1e-3},
                                       {"k", "N", &B::k, 0.3},           {"input_max", "", &B::input_max, 1}};
  return all;
}

const Key& keyNamed(const std::string& name) {
  return *std::find_if(keys().begin(), keys().end(), [&](const Key& key) { return key.name == name; });
}

/// A ratio of parameters that is similar for all crafts.
struct Ratio {
  const char* meaning;
  const char* unit;
  double lower, upper;
  double (*value)(const Body<double>&);
  std::vector<const char*> keys;  ///< the parameters in the ratio
};

double gyrationOverLever(const Body<double>& b) { return std::sqrt(b.I_z / b.m) / b.l; }
double massOverGyration(const Body<double>& b) { return b.m / b.I_z * b.m; }
double topSurge(const Body<double>& b) { return typical::force(b) / b.X_u; }
double topSway(const Body<double>& b) { return typical::force(b) / b.Y_v; }
double topYawRate(const Body<double>& b) { return b.k * b.input_max * b.l / b.N_r; }

const std::vector<Ratio>& ratios() {
  // clang-format off
  static const std::vector<Ratio> all = {
      // The first ratio decides whether a craft is refused.
      {"full thrust accelerates the craft by", "m/s^2",
       0.005, 50, acceleration, {"m", "k", "input_max"}},
      {"the radius of gyration over the lever is", "",
       0.1, 10, gyrationOverLever, {"I_z", "l", "m"}},
      {"the mass over the square of the radius of gyration is", "kg/m^2",
       1, 1e4, massOverGyration, {"I_z", "m"}},
      {"surge damping holds full thrust at", "m/s",
       0.05, kInfinity, topSurge, {"X_u", "k", "input_max"}},
      {"sway damping would hold full thrust at", "m/s",
       0.05, kInfinity, topSway, {"Y_v", "k", "input_max"}},
      {"yaw damping holds one thruster at", "rad/s",
       0.05, kInfinity, topYawRate, {"N_r", "l", "k", "input_max"}},
  };
  // clang-format on
  return all;
}

bool sound(const Ratio& ratio, const Body<double>& body) {
  const double value = ratio.value(body);
  return value >= ratio.lower && value <= ratio.upper;
}

/// Distance of a value from that of a typical craft, in decades.
double distance(const Body<double>& body, const Key& key) {
  return std::abs(std::log10(body.*key.place / key.typical));
}

/// The parameter of a ratio whose value is farthest from that of a typical craft.
const Key& strangest(const Ratio& ratio, const Body<double>& body) {
  return keyNamed(*std::max_element(ratio.keys.begin(), ratio.keys.end(), [&](const char* a, const char* b) {
    return distance(body, keyNamed(a)) < distance(body, keyNamed(b));
  }));
}

/// A unit in which a user may have typed a parameter of the body by mistake.
struct MistakenUnit {
  const char* key;   ///< the parameter
  const char* name;  ///< of the unit
  double factor;     ///< to SI
};

/// All units that are recognised.
constexpr MistakenUnit kMistakenUnits[] = {
    {"m", "g", 1e-3},
    {"l", "cm", 1e-2},
    {"l", "mm", 1e-3},
    {"I_z", "g m^2", 1e-3},
    {"I_z", "kg cm^2", 1e-4},
    {"I_z", "kg mm^2", 1e-6},
    {"I_z", "g cm^2", 1e-7},
    {"I_z", "g mm^2", 1e-9},
    {"X_u", "mN s/m", 1e-3},
    {"Y_v", "mN s/m", 1e-3},
    {"N_r", "mN m s", 1e-3},
    {"N_r", "mN mm s", 1e-6},
    {"k", "mN", 1e-3},
    {"k", "grams of force", 9.81e-3},
    {"input_max", "per cent", 1e-2},
};

/// The unit of a parameter whose conversion brings a ratio into its range, and nearest to its middle or, if
/// the range has none, the parameter nearest to that of a typical craft. nullptr if there is none.
const MistakenUnit* probableUnit(const Key& key, const Ratio& ratio, const Body<double>& body) {
  const MistakenUnit* best = nullptr;
  double least = kInfinity;
  for (const MistakenUnit& unit : kMistakenUnits) {
    Body<double> other = body;
    other.*key.place *= unit.factor;
    if (unit.key != std::string(key.name) || !sound(ratio, other)) continue;
    const double middle = std::sqrt(ratio.lower * ratio.upper);
    const double off =
        std::isinf(middle) ? distance(other, key) : std::abs(std::log10(ratio.value(other) / middle));
    if (off >= least) continue;
    least = off;
    best = &unit;
  }
  return best;
}

std::string withUnit(double value, const char* unit) {
  std::ostringstream text;
  text.precision(3);
  text << value;
  if (*unit) text << ' ' << unit;
  return text.str();
}

Implausibility describe(const Key& key, const Ratio& ratio, const Body<double>& body) {
  std::ostringstream text;
  const double value = body.*key.place;
  text << key.name << ": " << withUnit(value, key.unit) << " is implausible: " << ratio.meaning << ' '
       << withUnit(ratio.value(body), ratio.unit) << "; craft have ";
  if (std::isinf(ratio.upper)) {
    text << "more than " << withUnit(ratio.lower, ratio.unit);
  } else {
    text << withUnit(ratio.lower, "") << " to " << withUnit(ratio.upper, ratio.unit);
  }
  if (const MistakenUnit* const unit = probableUnit(key, ratio, body))
    text << "; write " << withUnit(value * unit->factor, key.unit) << " if it is in " << unit->name;
  return {key.name, text.str(), false};
}

}  // namespace

bool isPlausibleVoltage(double volts, double nominal) {
  constexpr double kLeast = 0.6, kMost = 1.6;  // of the nominal one
  return std::isfinite(volts) && volts > 0 &&
         (!(nominal > 0) || (volts > kLeast * nominal && volts < kMost * nominal));
}

std::vector<Implausibility> implausibilities(const Body<double>& given, const ThrusterLayout& layout) {
  Body<double> body = given;
  Body<double> unit = given;
  unit.k = unit.input_max = 1;
  body.input_max *= capability(layout, unit).force / capability(*thrusterPair(), unit).force;
  std::vector<Implausibility> found;
  for (const Ratio& ratio : ratios()) {
    if (sound(ratio, body)) continue;
    const Key& key = strangest(ratio, body);
    const bool reported =
        std::any_of(found.begin(), found.end(), [&](const Implausibility& f) { return f.key == key.name; });
    if (!reported) found.push_back(describe(key, ratio, body));
  }
  const double a = acceleration(body);
  if (a >= kMinAcceleration && a <= kMaxAcceleration) return found;
  const std::vector<const char*>& causes = ratios().front().keys;
  for (Implausibility& one : found) {
    if (std::find(causes.begin(), causes.end(), one.key) == causes.end()) continue;
    one.refused = true;
    one.message += "; refused, because no craft has less than " + withUnit(kMinAcceleration, "") +
                   " or more than " + withUnit(kMaxAcceleration, "m/s^2");
    break;
  }
  return found;
}

}  // namespace ground
