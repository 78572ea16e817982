#pragma once

#include <vector>

#include "ground/model/model.h"
#include "ground/model/stepping.h"

namespace ground {

/// Rigid-body state at one instant.
template <typename T>
struct RigidState {
  Vector3<T> eta = Vector3<T>::Zero();  ///< x, y [m], psi [rad], world_ned
  Vector3<T> nu = Vector3<T>::Zero();   ///< u, v [m/s], r [rad/s], body
};

template <typename T, bool kPose, typename H>
struct Stages;

/// Equations of motion (2.3), (2.4) with the model's effects inside, for one set of parameters.
/// Instantiated for the scalar types of types.h. One thread at a time.
template <typename T>
class Dynamics {
 public:
  /// `coordinates`: all parameters in the order of Model::parameters().
  Dynamics(const Model& model, const std::vector<T>& coordinates);
  /// With the model's own parameters.
  explicit Dynamics(const Model& model);

  /// Only the first `count` derivatives of the motion are taken from now on, the others are
  /// anything; makes eight simulations with few derivatives faster.
  void useDirections(int count) { directions_ = count; }

  const Body<T>& body() const { return body_; }
  const Matrix3<T>& mass() const { return mass_; }  ///< with all effects inside
  const T& inputDelay() const { return delay_; }    ///< [s]
  /// A time [s] with derivatives of which the derivative by the delay is known.
  T withDelay(const ValueOf<T>& seconds, const ValueOf<T>& by_delay) const {
    return seconds + by_delay * (delay_ - valueOf(delay_));
  }
  int stateCount() const { return static_cast<int>(initial_.size()); }
  /// The states of all effects before anything has been commanded.
  const std::vector<T>& initialStates() const { return initial_; }
  /// Whether effects depend on what was before: then every step is an actuate() and a step().
  bool hasMemory() const { return !actuators_.empty() || !rates_.empty(); }
  Settling settling() const;
  /// Whether velocities depend on the pose: else they can be simulated without it.
  bool usesPose() const { return uses_pose_; }

  /// Passes a command, held over a step of length h [s], through the actuators; their states are
  /// advanced to the end of the step. Those of other effects are left to step().
  StepInputs<T> actuate(const Vector2<T>& command, const ValueOf<T>& lift, const T& h,
                        T* states) const;
  /// Advances the states of all effects by h [s] under a command, the motion held: what they
  /// remember of the time before a simulation, whose motion is not known.
  void settle(const T& t, const RigidState<T>& state, const Vector2<T>& command,
              const ValueOf<T>& lift, const T& h, T* states) const;

  /// Time derivative of the rigid state; its `nu` is the body acceleration. Here and below, t [s]
  /// is the time since the drive began (DriveClock); what is below 0 counts as 0. `states` are the
  /// effects', by default as they begin.
  RigidState<T> derivative(const T& t, const RigidState<T>& state, const Vector2<T>& input,
                           const ValueOf<T>& lift, const T* states = nullptr) const;
  /// `count` classical RK4 steps of length h [s] from t, which is advanced; each begins with the
  /// same inputs. H is ValueOf<T>, or T where h has derivatives. The pose stays as it is unless kPose.
  /// The states of effects that have rates() are integrated along, of the same order: what changes
  /// in less than 36% of h makes the step unstable.
  template <bool kPose = true, typename H = T>
  void step(T& t, RigidState<T>& state, const StepInputs<T>& inputs, const H& h,
            int count = 1) const;
  /// The same with a command that is held and, effects having no memory, acts as it is.
  template <bool kPose = true, typename H = T>
  void hold(T& t, RigidState<T>& state, const Vector2<ValueOf<T>>& command, const ValueOf<T>& lift,
            const H& h, int count = 1) const;
  /// What the mocap sees of a state.
  Measurement<T> measure(const RigidState<T>& state) const;
  /// Whether that is other than the state.
  bool distorts() const { return !measure_.empty(); }

 private:
  struct Active {
    const EffectHooks<T>* effect;
    const T* p;
    int state;  ///< offset of its states
  };

  void add(const Model::Entry& entry, const T* p);

  /// What the thrusters do as long as their input stays.
  struct Drive {
    Vector2<T> input, thrust;  ///< for effects: thrust is that before they change it [N]
    T surge, yaw;              ///< acceleration by that thrust, for a mass matrix diag(m, m, I_z)
  };
  /// `input` is of T or ValueOf<T>.
  template <typename I>
  Drive drive(const Vector2<I>& input) const;
  template <bool kFirst, bool kLast, bool kPose, typename H>
  void take(Stages<T, kPose, H>& stages, const T& t, const H& after, const H& share, const H& to,
            const Drive& drive, const ValueOf<T>& lift, T* states, bool remembers) const;
  template <bool kPose, typename H>
  void run(T& t, RigidState<T>& state, const std::array<const Drive*, 3>& drives,
           const ValueOf<T>& lift, T* states, const H& h, int count) const;
  /// What effects look at, at one instant.
  struct Instant;
  /// Acceleration that effects add to that of thrusters, linear damping and Coriolis forces; with a
  /// mass matrix that couples, the whole acceleration. `heading` is that of eta, only looked at
  /// where motion depends on the pose.
  Vector3<T> effects(const T& t, const Vector3<T>& eta, const Rotation<T>& heading,
                     const Vector3<T>& nu, const Drive& drive, const ValueOf<T>& lift,
                     const T* states, T* rates) const;
  /// The derivatives of the effects' states.
  void rates(Instant& instant, const T* states, T* rates) const;

  /// The states of effects during a Runge-Kutta step.
  struct StateStages {
    std::vector<T> begin, at, rates;

    /// `share` of the rates is added to the end of the step; the next stage is `to` along them.
    template <typename H>
    void move(const H& share, const H& to, T* end);
  };

  std::vector<EffectPtr> instances_;
  std::vector<T> coordinates_;
  std::vector<Active> actuators_, rates_, thrust_, wrench_, measure_;
  std::vector<T> initial_;       ///< states of the effects
  mutable StateStages stages_;   ///< scratch of one thread
  Body<T> body_;
  Matrix3<T> mass_, mass_inverse_;
  Vector3<T> over_mass_, damping_;  ///< 1/m, 1/m, 1/I_z; X_u/m, Y_v/m, N_r/I_z
  T lever_{};                       ///< l/I_z
  T surge_gain_{}, yaw_gain_{};     ///< k/m, k l/I_z
  Vector2<T> air_;
  T delay_{};
  int directions_ = 8;
  bool uses_pose_ = false, has_air_ = false;
  bool couples_ = false;    ///< the mass matrix is not diag(m, m, I_z)
  bool has_hooks_ = false;  ///< there are effects to ask at every instant
};

extern template class Dynamics<double>;
extern template class Dynamics<Jet>;
extern template class Dynamics<Lanes>;
extern template class Dynamics<LanesJet>;

}  // namespace ground
