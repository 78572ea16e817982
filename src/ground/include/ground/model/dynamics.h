#pragma once

#include <vector>

#include "ground/model/model.h"

namespace ground {

/// Rigid-body state at one instant.
template <typename T>
struct RigidState {
  Vector3<T> eta = Vector3<T>::Zero();  ///< x, y [m], psi [rad], world_ned
  Vector3<T> nu = Vector3<T>::Zero();   ///< u, v [m/s], r [rad/s], body
};

/// Equations of motion (2.3), (2.4) with the model's effects inside, for one set of parameters.
/// Instantiated for double and Jet. One thread at a time.
template <typename T>
class Dynamics {
 public:
  /// `coordinates`: all parameters in the order of Model::parameters().
  Dynamics(const Model& model, const std::vector<T>& coordinates);
  /// With the model's own parameters.
  explicit Dynamics(const Model& model);

  const Body<T>& body() const { return body_; }
  const Matrix3<T>& mass() const { return mass_; }  ///< with all effects inside
  const T& inputDelay() const { return delay_; }  ///< [s]
  int stateCount() const { return state_count_; }
  bool hasActuators() const { return !actuators_.empty(); }
  /// Whether velocities depend on the pose: else they can be simulated without it.
  bool usesPose() const { return uses_pose_; }

  /// Passes a command, held over a step of length h [s], through the actuators; their states are
  /// advanced to the end of the step.
  StepInputs<T> actuate(const Vector2<T>& command, double lift, const T& h, T* states) const;

  /// Time derivative of the rigid state at run time t [s]; `nu_dot` is the body acceleration.
  RigidState<T> derivative(const T& t, const RigidState<T>& state, const Vector2<T>& input,
                           double lift) const;
  /// One classical Runge-Kutta step of order 4 and length h [s] from run time t [s]; H is double,
  /// or T where the length has derivatives. The pose stays as it is unless kPose.
  template <bool kPose = true, typename H = T>
  RigidState<T> step(const T& t, const RigidState<T>& state, const StepInputs<T>& inputs,
                     const H& h) const;
  /// What the mocap sees of a state.
  Measurement<T> measure(const RigidState<T>& state) const;

 private:
  struct Active {
    const EffectHooks<T>* effect;
    const T* p;
    int state;  ///< offset of its states
  };

  /// Nothing but thrust and linear damping moves the craft.
  bool isNominal() const {
    return actuators_.empty() && thrust_.empty() && wrench_.empty() && !has_air_ && !couples_;
  }
  /// Of the pose, world_ned.
  Vector3<T> drift(const Rotation<T>& heading, const Vector3<T>& nu) const;
  /// `heading` is that of eta; only looked at where motion depends on the pose.
  Vector3<T> acceleration(const T& t, const Vector3<T>& eta, const Rotation<T>& heading,
                          const Vector3<T>& nu, const Vector2<T>& input, double lift) const;
  /// Surge and yaw acceleration by the thrusters alone.
  Vector2<T> drive(const Vector2<T>& thrust) const;
  /// With damping in the air and Coriolis, for a mass matrix diag(m, m, I_z).
  Vector3<T> accelerationBy(const Vector2<T>& drive, const Vector3<T>& nu,
                            const Vector3<T>& nu_air) const;

  std::vector<EffectPtr> instances_;
  std::vector<T> coordinates_;
  std::vector<Active> actuators_, thrust_, wrench_, measure_;
  Body<T> body_;
  Matrix3<T> mass_, mass_inverse_;
  Vector3<T> over_mass_, damping_;  ///< 1/m, 1/m, 1/I_z; X_u/m, Y_v/m, N_r/I_z
  T lever_{};                       ///< l/I_z
  Vector2<T> air_;
  T delay_{};
  int state_count_ = 0;
  bool uses_pose_ = false, has_air_ = false;
  bool couples_ = false;  ///< the mass matrix is not diag(m, m, I_z)
};

extern template class Dynamics<double>;
extern template class Dynamics<Jet>;

}  // namespace ground
