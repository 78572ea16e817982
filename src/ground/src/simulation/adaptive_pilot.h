#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "ground/control/controllers.h"
#include "ground/control/reference_pilot.h"
#include "ground/estimation/change_monitor.h"

namespace ground {

/// A ReferencePilot that may have a ChangeMonitor beside it. If it adapts, named changes of the craft are
/// taken into the controller's model, as the nodelets LiveComparison and ModelPredictive do together.
class AdaptivePilot : public ReferencePilot {
 public:
  /// Called with a stamp [s] and the monitor's report when its text changes.
  using Said = std::function<void(double, const ChangeMonitor::Report&)>;
  /// Makes a controller with a model inside.
  using Make = std::function<std::unique_ptr<TrackingController>(const Model&)>;

  AdaptivePilot(Clock clock, Decided decided, Make make, Said said)
      : ReferencePilot(std::move(clock), std::move(decided)),
        make_(std::move(make)),
        said_(std::move(said)) {}

  /// Begins to watch; `adapts`: takes changes, and drives home in the room, if there is one, when a thruster
  /// of more than two is dead.
  void watch(const Model& believed, bool adapts, const std::optional<Room>& room) {
    room_ = room;
    monitor_.emplace(believed, ObserverParams());
    input_max_ = believed.body.input_max;
    adapts_ = adapts;
    taken_ = Eigen::VectorXd::Zero(monitor_->craft().size());
  }

  void commanded(double time, const Inputs& inputs) override {
    ReferencePilot::commanded(time, inputs);
    if (monitor_) monitor_->command(time, input_max_ * asVector(inputs.thrusters), inputs.lift);
  }

  void voltage(double volts) override {
    ReferencePilot::voltage(volts);
    if (monitor_) monitor_->voltage(volts);
  }

  std::string objection(const MeasuredState& measured) override {
    if (monitor_ && monitor_->measure(measured.stamp, measured.state)) look(measured.stamp);
    return ReferencePilot::objection(measured);
  }

 private:
  void look(double stamp) {
    const std::string text = monitor_->report().text();
    if (text != text_) said_(stamp, monitor_->report());
    text_ = text;
    const Eigen::VectorXd& change = monitor_->report().change;
    if (!adapts_ || !monitor_->craft().differ(taken_, change)) return;
    taken_ = change;
    const Model model = monitor_->craft().apply(change);
    std::unique_ptr<TrackingController> controller = make_(model);
    const std::string dead = monitor_->craft().deadNames(change);
    swapController(controller, model);
    if (room_ && dead != dead_ && !dead.empty()) goHome(*room_, dead + " is dead");
    dead_ = dead;
  }

  std::optional<ChangeMonitor> monitor_;
  double input_max_ = 1;
  bool adapts_ = false;
  Make make_;
  Said said_;
  Eigen::VectorXd taken_;  ///< change in the controller's model
  std::string text_;
  std::optional<Room> room_;
  std::string dead_;  ///< names of the dead thrusters
};

}  // namespace ground
