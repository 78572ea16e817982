#pragma once

#include <string>

#include "ground/control/reference_trajectory.h"

namespace ground {

/// The error [m] beyond which a craft has lost a reference, unless told otherwise: a quarter of the
/// reference's half-width (of a circle's radius), between 0.05 and 0.5 m.
double defaultMaxError(const ReferenceTrajectory& reference);

/// Notices a craft that does not follow its reference. Free of clocks: time is what the caller
/// says.
///
/// A craft may start anywhere, and a reference may start suddenly. The craft has arrived when its
/// error has kept within max_error for a second; from then on an error beyond max_error that lasts
/// for a second is a reason to stop. Until then it has kApproach seconds, and for a second at most
/// it may be more than kDetour farther away than it started. Seconds are those in which the craft
/// was seen: an interval between two looks counts as kLongestInterval at most, so that a loss of the
/// mocap is not taken for an error that lasts. After a loss the craft has kCatchUp seconds before an
/// error counts: it stood while the reference went on, and may have to turn. (In simulation
/// ModelPredictive arrives within 4 s from rest 3 m off at any heading, with noise and parameters
/// that are wrong by a quarter, after a detour of 1.1 m at most.)
class TrackingWatch {
 public:
  static constexpr double kPatience = 1.0;         ///< [s]
  static constexpr double kApproach = 20.0;        ///< [s]
  static constexpr double kDetour = 2.0;           ///< [m]
  static constexpr double kLongestInterval = 0.1;  ///< between two looks, a longer one is a loss [s]
  static constexpr double kCatchUp = 2.0;          ///< [s]

  /// [m], positive; takes effect with the next look.
  void setMaxError(double max_error) { max_error_ = max_error; }
  double maxError() const { return max_error_; }
  /// Another reference begins, or the same one anew.
  void restart();
  /// The distance `error` [m] from the reference at `time` [s] since it began. Says why to stop;
  /// empty as long as the craft may go on.
  std::string look(double time, double error);
  bool arrived() const { return arrived_; }

 private:
  double max_error_ = 0.5;
  bool begun_ = false, arrived_ = false;
  double first_error_ = 0;   ///< at the first look [m]
  double last_time_ = 0;     ///< of the last look [s]
  double approaching_ = 0;   ///< time seen before the arrival [s]
  double inside_ = 0;        ///< for how long the error has kept within max_error [s]
  double outside_ = 0;       ///< for how long it has been too large [s]
  double caught_up_ = 0;     ///< when an error counts again after a loss [s]
};

}  // namespace ground
