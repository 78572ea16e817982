#pragma once

#include <string>

namespace ground {

/// Detects that the clock of message stamps was set, by comparison with a steady clock.
///
/// A wall clock runs as fast as the steady one, except for slewing by up to 10%. It was set if the
/// two diverge by more than 0.15 s beyond that. This also detects that the computer was suspended.
///
/// A simulated clock runs at any pace, which may change; it may pause, and catch up after a pause.
/// It was set if it steps back by more than 0.05 s, or if one step is more than 0.5 s longer than
/// the recent pace explains, including the delay of the last second that it may catch up. The pace
/// is measured during the first half second; until then only a step back is detected.
class TimeJumpDetector {
 public:
  enum class Clock { kWall, kSimulated };

  /// `time`: what the clock shows at time `steady` of the steady clock [s]. Returns by how much the
  /// clock was set since the last call [s]: positive ahead, negative back, 0 if it was not set.
  double update(double steady, double time, Clock clock);
  /// Discards all; the next call restarts.
  void reset() { *this = TimeJumpDetector(); }

 private:
  double wall(double elapsed, double advance);
  double simulated(double steady, double time, double elapsed, double advance);
  void learnPace(double steady, double time);

  bool started_ = false;
  Clock clock_ = Clock::kWall;
  double steady_ = 0;      ///< last call, or last change of a simulated clock; steady clock [s]
  double time_ = 0;        ///< the clock at the last call [s]
  double divergence_ = 0;  ///< wall clock minus steady clock, without slewing [s]
  bool pace_known_ = false;
  double pace_ = 0;         ///< recent pace, simulated seconds per second
  double behind_ = 0;       ///< delay of a simulated clock relative to its pace [s]
  double pace_steady_ = 0;  ///< start of the current measurement of the pace, steady clock [s]
  double pace_time_ = 0;    ///< start of the current measurement, simulated clock [s]
};

/// Text such as "time jumped back by 2.0 s" or "time jumped ahead by 2.0 s".
std::string describeTimeJump(double jump);

}  // namespace ground
