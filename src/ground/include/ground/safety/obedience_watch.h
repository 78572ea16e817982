#pragma once

#include <optional>
#include <string>

#include "ground/model/inputs.h"
#include "ground/safety/obedience_monitor.h"

namespace ground {

/// Tests with an ObedienceMonitor whether a craft follows what is sent while the sender is armed. It reads no
/// clock; times are on one that begins near 0 [s].
///
///     ObedienceWatch watch(model);
///     watch.setTimeout(1);
///     watch.sent(now, armed, inputs, drive);  // whenever a packet may have left
///     const std::string instead = watch.measured(stamp, state, nu_variance);  // every valid state
///
/// What is not passed to sent() counts as not sent: the craft then seems to move by itself.
class ObedienceWatch {
 public:
  explicit ObedienceWatch(const Model& model);

  /// Time of disobedience that it reports [s], 0: never.
  void setTimeout(double timeout) { timeout_ = timeout; }
  /// What is sent now, as shares of the largest input, and the drives so far.
  void sent(double time, bool armed, const Inputs& inputs, const DriveClock& drive);
  /// Adds a valid state while armed. Returns what the craft does instead of following; empty if it follows.
  std::string measured(double time, const RigidState<double>& state, const Vector3<double>& nu_variance);
  /// The voltage of the battery from now on [V].
  void voltage(double volts);

 private:
  double input_max_, nominal_volts_;
  double timeout_ = 0;
  ObedienceMonitor monitor_;
  std::optional<Inputs> sent_;  ///< the last inputs passed to monitor_, while armed
};

}  // namespace ground
