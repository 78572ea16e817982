#pragma once

#include <array>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "ground/model/body.h"
#include "ground/model/steering.h"
#include "ground/model/thruster.h"
#include "ground/model/types.h"

namespace ground {

/// How a parameter is stored in the vector that solvers and effects see.
enum class Coordinate {
  kValue,      ///< the value
  kReciprocal  ///< 1/value: for the inertia, and for time constants with an infinite neutral value
};

constexpr double kUnbounded = std::numeric_limits<double>::infinity();

/// One parameter of a model. Numbers are values as in the model file, not coordinates.
struct ParameterInfo {
  std::string name;
  std::string unit;
  std::string doc;
  double neutral = 0.0;  ///< value at which the effect vanishes exactly
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  /// Typical size of the effect's coordinate on the given craft; solvers scale by it.
  std::function<double(const Body<double>&)> scale = nullptr;
  Coordinate coordinate = Coordinate::kValue;
  /// It does nothing where the effect's other parameters are neutral, such as the time constant of a share
  /// that is 0. A fit begins at its `neutral`.
  bool shape = false;

  double toCoordinate(double value) const;
  double fromCoordinate(double coordinate) const;
};

/// What a craft must move on or have for an effect to act on it. A diagnosis tries an effect by itself only
/// where it suits the craft.
enum class Surroundings {
  kAny,
  kFloor,  ///< on a floor: not on water
  kLift,   ///< on a floor, with a lift fan
  kWater   ///< a hull in water (Body::hull_length)
};

/// "any", "floor", "lift" or "water".
const char* nameOf(Surroundings surroundings);

/// What an effect is, for documentation, model files, bindings and diagnosis.
struct EffectInfo {
  std::string name;
  std::string summary;
  std::vector<ParameterInfo> parameters;
  int states = 0;               ///< number of states of the effect
  int states_per_thruster = 0;  ///< additional states for each thruster of the craft
  /// Whether a craft can have the effect; an empty function means that all can.
  std::function<bool(const ThrusterLayout&)> suits = nullptr;
  /// A diagnosis tries the effect only if the user names it, because it has many parameters.
  bool opt_in = false;
  /// Values of the states before the first command; empty means all zero.
  std::vector<double> initial = {};
  /// Gaussian prior on the parameters: a symmetric, positive semidefinite matrix W with a row for
  /// each parameter. The log-likelihood decreases by (x - x0)' W (x - x0)/2 at coordinates x, with
  /// neutral coordinates x0. An empty function means no prior.
  std::function<Eigen::MatrixXd(const Body<double>&)> penalty = nullptr;
  Surroundings surroundings = Surroundings::kAny;
  /// Name of an effect that this one equals at some parameters: it has to be as much likelier than that one
  /// as another effect beside it.
  std::string contains = {};

  int stateCount(int thrusters) const { return states + thrusters * states_per_thruster; }
  /// The effect of crafts in such surroundings.
  EffectInfo of(Surroundings where) && {
    surroundings = where;
    return std::move(*this);
  }
};

/// Inputs that act over one integration step, at its start, middle and end; only the first are set if they
/// are held.
template <typename T>
struct StepInputs {
  std::array<Thrusters<T>, 3> thrusters;
  Conditions<T> given;  ///< held over the step
  bool held = false;    ///< the thruster inputs are also held over the step
  /// States of all effects, integrated over the step with the motion. If null, the states stay at
  /// their initial values.
  T* states = nullptr;
  const ThrusterLayout* layout = nullptr;  ///< of the craft
  double input_max = 1.0;                  ///< full input of a thruster

