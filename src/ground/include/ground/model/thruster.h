#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "ground/model/thrusters.h"

namespace ground {

/// The force of a thruster as a function of its input, relative to the force at input 1: a power, or
/// linear interpolation in a table.
struct ForceCurve {
  /// Input below which the curve is linear: the power has no derivative at 0.
  static constexpr double kMinInput = 1e-9;

  double power = 1;  ///< exponent of the input's absolute value; the force has the input's sign
  /// Rows input, relative force, both ascending; if empty, the power applies.
  std::vector<std::array<double, 2>> table;

  bool linear() const { return power == 1 && table.empty(); }

  /// The relative force at an input.
  template <typename T>
  T at(const T& input) const {
    if (!table.empty()) return between(input);
    if (power == 1) return input;
    using std::abs;
    using std::pow;
    const T size = abs(input);
    return whereAbove(
        kMinInput, size, [&](const T& x) { return T(input * pow(x, power - 1)); }, input);
  }

 private:
  template <typename T>
  T between(const T& input) const {
    // Integrates the slopes from input 0, so that the force there is exactly 0.
    T force(0.0);
    for (std::size_t i = 1; i < table.size(); ++i) {
      const double slope = (table[i][1] - table[i - 1][1]) / (table[i][0] - table[i - 1][0]);
      force += slope * (into(i, input) - into(i, 0.0));
    }
    return force;
  }

  /// Distance of an input from the start of the interval before point i, clipped to its width.
  template <typename T>
  T into(std::size_t i, const T& input) const {
    const double width = table[i][0] - table[i - 1][0];
    return width - notBelowZero(T(width - notBelowZero(T(input - table[i - 1][0]))));
  }
};

/// A rudder or vane: a foil in the stream of a thruster and in the craft's own speed (FoilFlow).
struct Foil {
  std::string stream;    ///< the thruster in whose stream it works; empty without one
  double force = 0;      ///< c: normal force per square of the inflow, at right angles [N s^2/m^2]
  double jet = 0;        ///< square of the stream's speed per thrust [m^2/s^2/N]
  double own_speed = 1;  ///< share of the craft's speed along the foil that reaches it
  double own_sway = 1;   ///< the same across
  double drag = 1;       ///< share of the force along the foil that the craft feels
};

/// A thruster of a craft, fixed in the body frame, or the angle of a foil or of a thruster that
/// turns. Each has a channel of commands.
struct Thruster {
  enum class Kind { kThruster, kTurn, kFoil };

  Kind kind = Kind::kThruster;
  std::string name;                ///< an identifier
  std::string channel;             ///< name of its commands in recordings
  Vector2<double> position{0, 0};  ///< forward, to starboard [m]
  double direction = 0;            ///< direction of the force [deg]: 0 forward, 90 to starboard
  double least = 0, most = 1;      ///< range of the input; `least` is negative if it is reversible
  double gain = 1;                 ///< force at input 1 divided by k
  ForceCurve curve;
  bool on_off = false;  ///< a valve: its input is 0 or 1
  std::string supply;   ///< of air or current, which it shares with others of the same supply

  double angle = 0, offset = 0;  ///< of an angle [deg]: scale, at input 1; at input 0
  std::string turns;             ///< the thruster that it turns
  Foil foil;

  bool isAngle() const { return kind != Kind::kThruster; }
};

/// Throws std::invalid_argument that names the thruster and says what is wrong with it.
void validate(const Thruster& thruster);

/// The thrusters of a craft: where they are, and the wrench of their forces.
///
/// Thruster i at (x, y) with the force F along (c, s) = (cos, sin) of its direction gives
///
///     X = c F,   Y = s F,   N = (x s - y c) F
///
/// The body's l is the root mean square of the levers x s - y c. A layout stores the levers divided by
/// it, so that all of them scale with l, which stays one of the seven parameters of the body. In a craft
/// with angles, a foil has the lever of its normal force, a thruster that turns its distance from the
/// origin, and those without lever do not count.
class ThrusterLayout {
 public:
  /// A left and a right thruster, both forward, at a lever of l: the model of the thesis.
  ThrusterLayout();
  /// Throws std::invalid_argument that says what is wrong.
  explicit ThrusterLayout(std::vector<Thruster> thrusters, std::string lift_channel = "lift");

