#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "ground/control/tracking_controller.h"
#include "ground/control/tracking_watch.h"
#include "ground/model/drive_clock.h"
#include "ground/model/thrust_acceleration.h"
#include "ground/safety/controller_lifecycle.h"
#include "ground/safety/room.h"

namespace ground {

/// Follows a reference with a TrackingController. Stops if the craft does not follow it
/// (TrackingWatch). The reference begins with the first state. Settings take effect with the next state.
class ReferencePilot : public Pilot {
 public:
  struct Decision {
    double now, stamp;  ///< time of the decision, and stamp of the state it is based on [s]
    ReferencePoint reference;
    Thrusters<double> inputs;  ///< fractions of the largest input
    Thrusters<double> wanted;  ///< inputs before they were limited
    double computing;          ///< CPU time [s]
  };
  /// Returns the time on the clock of stamps [s].
  using Clock = std::function<double()>;
  using Decided = std::function<void(const Decision&)>;

  /// `steady`: the steady clock [s] of the controllers; see TrackingController::setClock.
  ReferencePilot(Clock clock, Decided decided, Clock steady = nullptr);

  /// Sets the craft whose acceleration() is known.
  void setCraft(const Model& model);
  /// Swaps the controller; `model` is its internal model, and the craft. The new one gets the last commands,
  /// which may not have acted yet.
  void swapController(std::unique_ptr<TrackingController>& controller, const Model& model);
  /// Swaps the reference, which then begins from its start.
  void swapReference(ReferencePtr& reference);
  /// Position error at which it stops if the error lasts [m].
  void setMaxError(double max_error) { watch_.setMaxError(max_error); }
  /// How long it follows the reference [s].
  void setDuration(double duration) { duration_ = duration; }
  TrackingController* controller() const { return controller_.get(); }

  const ThrusterLayout& layout() const override { return *thrusters_; }
  Vector2<double> acceleration(double time, const Inputs& inputs) const override {
    return acceleration_ ? (*acceleration_)(drive_.since(time), inputs) : Vector2<double>(0, 0);
  }
  void commanded(double time, const Inputs& inputs) override;
  void voltage(double volts) override;
  void driveBegan(double began, double as_of) override { drive_.record(began, as_of); }

  void activate(double stamp) override;
  void observe(const MeasuredState& measured) override;
  std::string objection(const MeasuredState& measured) override;
  Inputs update(double elapsed, double stamp, const RigidState<double>& state, double lift) override;
  double end() const override { return duration_; }

 private:
  ReferencePoint at(double stamp) const;
  Observation observation(double stamp, const RigidState<double>& state, double lift) const;

  Clock clock_, steady_;
  Decided decided_;
  std::unique_ptr<TrackingController> controller_;
  static constexpr std::size_t kGiven = 128;
  std::vector<std::pair<double, Inputs>> given_;  ///< the last kGiven commands and their times [s]
  double input_max_ = 1;
  double nominal_volts_ = 0;                        ///< at which k holds [V]; 0: not known
  std::optional<ThrustAcceleration> acceleration_;  ///< no value if the craft is unknown
  std::optional<double> volts_;                     ///< of the battery [V]
  ThrusterLayoutPtr thrusters_ = thrusterPair();
  double duration_ = std::numeric_limits<double>::infinity();
  ReferencePtr reference_;
  std::optional<double> reference_start_;  ///< time of the first state with this reference [s]
  TrackingWatch watch_;
  DriveClock drive_;
  PoseMeasurement pose_;  ///< of the last state
  double lift_ = 1;       ///< of the last command
};

}  // namespace ground