  /// Whether a channel is an angle.
  bool isAngle(int i) const { return layout && !layout->pushes(i); }
};

/// Everything that a wrench may depend on, at one instant.
template <typename T>
struct Point {
  const T& t;                    ///< since the drive began, never below 0 (DriveClock) [s]
  const Vector3<T>& eta;         ///< x, y [m], psi [rad], world_ned
  const Vector3<T>& nu;          ///< u, v [m/s], r [rad/s], body
  const Rotation<T>& heading;    ///< by psi, between body and world
  const Vector3<T>& nu_air;      ///< nu relative to the air, body
  const Thrusters<T>& input;     ///< what reaches the thrusters
  const Thrusters<T>& thrust;    ///< force of the thrusters [N]
  const ThrusterLayout& layout;  ///< where they are
  const Given<T>& lift;          ///< 0..1
  /// Voltage of the battery [V]; no value: not known.
  const std::optional<Given<T>>& volts;
  const Body<T>& body;     ///< nominal parameters
  const Matrix3<T>& mass;  ///< mass matrix with all effects inside
  const T* states;         ///< states of the effect that is called
};

/// Measured pose and velocity of the mocap's rigid body, not of the centre of the craft.
template <typename T>
struct Measurement {
  Vector3<T> eta;  ///< x, y [m], psi [rad], world_ned
  Vector3<T> nu;   ///< u, v [m/s], r [rad/s], body
};

/// The functions by which an effect can act on the model, for one scalar type. `p` is the effect's
/// parameters in coordinates, in the order of EffectInfo::parameters. Each function adds to or
/// changes its last argument, and must leave it exactly unchanged at the neutral parameters, at
/// which it is not called: the effect's states then stay at their initial values.
template <typename T>
class EffectHooks {
 public:
  virtual ~EffectHooks() = default;
  /// Delay of the input [s].
  virtual void delay(const T* /*p*/, T& /*seconds*/) const {}
  /// Dynamics of the actuators over a step of length h with the command held: from the command to
  /// the thruster inputs. Advances `states`, the effect's own states, to the end of the step.
  virtual void actuate(const T* /*p*/, const T& /*h*/, T* /*states*/, StepInputs<T>&) const {}
  /// Sets the time derivatives of all the effect's own states (Point::states). The states are
  /// integrated together with the motion, by the same Runge-Kutta step.
  virtual void rates(const T* /*p*/, const Point<T>&, T* /*rates*/) const {}
  /// What is known of the craft's angles, one for each channel; called only if it has angles.
  virtual void steer(const T* /*p*/, std::vector<Steered<T>>&) const {}
  /// Force of each thruster [N].
  virtual void thrust(const T* /*p*/, const Point<T>&, Thrusters<T>&) const {}
  /// Velocity of the air over the floor, world_ned [m/s].
  virtual void air(const T* /*p*/, Vector2<T>&) const {}
  /// Mass matrix [kg, kg m, kg m^2]; Coriolis terms follow from it.
  virtual void inertia(const T* /*p*/, const Body<T>&, Matrix3<T>&) const {}
  /// Wrench on the craft: X, Y [N], N [N m], body.
  virtual void wrench(const T* /*p*/, const Point<T>&, Vector3<T>&) const {}
  /// Changes the measurement made at the true pose `eta`.
  virtual void measure(const T* /*p*/, const Vector3<T>& /*eta*/, Measurement<T>&) const {}
};

/// A physical effect. A model is a rigid body with a list of effects.
class Effect : public EffectHooks<double>, public EffectHooks<Jet>, public EffectHooks<Symbol> {
 public:
  enum Hook : unsigned {
    kDelay = 1u << 0,
    kActuate = 1u << 1,
    kThrust = 1u << 2,
    kAir = 1u << 3,
    kInertia = 1u << 4,
    kWrench = 1u << 5,
    kMeasure = 1u << 6,
    kRates = 1u << 7,
    kSteer = 1u << 9,
    kPose = 1u << 8  ///< motion depends on the pose: the default unless the effect denies it
  };
  virtual const EffectInfo& info() const = 0;
  /// The hooks that the effect implements, and whether they depend on the pose (a set of Hook).
  virtual unsigned hooks() const = 0;
};

using EffectPtr = std::shared_ptr<const Effect>;

}  // namespace ground
