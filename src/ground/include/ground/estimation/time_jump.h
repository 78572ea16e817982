#pragma once

#include <string>

namespace ground {

/// Notices that the clock by which messages are stamped was set, by comparing it with a steady
/// clock, which nobody sets.
///
/// A wall clock passes as fast as the steady one, but for corrections that slew it by up to 10%:
/// it was set when the two diverge by more than 0.15 s beyond that. This also finds a suspended
/// computer.
///
/// A simulated clock passes at any pace, changes it, pauses, and catches up after a pause. It was
/// set when it goes back by more than 0.05 s, or when one step is more than 0.5 s longer than the
/// pace of late explains, with what it fell behind during the last second. Its first half second
/// shows the pace; until then only a step back is found.
class TimeJumpDetector {
 public:
  enum class Clock { kWall, kSimulated };

  /// Takes the time [s] that the clock shows at an instant of the steady clock [s]. Returns by how
  /// much it was set since the last call [s]: positive ahead, negative back, 0 when it was not.
  double update(double steady, double time, Clock clock);
  /// Forgets all; the next call starts anew.
  void reset() { *this = TimeJumpDetector(); }

 private:
  double wall(double elapsed, double advance);
  double simulated(double steady, double time, double elapsed, double advance);
  void learnPace(double steady, double time);

  bool started_ = false;
  Clock clock_ = Clock::kWall;
  double steady_ = 0;       ///< at the last call; with a simulated clock, when it last moved [s]
  double time_ = 0;         ///< at the last call [s]
  double divergence_ = 0;   ///< of a wall clock from the steady one, less what slews [s]
  bool pace_known_ = false;
  double pace_ = 0;         ///< simulated seconds per second, of late
  double behind_ = 0;       ///< of what the pace promised a simulated clock [s]
  double pace_steady_ = 0;  ///< where the pace is being measured from [s]
  double pace_time_ = 0;    ///< the same on the simulated clock [s]
};

/// "time jumped back by 2.0 s" or "time jumped ahead by 2.0 s".
std::string describeTimeJump(double jump);

}  // namespace ground
