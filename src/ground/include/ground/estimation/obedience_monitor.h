#pragma once

#include <deque>

#include "ground/model/simulation.h"

namespace ground {

/// Judges by a craft's motion whether it does as it is told: the motors of one that does not hear
/// its commands are off, whatever is sent to it.
///
/// It cuts the motion into intervals of 0.1 s. From the state measured at the start of each, the
/// model predicts the velocities at the end twice: with the commands that were sent, and without
/// thrust. What the measured velocities say of the two is a logarithm of a likelihood ratio
/// (Student's t, so that one collision counts little): no thrust, against half of what the model
/// makes of the commands, because the model may be wrong by that much. Noise, pushes, a trim and a
/// wrong drag (kPush, kTrim, kDrag) make the prediction uncertain, so that small commands say
/// little and are looked at for longer. The sum over some time decides, and each half of it has to
/// agree.
class ObedienceMonitor {
 public:
  explicit ObedienceMonitor(const Model& model);

  /// Forgets all commands and states.
  void reset();
  /// A command, in the model's units, that was sent at `time` [s]; times ascend.
  void command(double time, const Vector2<double>& thrusters, double lift);
  /// A valid state that was measured at `time` [s], and the variance of its velocities. Times that
  /// do not ascend are left out.
  void measure(double time, const RigidState<double>& state, const Vector3<double>& nu_variance);
  /// Evidence of the last `duration` seconds that the craft has no thrust, against half of what was
  /// commanded: logarithm of the likelihood ratio, positive for none.
  double evidence(double duration) const;
  /// Whether the craft has not done as told during the last `duration` seconds, 10 at most; where
  /// that is too short to tell, during twice or four times as long.
  bool disobeys(double duration) const;

  static constexpr double kEvidence = 4.0;  ///< with which a craft is said not to do as told

 private:
  struct Interval {
    double end;  ///< [s]
    double evidence;
  };
  struct Sample {
    double time;
    RigidState<double> state;
    Vector3<double> nu_variance;
  };

  RigidState<double> predict(const InputSequence& inputs, double time) const;
  double compare(const Sample& now) const;
  void forgetOldCommands(double time);

  Dynamics<double> dynamics_;
  double most_;            ///< acceleration of full thrust [m/s^2]
  double most_yaw_;        ///< of one thruster's full moment [rad/s^2]
  InputSequence inputs_;   ///< as they were sent
  InputSequence without_;  ///< the lift alone
  bool started_ = false;
  Sample start_;  ///< of the interval
  std::deque<Interval> intervals_;
};

}  // namespace ground
