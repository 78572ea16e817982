#pragma once

#include <limits>
#include <vector>

namespace ground {

/// Defines t (Point::t), the time on which effects such as battery_sag depend. Simulator,
/// controllers, live comparison and identification all use this definition:
///
/// t is the time since the drive began. A drive begins with the first command whose lift is above
/// 0; before the first drive t is 0. A drive ends when the lift is off for more than kPause; the
/// next command with lift begins another drive at t = 0. A shorter pause, such as a lost link, does
/// not end the drive.
///
/// The clock derives the start of each drive from the commands, each held until the next, and from
/// recorded starts (ground_msgs/Drive). A listener or recorder that begins in the middle of a drive
/// needs the recorded start. Times are in seconds on the caller's clock, which should begin near 0
/// so that differences of doubles are exact.
class DriveClock {
 public:
  static constexpr double kPause = 2.0;  ///< longest pause of the lift within a drive [s]
  /// Largest time by which commands and recorded starts may arrive out of order [s].
  static constexpr double kDisorder = 0.1;

  DriveClock() = default;
  /// Drives began at `starts` [s], ascending. Throws std::invalid_argument when they do not ascend
  /// or are not finite.
  explicit DriveClock(std::vector<double> starts);

  /// Adds a command, in order of time; returns whether a drive begins with it. A command that is
  /// more than kDisorder earlier than the previous one means that the caller's clock was set back:
  /// the clock then discards all drives that began later.
  bool command(double time, double lift);
  /// Adds a recorded start: at `as_of` [s] the newest drive was the one that began at `began` [s].
  /// It replaces starts derived from commands between `began` - kDisorder and `as_of`. Ignored if
  /// not finite or if began > as_of.
  void record(double began, double as_of);

  /// Start of the drive that `time` belongs to [s]; before the first drive, the start of the first;
  /// infinity if no drive is known.
  double origin(double time) const;
  /// Time since the drive began, t, at `time` [s]; never below 0.
  double since(double time) const;
  /// When each drive began [s], ascending.
  const std::vector<double>& starts() const { return starts_; }

 private:
  static constexpr double kNever = -std::numeric_limits<double>::infinity();

  std::vector<double> starts_;
  double newest_ = kNever;     ///< time of the last command [s]
  bool lifting_ = false;       ///< whether the last command has lift
  double off_since_ = kNever;  ///< time at which the lift last went off [s]
};

}  // namespace ground
