#pragma once

#include <array>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "ground/model/body.h"
#include "ground/model/types.h"

namespace ground {

/// How a parameter is stored in the vector that solvers and effects see.
enum class Coordinate {
  kValue,      ///< as it is
  kReciprocal  ///< as 1/value: time constants whose neutral value is infinite, the inertia
};

/// One parameter of a model. Numbers are values as the model file has them, not coordinates.
struct ParameterInfo {
  std::string name;
  std::string unit;
  std::string doc;
  double neutral = 0.0;  ///< value at which the effect vanishes exactly
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  /// Typical size of the effect's coordinate on the given craft; solvers scale by it.
  std::function<double(const Body<double>&)> scale;
  Coordinate coordinate = Coordinate::kValue;

  double toCoordinate(double value) const;
  double fromCoordinate(double coordinate) const;
};

/// What an effect is, for documentation, model files, bindings and diagnosis.
struct EffectInfo {
  std::string name;
  std::string summary;
  std::vector<ParameterInfo> parameters;
  int states = 0;  ///< number of states of its own
  /// Their values before anything has been commanded; empty: all zero.
  std::vector<double> initial = {};
  /// A diagnosis tries it only when it is asked for by name: it has many parameters.
  bool opt_in = false;
  /// Prior on the parameters: W, symmetric, positive semidefinite, a row for each parameter; the
  /// log-likelihood loses (x - x0)' W (x - x0)/2 at coordinates x, x0 the neutral ones. Empty
  /// function: no prior.
  std::function<Eigen::MatrixXd(const Body<double>&)> penalty = nullptr;
};

/// Inputs that act over one integration step, at its start, middle and end.
template <typename T>
struct StepInputs {
  std::array<Vector2<T>, 3> thrusters;  ///< left, right
  ValueOf<T> lift{0.0};                 ///< held over the step
  bool held = false;                    ///< the thrusters' inputs are, too
  /// Of all effects, to be integrated over the step with the motion; none: they stay as they begin.
  T* states = nullptr;
};

/// All that a wrench may depend on, at one instant.
template <typename T>
struct Point {
  const T& t;                  ///< since the drive began, never below 0 (DriveClock) [s]
  const Vector3<T>& eta;       ///< x, y [m], psi [rad], world_ned
  const Vector3<T>& nu;        ///< u, v [m/s], r [rad/s], body
  const Rotation<T>& heading;  ///< by psi, between body and world
  const Vector3<T>& nu_air;    ///< nu relative to the air, body
  const Vector2<T>& input;     ///< what reaches the thrusters: left, right
  const Vector2<T>& thrust;    ///< force of the thrusters: left, right [N]
  const ValueOf<T>& lift;      ///< 0..1
  const Body<T>& body;         ///< nominal parameters
  const Matrix3<T>& mass;      ///< mass matrix with all effects inside
  const T* states;             ///< of the effect that is asked
};

/// Measured pose and velocity: what the mocap's rigid body does, not the centre of the craft.
template <typename T>
struct Measurement {
  Vector3<T> eta;  ///< x, y [m], psi [rad], world_ned
  Vector3<T> nu;   ///< u, v [m/s], r [rad/s], body
};

/// The places of the model at which an effect can act, for one scalar type. `p` is the effect's
/// parameters in coordinates, in the order of EffectInfo::parameters. Each function adds to or
/// changes its last argument; each must leave it exactly alone at the neutral parameters. Lanes are
/// asked all at once: where an effect decides by a value it does so by choose() or blend().
template <typename T>
class EffectHooks {
 public:
  virtual ~EffectHooks() = default;
  /// Delay of the input [s].
  virtual void delay(const T* /*p*/, T& /*seconds*/) const {}
  /// Dynamics of the actuators over a step of length h with the command held: from the command to
  /// what reaches the thrusters. `states` are the effect's own, advanced to the end of the step.
  virtual void actuate(const T* /*p*/, const T& /*h*/, T* /*states*/, StepInputs<T>&) const {}
  /// Derivatives by time of the effect's own states (Point::states), all of which it sets. The
  /// states are integrated together with the motion, by the same Runge-Kutta step.
  virtual void rates(const T* /*p*/, const Point<T>&, T* /*rates*/) const {}
  /// Thrust of the two thrusters [N].
  virtual void thrust(const T* /*p*/, const Point<T>&, Vector2<T>&) const {}
  /// Velocity of the air over the floor, world_ned [m/s].
  virtual void air(const T* /*p*/, Vector2<T>&) const {}
  /// Mass matrix [kg, kg m, kg m^2]; Coriolis terms follow from it.
  virtual void inertia(const T* /*p*/, const Body<T>&, Matrix3<T>&) const {}
  /// Wrench on the craft: X, Y [N], N [N m], body.
  virtual void wrench(const T* /*p*/, const Point<T>&, Vector3<T>&) const {}
  /// What is measured at the true pose `eta`.
  virtual void measure(const T* /*p*/, const Vector3<T>& /*eta*/, Measurement<T>&) const {}
};

/// A physical effect: rigid body plus a list of effects is the model.
class Effect : public EffectHooks<double>,
               public EffectHooks<Jet>,
               public EffectHooks<Lanes>,
               public EffectHooks<LanesJet> {
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
    kPose = 1u
        << 8  ///< motion depends on where the craft is or heads: always so, unless it says no
  };
  virtual const EffectInfo& info() const = 0;
  /// Which hooks do anything, and whether they look at the pose (a set of Hook).
  virtual unsigned hooks() const = 0;
  /// An instance that one thread may call; itself unless the effect has scratch memory.
  virtual std::shared_ptr<const Effect> forThread() const = 0;
};

using EffectPtr = std::shared_ptr<const Effect>;

}  // namespace ground
