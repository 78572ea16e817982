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
  double window = 10.0;  ///< over which errors are averaged [s]
  ObserverParams observer;

  /// Says what is wrong; empty when nothing is.
  std::string validate() const;
};

/// A model run beside a running experiment: where it and the measurement part, and which wrench it
/// lacks. The model starts at the state of a horizon ago, as an observer around it saw it then, and
/// runs with the commands since.
class ModelMonitor {
 public:
  /// Where model and measurement part at one instant.
  struct Error {
    double horizon;                 ///< of the prediction [s]
    Measurement<double> predicted;  ///< by the model
    Vector3<double> eta, nu;        ///< measured minus predicted; the heading's wrapped
    Vector3<double> wrench;         ///< missing: X, Y [N], N [N m], body
    Vector3<double> mean;           ///< of |nu| over the window
    Vector3<double> spread;         ///< standard deviations of the measured nu in the window
    double error;                   ///< sum of mean / spread
    double error_now;               ///< sum of |nu| / spread
    double covered;                 ///< part of the window that there are errors of [s]
  };

  /// Throws std::invalid_argument on a model that the observer cannot follow.
  ModelMonitor(const Model& model, const MonitorParams& params);

  void setParams(const MonitorParams& params);
  /// Forgets what was measured and commanded, but not when the drives began.
  void reset();
  /// A command in the model's units. One that is older than the last means that time has jumped
  /// back, and everything is forgotten.
  void command(double time, const Vector2<double>& thrusters, double lift);
  /// Takes the drives known so far, the origin of the model's t; commands add later ones.
  void setDrive(const DriveClock& drive) { inputs_.drive = drive; }
  /// A valid state; nothing until there is a state a horizon ago to predict from, or when the
  /// prediction is not finite. The same for times that jump back.
  std::optional<Error> measure(double time, const RigidState<double>& measured);
  /// What the model makes of the last horizon: measured poses, some `step` [s] apart.
  std::vector<Vector3<double>> path(double step) const;
  const Model& model() const { return model_; }

 private:
  struct Sample {
    double time;
    RigidState<double> state;  ///< by the observer: quieter than what was measured
  };
  /// What is averaged.
  struct Score {
    double time;
    Vector3<double> error, nu;
  };

  const Sample* start(double time) const;
  Simulation<double> simulate(const Sample& from) const;
  void add(const Score& score);

  Model model_;
  MonitorParams params_;
  Dynamics<double> dynamics_;
  DisturbanceObserver observer_;
  InputSequence inputs_;  ///< on the clock that starts with the first state
  std::deque<Sample> samples_;
  std::deque<Score> scores_;
};

/// Which of two models, monitored side by side, predicts better now.
struct Preference {
  double difference = 0;      ///< of the errors, first minus second: below 0 the first is better
  double standard_error = 0;  ///< of it, by blocks as long as the horizon
  bool clear() const { return std::abs(difference) > 2 * standard_error && standard_error > 0; }
};

/// Compares normalised errors of two models at the same instants over a window.
class ModelContest {
 public:
  ModelContest(double horizon, double window) : horizon_(horizon), window_(window) {}
  /// Errors of both models at one instant.
  void add(double time, const ModelMonitor::Error& first, const ModelMonitor::Error& second);
  /// Nothing before there are four blocks.
  std::optional<Preference> preference() const;

 private:
  double horizon_, window_;
  std::deque<std::pair<double, double>> differences_;  ///< time [s], first minus second
};

}  // namespace ground
