#pragma once

#include <Eigen/Core>
#include <array>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "ground/model/simulation.h"

namespace ground {

/// Detects from a craft's motion whether it follows its commands, and if not, what it does instead.
///
/// The motion is cut into intervals of 0.1 s. From the state measured at the start of each, the
/// model predicts the velocities at the end under several hypotheses:
///
/// - The craft follows its commands: with half, all and twice the commanded thrust, at once and up
///   to 0.2 s later, because the model may be wrong by that much.
/// - It does not: no thrust (a craft that does not receive its commands turns its motors off), a
///   fifth or five times the thrust, one thruster off, no lift, or, if there are two thrusters,
///   both swapped.
///
/// The measured velocities give each hypothesis a log-likelihood (Student's t, so that a single
/// collision has little weight). Noise, random pushes, a trim and a wrong drag (kPush, kTrim,
/// kDrag) make the predictions uncertain; with small commands a decision therefore takes longer.
/// The sum over a period decides, and both halves of the period have to agree.
class ObedienceMonitor {
 public:
  explicit ObedienceMonitor(const Model& model);
  ObedienceMonitor(const ObedienceMonitor&) = delete;
  ObedienceMonitor& operator=(const ObedienceMonitor&) = delete;

  /// Discards all commands and states, but not the drive.
  void reset();
  /// Sets the drives known so far, which define the model's t; commands add later ones.
  void setDrive(const DriveClock& drive);
  /// Adds a command, in the model's units, sent at `time` [s]; times must ascend.
  void command(double time, const Thrusters<double>& thrusters, double lift);
  /// The voltage of the battery from now on [V].
  void voltage(double volts);
  /// Adds a valid state measured at `time` [s], and the variance of its velocities. Ignored if its
  /// time does not ascend.
  void measure(double time, const RigidState<double>& state, const Vector3<double>& nu_variance);
  /// What the craft did during the last `duration` seconds, at most 10, instead of following its
  /// commands, such as "it moves as without thrust"; empty if it followed them. If the period does
  /// not give enough evidence, tries twice and four times as long.
  std::string disobedience(double duration);

 private:
  /// A hypothesis about a craft that does not follow its commands. The first one is no thrust.
  struct Explanation {
    std::string text;                     ///< for messages, after "it moves"
    Thrusters<double> shares;             ///< inputs of the thrusters relative to their commands
    double strength = 1;                  ///< of the thrust, relative to the model's
    bool swapped = false, lifted = true;  ///< whether two thrusters are swapped; lift fan works
  };
  static constexpr int kMaxCount = kMaxThrusters + 4;  ///< largest number of other hypotheses
  static constexpr int kDelayCount = 3, kFollowingCount = 9;
  /// Log-likelihoods with half, all and twice the commanded thrust, at once and later.
  using Following = Eigen::Array<double, kFollowingCount, 1>;
  using Evidence = Eigen::Array<double, Eigen::Dynamic, 1, 0, kMaxCount, 1>;
  /// Log-likelihoods of one interval.
  struct Interval {
    double end;  ///< [s]
    Following following;
    Evidence others;
  };
  struct Sample {
    double time = 0;
    RigidState<double> state;
    Vector3<double> nu_variance;
  };
  struct Spread;

  void addExplanations();
  Evidence noEvidence() const { return Evidence::Zero(static_cast<Eigen::Index>(others_.size())); }
  Vector3<double> predict(const Dynamics<double>& dynamics, const InputSequence& inputs, double time) const;
  Interval compare(Sample& now) const;
  static void correct(Sample& now, const Vector3<double>& predicted, const Vector3<double>& grown);
  Evidence evidenceOfOthers(double duration) const;
  std::vector<const Explanation*> likely(double duration, Eigen::Index best) const;
  RigidState<double> centre(const RigidState<double>& seen) const;
  bool lifted() const;

  Dynamics<double> dynamics_;
  Dynamics<double> sitting_;   ///< with a skirt that brakes without lift
  Dynamics<Jet> derivatives_;  ///< dynamics_ with derivatives
  Vector2<double> most_;       ///< accelerations by full thrust [m/s^2] and in the fastest turn [rad/s^2]
  std::array<InputSequence, std::size_t{kDelayCount}> delayed_;  ///< commands, at once and later
  std::vector<Explanation> explanations_;
  std::vector<InputSequence> others_;  ///< inputs by each explanation
  VoltageSeries battery_;              ///< of all of them: the last voltage
  DriveClock drive_;                   ///< with which they begin
  bool started_ = false;
  Sample start_;  ///< start of the current interval
  std::deque<Interval> intervals_;
};

}  // namespace ground
