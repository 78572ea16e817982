#pragma once

#include <vector>

#include "ground/model/model.h"
#include "ground/model/stepping.h"

namespace ground {

/// Equations of motion (2.3), (2.4) with the model's effects inside, for one set of parameters.
/// Instantiated for the scalar types of types.h. One thread at a time.
template <typename T>
class Dynamics {
 public:
  /// `coordinates`: all parameters in the order of Model::parameters().
  Dynamics(const Model& model, const std::vector<T>& coordinates, const Payload& payload = {});
  /// With the model's own parameters.
  explicit Dynamics(const Model& model, const Payload& payload = {});
  /// Not copied, because effects keep pointers to the coordinates, which move with them.
  Dynamics(Dynamics&&) = default;
  Dynamics& operator=(Dynamics&&) = default;

  const Body<T>& body() const { return body_; }     ///< m and I_z include the payload's
  const Matrix3<T>& mass() const { return mass_; }  ///< with all effects inside
  const T& inputDelay() const { return delay_; }    ///< [s]
  /// A time [s] whose derivative by the input delay is `by_delay`, with all derivatives.
  T withDelay(double seconds, double by_delay) const {
    return seconds + by_delay * (delay_ - valueOf(delay_));
  }
  const ThrusterLayout& layout() const { return *layout_; }
  /// Throws std::invalid_argument when the craft has another number of thrusters.
  void requireThrusters(int count) const;
  int stateCount() const { return static_cast<int>(initial_.size()); }
  /// The states of all effects before the first command.
  const std::vector<T>& initialStates() const { return initial_; }
  /// Whether effects have states: every step is then an actuate() and a step().
  bool hasMemory() const { return !actuators_.empty() || !rates_.empty(); }
  Settling settling() const;
  /// Longest step [s] of a simulation that is compared with measurements: kDefaultStep, or longer for a craft
  /// whose time scale is above 1 s, as far as its damping allows and unless effects have states.
  double longestStep() const;
  /// Whether velocities depend on the pose. If not, they can be simulated without it.
  bool usesPose() const { return uses_pose_; }

  /// Passes a command, held over a step of length h [s], through the actuators and advances their
  /// states to the end of the step. step() advances the states of all other effects.
  StepInputs<T> actuate(const Thrusters<T>& command, const Conditions<T>& given, const T& h, T* states) const;
  /// Advances the states of all effects by h [s] under a command while the motion stays at `state`.
  /// Brings the states to the start of a simulation when the earlier motion is unknown.
  void settle(const T& t, const RigidState<T>& state, const Thrusters<T>& command, const Conditions<T>& given,
              const T& h, T* states) const;

  /// Time derivative of the rigid state; its `nu` is the body acceleration. Here and below, t [s]
  /// is the time since the drive began (DriveClock); a negative t counts as 0. `states` are the
  /// states of the effects, by default the initial ones. Unless `rates` is null, the derivatives of those
  /// that have rates() are written there.
  RigidState<T> derivative(const T& t, const RigidState<T>& state, const Thrusters<T>& input,
                           const Conditions<T>& given, const T* states = nullptr, T* rates = nullptr) const;
  /// `count` classical RK4 steps of length h [s] from t, which is advanced; each begins with the
  /// same inputs. H is double, or T if h has derivatives. Without `pose` only velocities move.
  /// The states of effects that have rates() are integrated by the same RK4 steps. These are
  /// unstable for time constants below 36% of h.
  template <typename H>
  void step(T& t, RigidState<T>& state, const StepInputs<T>& inputs, const H& h, int count = 1,
            bool pose = true) const;
  /// What the mocap measures at a state.
  Measurement<T> measure(const RigidState<T>& state) const;
  /// Whether the measurement differs from the state.
  bool distorts() const { return !measure_.empty(); }

 private:
  struct Active {
    const EffectHooks<T>* effect;
    const T* p;
    int state;  ///< offset of its states
  };

  void add(const Model::Entry& entry, const T* p);
  void load(const Payload& payload);

  /// The thrust for one thruster input.
  struct Drive {
    const Thrusters<T>& input;
    Thrusters<T> thrust;  ///< before effects change it [N]
    Angles<T> angles;

    Drive(const Dynamics& d, const Thrusters<T>& inputs);
  };
  /// The arguments of effects at one instant.
  struct Instant;
  /// Sets the derivatives of velocity, of the pose if `pose`, and of the effects' states unless
  /// `rates` is null.
  void derive(const T& t, const RigidState<T>& state, const Drive& drive, const Conditions<T>& given,
              const T* states, T* rates, bool pose, RigidState<T>& dot) const;
  template <typename H>
  void stepVelocities(Vector3<T>& nu, const Thrusters<T>& input, const H& h, int count) const;
  /// The derivatives of the effects' states.
  void rates(Instant& instant, const T* states, T* rates) const;

  /// The states of effects during a Runge-Kutta step.
  struct StateStages {
    std::vector<T> begin, at, rates;

    /// Adds share * rates to the states at the end of the step, and sets the states of the next
    /// stage to begin + to * rates.
    template <typename H>
    void move(const H& share, const H& to, T* end);
  };

  ThrusterLayoutPtr layout_;
  std::vector<Steered<T>> steering_;  ///< with all effects inside
  std::vector<EffectPtr> instances_;
  std::vector<T> coordinates_;
  std::vector<Active> actuators_, rates_, thrust_, wrench_, measure_;
  std::vector<T> initial_;      ///< states of the effects before the first command
  mutable StateStages stages_;  ///< scratch of one thread
  Body<T> body_;
  Matrix3<T> mass_, mass_inverse_;
  Vector3<T> damping_;           ///< X_u/m, Y_v/m, N_r/I_z
  T surge_gain_{}, yaw_gain_{};  ///< k/m, k l/I_z
  Vector2<T> air_;
  T delay_{};
  double time_scale_;  ///< [s], of the model; the same for all coordinates
  bool uses_pose_ = false, has_air_ = false;
  bool is_alone_ = false;  ///< (2.4) has no effects or sway by thrusters, and a mass matrix diag(m, m, I_z)
};

extern template class Dynamics<double>;
extern template class Dynamics<Jet>;
extern template class Dynamics<Symbol>;

}  // namespace ground
