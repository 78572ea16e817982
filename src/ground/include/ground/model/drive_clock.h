#pragma once

#include <limits>
#include <vector>

namespace ground {

/// The origin of t (Point::t), the time on which effects such as battery_sag depend. Simulator,
/// controllers, live comparison and identification all take it from here:
///
/// t is the time since the drive began. A drive begins with the first command whose lift is above
/// 0; before the first drive t is 0. Lift that is off for more than kPause ends a drive, and the
/// next command with lift begins another one at t = 0. A shorter pause, such as that of a lost
/// link, does not end it.
///
/// The clock learns when drives began from the commands, each held until the next, and from
/// records of it (ground_msgs/Drive): whoever starts to listen or to record in the middle of a
/// drive needs these. Times are in seconds on the caller's clock, which should begin near 0 so that
/// differences of doubles are exact.
class DriveClock {
 public:
  static constexpr double kPause = 2.0;  ///< longest pause of the lift within a drive [s]
  /// By how much commands of several controllers, and records of them, may come out of order [s].
  static constexpr double kDisorder = 0.1;

  DriveClock() = default;
  /// Drives began at `starts` [s], ascending. Throws std::invalid_argument when they do not ascend
  /// or are not finite.
  explicit DriveClock(std::vector<double> starts);

  /// Takes a command in order of time; returns whether a drive begins with it. A command earlier
  /// than the last one by more than kDisorder means that the caller's clock was set back: drives
  /// that began later are forgotten.
  bool command(double time, double lift);
  /// Takes a record: at `as_of` [s] the newest drive was the one that began at `began` [s]. It takes
  /// the place of those that seemed to begin between the two, or up to kDisorder earlier. A record
  /// that is not finite or of the future (began > as_of) is left out.
  void record(double began, double as_of);

  /// When the drive of time `time` began [s]; before the first drive, when that begins; infinity
  /// while none is known.
  double origin(double time) const;
  /// The t of time `time` [s], never below 0.
  double since(double time) const;
  /// When each drive began [s], ascending.
  const std::vector<double>& starts() const { return starts_; }

 private:
  static constexpr double kNever = -std::numeric_limits<double>::infinity();

  std::vector<double> starts_;
  double newest_ = kNever;     ///< time of the last command [s]
  bool lifting_ = false;       ///< the last command has lift
  double off_since_ = kNever;  ///< since when the lift has been off while it is [s]
};

}  // namespace ground
