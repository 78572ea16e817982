#pragma once

#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "ground/estimation/disturbance_observer.h"
#include "ground/model/simulation.h"

namespace ground {

struct MonitorParams {
  double horizon = 1.0;  ///< how far ahead the model predicts [s]
  double window = 10.0;  ///< time over which errors are pooled [s]
  ObserverParams observer;

  /// Error message, or an empty string if all values are valid.
  std::string validate() const;
};

/// Distance between two poses, or its root mean square.
struct PoseError {
  double position = 0;  ///< [m]
  double heading = 0;   ///< [rad]
};

/// Says in which channels a model has stopped predicting the motion, and since when.
///
/// While a model holds, the missing acceleration stays within what the noise of the poses and the usual
/// disturbance leave. How long its mean has exceeded three of their deviations is a cumulative sum (Page,
/// Biometrika 41, 1954), which a collision is too short for. All times are multiples of timeScale(model).
class FailureWatch {
 public:
  explicit FailureWatch(const Model& model);

  /// Forgets everything, as for a new drive.
  void reset();
  /// Adds the missing acceleration of a craft with lift, and the part of its variance that is by the noise of
  /// the poses. moves: whether the craft moves so much that a wrong model would show.
  void add(double time, const Vector3<double>& missing, const Vector3<double>& variance, bool moves);
  /// Since when the model has not predicted surge, sway and yaw [s]; NaN where it does.
  const Vector3<double>& since() const { return since_; }

 private:
  double time_scale_;            ///< [s]
  Vector3<double> usual_;        ///< variance of the missing acceleration while the model holds
  double time_;                  ///< of the last acceleration [s]
  Vector3<double> once_, mean_;  ///< missing acceleration over about kMean
  Vector3<double> excess_;       ///< cumulative sums [time scales]
  Vector3<double> began_;        ///< when they were last 0 [s]
  Vector3<double> since_;
};

/// "yaw since 12.4 s, surge since 13.0 s", in the order of time; empty if nothing fails. since:
/// FailureWatch::since.
std::string failureText(const Vector3<double>& since);

/// Compares a model with a running experiment: how far its prediction is off, what the noise of the poses
/// alone would leave of a right model, the missing wrench, and since when it has failed. The prediction
/// starts one horizon ago at the state that a disturbance observer estimated then, and uses the commands
/// since.
class ModelMonitor {
 public:
  /// Prediction error at one instant.
  struct Error {
    double horizon;                 ///< length of the prediction [s]
    Measurement<double> predicted;  ///< measurement predicted by the model
    Vector3<double> eta;            ///< measured minus predicted; heading difference wrapped
    Vector3<double> wrench;         ///< missing wrench: X, Y [N], N [N m], body
    Vector3<double> wrench_noise;   ///< its standard deviations by the noise of the poses
    PoseError now;                  ///< size of eta
    PoseError rms;                  ///< root mean square over the window, while the craft has lift
    PoseError noise;                ///< the same for a right model, by pose noise
    bool excited;                   ///< with lift, it moves or should move by far more than noise
    double covered;                 ///< time in the window covered by errors [s]
    Vector3<double> failing_since;  ///< FailureWatch::since; a new drive begins anew
  };

  /// Throws std::invalid_argument on a model that DisturbanceObserver does not support.
  ModelMonitor(const Model& model, const MonitorParams& params);

  void setParams(const MonitorParams& params);
  /// Discards measurements and commands, but not the starts of the drives.
  void reset();
  /// Adds a command in the model's units. If it is older than the last one, time has jumped back,
  /// and everything is discarded.
  void command(double time, const Thrusters<double>& thrusters, double lift);
  /// The voltage of the battery from `time` on [V]; one that is older than the last is ignored.
  void voltage(double time, double volts);
  /// Sets the drives known so far, which define the model's t; commands add later ones.
  void setDrive(const DriveClock& drive) { inputs_.drive = drive; }
  /// Adds a valid state, with the pose that was measured, and returns the prediction error. Returns nothing
  /// if there is no state one horizon ago, the prediction is not finite, or time has jumped back.
  std::optional<Error> measure(double time, const RigidState<double>& state, const PoseMeasurement& measured);
  /// Predicted measurements of poses over the last horizon, about `step` [s] apart.
  std::vector<Vector3<double>> path(double step) const;
  const Model& model() const { return model_; }

 private:
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  struct Sample {
    double time;
    RigidState<double> state;    ///< the observer's estimate, which is less noisy than measurements
    Vector3<double> measured;    ///< pose
    Matrix3<double> pose_noise;  ///< its covariance
    Matrix6 noise;               ///< covariance of the estimate by the noise of the poses
    Matrix6 transition;          ///< derivatives of the estimate by the one before
  };
  /// Squares of position and heading, whose means over the window are reported.
  struct Score {
    double time;
    Vector2<double> error, noise, motion;
  };
  using Samples = std::deque<Sample>;

  Samples::const_iterator start(double time) const;
  Vector2<double> noiseAfter(Samples::const_iterator from) const;
  Simulation<double> simulate(const Sample& from) const;
  bool hasLift(double since) const;
  void pool(double time, Error& error);

  Model model_;
  MonitorParams params_;
  Dynamics<double> dynamics_;
  DisturbanceObserver observer_;
  InputSequence inputs_;  ///< on a clock that starts at the first state
  Samples samples_;
  std::deque<Score> scores_;
  FailureWatch failure_;
  double drive_ = 0;  ///< start of the drive that failure_ watches [s]
};

/// Which of two models currently predicts better.
struct Preference {
  double difference = 0;      ///< error of the first minus error of the second model [the noise floor is 1]
  double standard_error = 0;  ///< standard error of the difference, by blocks of one horizon
  bool clear() const { return std::abs(difference) > 2 * standard_error && standard_error > 0; }
};

/// Compares the errors of two models at the same instants over a window.
class ModelContest {
 public:
  ModelContest(double horizon, double window) : horizon_(horizon), window_(window) {}
  /// Adds the errors of both models at one instant.
  void add(double time, const ModelMonitor::Error& first, const ModelMonitor::Error& second);
  /// Returns nothing until there are four blocks.
  std::optional<Preference> preference() const;

 private:
  double horizon_, window_;
  std::deque<std::pair<double, double>> differences_;  ///< time [s], first minus second
};

}  // namespace ground
