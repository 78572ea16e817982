#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "ground/model/drive_clock.h"
#include "ground/model/thrusters.h"
#include "ground/model/types.h"

namespace ground {

/// The voltage of a battery over time, as it was measured.
struct VoltageSeries {
  std::vector<double> times;  ///< ascending, on the run's clock [s]
  std::vector<double> volts;  ///< [V]

  bool empty() const { return times.empty(); }
  /// Throws std::invalid_argument if the time descends or the voltage is not positive.
  void add(double time, double voltage);
  /// At a time [s]: linear between measurements, constant before and after them; no value without any
  /// [V].
  std::optional<double> at(double time) const;
  /// Removes what is older than the last measurement before `oldest` [s].
  void dropBefore(double oldest);
};

/// Commands over time, each held until the next; thrusters and lift are off before the first.
struct InputSequence {
  /// For a craft with `count` thrusters.
  explicit InputSequence(int count = 2) : thruster_count(count) {}

  int thruster_count;
  std::vector<double> times;                 ///< ascending, on the run's clock [s]
  std::vector<Thrusters<double>> thrusters;  ///< in the order of the model
  std::vector<double> lift;
  VoltageSeries battery;  ///< acts at once, without the delay of the commands
  DriveClock drive;       ///< has received all commands that were added, also those dropped since

  /// Throws std::invalid_argument if the time descends or the number of thrusters differs.
  void add(double time, const Thrusters<double>& command, double lift_value);
  /// For a craft with a left and a right thruster.
  void add(double time, double left, double right, double lift_value) {
    add(time, {left, right}, lift_value);
  }
  /// Removes the commands that no longer act at `oldest` [s] when they are half of all; returns how many.
  /// Then call forget(count) of each simulation that uses it.
  std::size_t dropBefore(double oldest);
  std::size_t size() const { return times.size(); }
};

/// Steps of equal length under one command.
struct Stretch {
  int steps;
  double h;         ///< [s]
  double by_delay;  ///< derivative of h by the delay of the inputs
  double t;         ///< time since the drive began, at the first step; negative before it [s]
};

constexpr double kDefaultStep = 0.005;    ///< longest step of a simulation [s], thesis 2.3
constexpr double kActuatorMemory = 10.0;  ///< older commands no longer act on effect states [s]
/// Longest settling step of effect states that have rates [s]. Runge-Kutta steps are stable for
/// time constants above 36% of it.
constexpr double kSettlingStep = 0.01;

/// How the states of effects are brought to the start of a simulation (Dynamics::settle).
struct Settling {
  double memory = 0;  ///< commands older than this at the start are ignored [s]
  double step = std::numeric_limits<double>::infinity();  ///< longest step [s]

  bool operator==(const Settling& other) const { return memory == other.memory && step == other.step; }
};

/// A motion that was measured. It only refers to the numbers: they must outlive it.
struct Motion {
  const std::vector<double>* times;  ///< ascending [s]
  const Eigen::MatrixX3d *eta, *nu;  ///< a row for each time; psi unwrapped

  /// The motion at a time [s], linear between measurements, constant before and after them.
  RigidState<double> at(double time) const;
};

/// The steps of a simulation. They end exactly at the requested times and at the changes of the
/// delayed command, so that RK4 keeps its order and derivatives by the delay are exact. The
/// sequence must outlive it and may grow.
class Stepping {
 public:
  /// Begins at time `start` [s] of the sequence's clock. Inputs act `delay` [s] late. `varies`: the
  /// delay is a variable, so there may be stretches of length 0 whose derivative is not 0. Steps
  /// are at most max_step [s] long.
  Stepping(const InputSequence& inputs, double start, double delay, bool varies, double max_step);

  /// Sets the next stretch on the way to `time` [s]; false if `time` is reached. Throws
  /// std::invalid_argument if `time` is before the current time.
  bool next(double time, Stretch& stretch);

  /// Call after InputSequence::dropBefore(). The dropped commands must no longer act.
  void forget(std::size_t count);

  double time() const { return time_; }
  /// Thruster command during the last stretch.
  const Thrusters<double>& thrusters() const { return held_ == 0 ? off_ : inputs_->thrusters[held_ - 1]; }
  double lift() const { return held_ == 0 ? 0.0 : inputs_->lift[held_ - 1]; }
  /// Lift during the last stretch, and the voltage at a time [s].
  Conditions<double> conditionsAt(double time) const { return {lift(), inputs_->battery.at(time)}; }
  /// Whether conditions change while a command is held.
  bool varied() const { return !inputs_->battery.empty(); }
  /// How many commands of the sequence had taken effect by then.
  std::size_t held() const { return held_; }

  /// A command, how long it acts [s], and the derivative of that duration by the delay.
  struct Held {
    std::size_t command;
    double duration, by_delay;
    double time;  ///< the middle of that, on the clock of the sequence [s]
    double t;     ///< when it begins, since the drive began; negative before it [s]
  };
  /// The commands before the start, in order, to which the states of effects settle.
  std::vector<Held> before(const Settling& settling) const;
  /// Current time since the drive began; negative before it [s].
  double t() const { return time_ - inputs_->drive.origin(time_); }

 private:
  bool reach(double time, bool moves, Stretch& stretch);

  const InputSequence* inputs_;
  Thrusters<double> off_;  ///< before the first command
  double time_, delay_, steps_per_second_;
  bool varies_;
  bool moves_ = false;    ///< the current time is a change of the command: it moves with the delay
  std::size_t next_ = 0;  ///< first command that has not taken effect
  std::size_t held_ = 0;  ///< value of next_ during the last stretch
};

}  // namespace ground
