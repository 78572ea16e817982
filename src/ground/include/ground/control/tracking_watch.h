#pragma once

#include <string>

#include "ground/control/reference_trajectory.h"

namespace ground {

/// Default position error [m] at which a craft has lost the reference: a quarter of the reference's
/// half-width (of a circle's radius), between 0.05 and 0.5 m.
double defaultMaxError(const ReferenceTrajectory& reference);

/// Detects a craft that does not follow its reference. Reads no clock: the caller gives the time.
///
/// - A craft may start anywhere, and a reference may start suddenly. The craft has arrived when its
///   error has been within max_error for kPatience.
/// - After arrival, it stops if the error exceeds max_error for kPatience.
/// - Before arrival, it stops after kApproach.
/// - Only time in which the craft was observed counts: an interval between two looks counts as at
///   most kLongestInterval, so that a loss of the mocap does not count as a lasting error.
/// - After a loss, errors do not count for kCatchUp, because the craft stood while the reference
///   moved on, and may have to turn.
class TrackingWatch {
 public:
  static constexpr double kPatience = 1.0;         ///< [s]
  static constexpr double kApproach = 20.0;        ///< [s]
  static constexpr double kLongestInterval = 0.1;  ///< a longer interval of looks is a loss [s]
  static constexpr double kCatchUp = 2.0;          ///< [s]

  /// Sets the largest error [m], positive; takes effect with the next look.
  void setMaxError(double max_error) { max_error_ = max_error; }
  /// Call when a reference begins.
  void restart();
  /// Adds the distance `error` [m] from the reference at `time` [s] since it began. Returns why to
  /// stop; empty if the craft may continue.
  std::string look(double time, double error);
  bool arrived() const { return arrived_; }

 private:
  double max_error_ = 0.5;
  bool begun_ = false, arrived_ = false;
  double last_time_ = 0;    ///< time of the last look [s]
  double approaching_ = 0;  ///< observed time before arrival [s]
  double inside_ = 0;       ///< how long the error has been within max_error [s]
  double outside_ = 0;      ///< how long the error has been too large [s]
  double caught_up_ = 0;    ///< time from which errors count again after a loss [s]
};

}  // namespace ground
