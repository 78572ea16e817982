#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>

#include "ground/model/craft_change.h"
#include "ground/model/inputs.h"
#include "ground/safety/obedience_monitor.h"

namespace ground {

/// Tests with an ObedienceMonitor whether a craft follows what is sent while the sender is armed. If it
/// adapts, it may be told that a thruster of more than two is dead: from then on the craft has to obey as
/// one without it, until the sender is armed again. It reads no clock; times are on any one [s].
class ObedienceWatch {
 public:
  explicit ObedienceWatch(const Model& model);

  /// timeout: time of disobedience that it reports [s], 0: never.
  void setParams(double timeout, bool adapts);
  /// What is sent now, as shares of the largest input.
  void sent(double time, bool armed, const Inputs& inputs);
  /// Adds a valid state while armed. Returns what the craft does instead of following; empty if it follows.
  std::string measured(double time, const RigidState<double>& state, const Vector3<double>& nu_variance);
  /// The voltage of the battery from now on [V].
  void voltage(double volts);
  /// The craft has changed (CraftChange). Returns the names of the thrusters that are dead, if another one is
  /// than before.
  std::string told(const Eigen::VectorXd& change);

 private:
  void applyPatience() { monitor_->setPatience(adapts_ ? timeout_ : 0); }

  CraftChange craft_;
  double input_max_, nominal_volts_;
  double timeout_ = 0;
  bool adapts_ = false;
  std::unique_ptr<ObedienceMonitor> monitor_;
  std::unique_ptr<ObedienceMonitor> usual_;  ///< of the model, while monitor_ is of a changed craft
  Eigen::VectorXd told_;                     ///< the change of monitor_'s craft
  std::optional<Inputs> sent_;               ///< the last inputs passed to monitor_, while armed
  double began_ = 0;                         ///< when monitor_ began [s]
  std::optional<double> volts_;              ///< of the battery [V]
};

}  // namespace ground
