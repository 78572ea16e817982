#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "ground/model/drive_clock.h"
#include "ground/model/types.h"

namespace ground {

/// Commands over time, each held until the next; thrusters and lift are off before the first.
struct InputSequence {
  std::vector<double> times;               ///< ascending, on the run's clock [s]
  std::vector<Vector2<double>> thrusters;  ///< left, right
  std::vector<double> lift;
  DriveClock drive;  ///< knows the commands that were added, also those that were dropped

  void add(double time, double left, double right, double lift);
  /// Takes the first `count` commands away; simulations through it have to be told (forget).
  void drop(std::size_t count);
  std::size_t size() const { return times.size(); }
};

/// Steps of equal length under one command.
struct Stretch {
  int steps;
  double h;         ///< [s]
  double by_delay;  ///< derivative of h by the delay of the inputs
  double t;         ///< since the drive began, at the first step; below 0 before it [s]
};

constexpr double kActuatorMemory = 10.0;  ///< effects forget what was commanded before [s]
/// Longest step of states that settle without the motion [s]: Runge-Kutta steps are stable for time
/// constants above 36% of it.
constexpr double kSettlingStep = 0.01;

/// How the effects of a model come to the start of a simulation.
struct Settling {
  double memory = 0;  ///< the commands of so many seconds before act on their states [s]
  double step = std::numeric_limits<double>::infinity();  ///< longest piece of a command [s]

  bool operator==(const Settling& other) const {
    return memory == other.memory && step == other.step;
  }
};

/// Which steps a simulation takes: they end exactly at the instants asked for and at those where
/// the delayed command changes, so that RK4 keeps its order and derivatives by the delay are exact.
/// The sequence must outlive it and may grow.
class Stepping {
 public:
  /// From time `start` [s] of the sequence's clock; inputs act `delay` [s] late, which may `vary`:
  /// there are stretches of no length then that have a derivative. Steps are at most max_step [s].
  Stepping(const InputSequence& inputs, double start, double delay, bool varies, double max_step);

  /// The next stretch on the way to `time` [s]; false when it is reached. Throws
  /// std::invalid_argument when that is before the current time.
  bool next(double time, Stretch& stretch);

  /// `count` commands have been dropped from the sequence, none of which still acts.
  void forget(std::size_t count);

  double time() const { return time_; }
  /// Held over the last stretch.
  Vector2<double> thrusters() const;
  double lift() const;

  /// A command and for how long it acts [s], its derivative by the delay included.
  struct Held {
    std::size_t command;
    double duration, by_delay;
    double t;  ///< since the drive began, at its beginning; below 0 before it [s]
  };
  /// The commands before the start, in pieces, to which effects have to be settled.
  std::vector<Held> before(const Settling& settling) const;
  /// Since the drive began, now; below 0 before it [s].
  double t() const { return time_ - inputs_->drive.origin(time_); }

 private:
  bool reach(double time, bool moves, Stretch& stretch);

  const InputSequence* inputs_;
  double time_, delay_, max_step_;
  bool varies_;
  bool moves_ = false;    ///< the current time does with the delay
  std::size_t next_ = 0;  ///< first command that has not taken effect
  std::size_t held_ = 0;  ///< the same during the last stretch
};

}  // namespace ground