  int size() const { return static_cast<int>(thrusters_.size()); }
  const std::vector<Thruster>& thrusters() const { return thrusters_; }
  const Thruster& operator[](int i) const { return thrusters_[static_cast<std::size_t>(i)]; }
  /// Whether `holds` is true of some thruster.
  template <typename Predicate>
  bool any(Predicate holds) const {
    return std::any_of(thrusters_.begin(), thrusters_.end(), holds);
  }
  /// Channel of each thruster's commands, then the channel of the lift.
  std::vector<std::string> channels() const;
  const std::string& liftChannel() const { return lift_channel_; }
  /// True for the left and right thruster of the thesis, which model files do not list.
  bool isPair() const { return pair_; }
  /// True if some thruster pushes to the side.
  bool sways() const { return sways_; }
  /// True if some channel is an angle.
  bool steers() const { return !links_.empty(); }
  /// Whether the channel commands a force.
  bool pushes(int i) const { return !(*this)[i].isAngle(); }
  /// Number of channels that command forces.
  int forces() const { return size() - static_cast<int>(links_.size()); }

  /// An angle of the craft, and what it acts on.
  struct Link {
    int channel;
    int thruster;               ///< that is turned, or in whose stream the foil works; -1 without one
    double forward, starboard;  ///< cosine and sine of the direction of a foil at angle 0
    double x, y;                ///< place, divided by l
    bool foil;
  };
  const std::vector<Link>& links() const { return links_; }
  /// Root mean square of the levers by `thrusters()` [m]; 1 for the pair.
  double lever() const { return lever_; }
  /// "left, right"
  std::string names() const;

  double forward(int i) const { return arms_[i].forward; }      ///< c
  double starboard(int i) const { return arms_[i].starboard; }  ///< s
  double lever(int i) const { return arms_[i].lever; }          ///< (x s - y c) / l
  double along(int i) const { return arms_[i].along; }          ///< (x c + y s) / l
  /// Number of the first thruster on the same supply; -1 for an angle.
  int supply(int i) const { return arms_[i].supply; }

  /// Force of each thruster at these inputs, divided by k.
  template <typename T>
  Thrusters<T> forces(const Thrusters<T>& input) const {
    Thrusters<T> force = input;
    for (int i = 0; i < force.size() && !linear_; ++i) {
      const Thruster& one = (*this)[i];
      force(i) = one.isAngle() ? T(0.0) : T(one.gain * one.curve.at(input(i)));
    }
    return force;
  }
  /// The wrench of all forces: X, Y [N], N / l [N].
  template <typename T>
  Vector3<T> total(const Thrusters<T>& force) const {
    Vector3<T> sum(T(0.0), T(0.0), T(0.0));
    for (int i = 0; i < force.size(); ++i) {
      sum(0) += arms_[i].forward * force(i);
      sum(1) += arms_[i].starboard * force(i);
      sum(2) += arms_[i].lever * force(i);
    }
    return sum;
  }
  /// total(forces(input))
  template <typename T>
  Vector3<T> totalAt(const Thrusters<T>& input) const {
    return linear_ ? total(input) : total(forces(input));
  }
  /// The wrench of a craft at rest with all angles: X, Y, N / l, each divided by k.
  Vector3<double> atRest(const Thrusters<double>& input) const;
  /// Inputs clipped to the ranges of the thrusters; `full` is the input of full thrust.
  Thrusters<double> clipped(const Thrusters<double>& input, double full = 1) const;

 private:
  struct Arm {
    double forward = 0, starboard = 0, lever = 0, along = 0;
    int supply = -1;
  };

  void validateAll() const;
  void link();
  double leverOf(std::size_t i) const;

  std::vector<Thruster> thrusters_;
  std::string lift_channel_ = "lift";
  std::array<Arm, kMaxThrusters> arms_{};
  std::vector<Link> links_;
  double lever_ = 1;
  bool pair_ = false, sways_ = false;
  bool linear_ = true;  ///< each force is its input times k
};

using ThrusterLayoutPtr = std::shared_ptr<const ThrusterLayout>;

/// The layout of the pair.
const ThrusterLayoutPtr& thrusterPair();

/// Inputs of all thrusters that turn a craft fastest to one side; `full` is the input of full
/// thrust.
Thrusters<double> fastestTurn(const ThrusterLayout& layout, bool starboard, double full);

}  // namespace ground
