#pragma once

#include <deque>
#include <optional>

namespace ground {

/// Whether a model has predicted the motion for long enough that a craft can have changed since.
///
/// A model that is wrong from the start looks like one change after another. So a change is believed only if
/// the model held before it began, for kHold. Each failure within kMemory doubles this time: a model that
/// fails now and then needs longer. Times are in seconds on the caller's clock.
class ModelTrust {
 public:
  explicit ModelTrust(double time_scale) : scale_(time_scale) {}

  /// Forgets everything; the motion is watched from the next instant on.
  void reset();
  /// The motion is as predicted at `time`; the first call begins the watch.
  void observe(double time);
  /// Whether the model held for long enough before a change that began at `start`.
  bool holdsBefore(double start) const;
  /// The motion is not as predicted, and no change that is believed explains it yet: holding begins anew.
  void disturb(double time) { held_since_ = time; }
  /// No change explains the motion.
  void fail(double time);
  /// Something hit the craft: a failure only of a model that has never held.
  void hit(double time);
  /// A change was named; the changed model has to hold before the next is believed.
  void named(double time) { interrupt(time); }
  /// Start of the failures that have not been followed by a hold; the beginning of the watch if the model has
  /// never held. Empty if there are fewer than kFailures.
  std::optional<double> doubtSince() const { return doubt_since_; }
  /// Whether the model has held since the watch began.
  bool hasHeld() const { return has_held_; }

 private:
  static constexpr double kHold = 4;     ///< shortest hold [time scales]
  static constexpr double kMemory = 60;  ///< of failures [time scales]
  static constexpr int kFailures = 2;    ///< that are no accident, such as one collision

  double required(double time) const;
  void interrupt(double time);

  double scale_;                      ///< of time [s]
  std::optional<double> began_;       ///< of the watch [s]
  double held_since_ = 0;             ///< [s]
  std::deque<double> interruptions_;  ///< times of failures and names within the memory [s]
  std::deque<double> failures_;       ///< times of failures since the last hold [s]
  bool has_held_ = false;
  std::optional<double> doubt_since_;
};

}  // namespace ground
