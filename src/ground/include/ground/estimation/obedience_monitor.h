#pragma once

#include <Eigen/Core>
#include <array>
#include <deque>
#include <string>

#include "ground/model/simulation.h"

namespace ground {

/// Judges by a craft's motion whether it does as it is told, and what it does instead.
///
/// It cuts the motion into intervals of 0.1 s. From the state measured at the start of each, the
/// model predicts the velocities at the end: with half, all and twice of the thrust that was
/// commanded, at once and up to 0.2 s later, because the model may be wrong by that much, and by
/// every other explanation: no thrust (the motors of a craft that does not hear its commands are
/// off, whatever is sent to it), a fifth or five times of it, left and right swapped, one thruster
/// off, no lift. The measured velocities give each a logarithm of a likelihood (Student's t, so that
/// one collision counts little). Noise, pushes, a trim and a wrong drag (kPush, kTrim, kDrag) make
/// the predictions uncertain, so that small commands say little and are looked at for longer. The
/// sum over some time decides, and each half of it has to agree.
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
  /// What the craft has done during the last `duration` seconds, 10 at most, in place of what it was
  /// told, such as "it moves as without thrust"; empty when it has done as told. Where that is too
  /// short to tell, during twice or four times as long.
  std::string disobedience(double duration) const;
  /// Evidence of the last `duration` seconds for the best other explanation against what was
  /// commanded: logarithm of the likelihood ratio.
  double evidence(double duration) const;

  static constexpr double kEvidence = 4.0;  ///< with which a craft is said not to do as told

 private:
  static constexpr int kCount = 7;  ///< other explanations
  static constexpr int kLateCount = 3, kToldCount = 9;
  /// Half, all and twice of the thrust, at once and later.
  using Told = Eigen::Array<double, kToldCount, 1>;
  using Evidence = Eigen::Array<double, kCount, 1>;
  /// An interval and the logarithms of its likelihoods, negative.
  struct Interval {
    double end;  ///< [s]
    Told told;
    Evidence others;
  };
  struct Sample {
    double time;
    RigidState<double> state;
    Vector3<double> nu_variance;
  };
  struct Spread;

  Vector3<double> predict(const Dynamics<double>& dynamics, const InputSequence& inputs,
                          double time) const;
  Interval compare(const Sample& now) const;
  Evidence evidenceOfOthers(double duration) const;
  std::string likely(double duration, Eigen::Index best) const;
  RigidState<double> centre(const RigidState<double>& seen) const;
  bool lifted() const;
  void forgetOldCommands(double time);

  Dynamics<double> dynamics_, sitting_;  ///< sitting_: with a skirt that brakes without lift
  Dynamics<Jet> derivatives_;            ///< of dynamics_
  double most_;                          ///< acceleration of full thrust [m/s^2]
  double most_yaw_;                      ///< of one thruster's full moment [rad/s^2]
  std::array<InputSequence, std::size_t{kLateCount}> told_;
  std::array<InputSequence, std::size_t{kCount}> others_;
  bool started_ = false;
  Sample start_;  ///< of the interval
  std::deque<Interval> intervals_;
};

}  // namespace ground
