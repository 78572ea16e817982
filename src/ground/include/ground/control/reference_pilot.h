#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "ground/control/controller_lifecycle.h"
#include "ground/control/tracking_controller.h"
#include "ground/control/tracking_watch.h"
#include "ground/estimation/obedience_monitor.h"
#include "ground/model/drive_clock.h"

namespace ground {

/// Follows a reference by a TrackingController, and stops when the craft does not come along
/// (TrackingWatch) or, when that is asked for, moves otherwise than it is told (ObedienceMonitor).
/// The reference begins with the first state. What is set takes effect with the next state.
class ReferencePilot : public Pilot {
 public:
  struct Decision {
    double now, stamp;        ///< when it was made, and of the state it was made upon [s]
    ReferencePoint reference;
    Vector2<double> inputs;   ///< left, right, 0..1
    Vector2<double> wanted;   ///< the same before they were limited
    double computing;         ///< time of the processor that it took [s]
  };
  static constexpr double kDisobedient = 1.0;  ///< duration of motion that is judged at first [s]
  /// The time [s], on the clock of the states' stamps.
  using Clock = std::function<double()>;
  using Decided = std::function<void(const Decision&)>;

  ReferencePilot(Clock clock, Decided decided);

  /// Exchanges the controller, and the model by which it drives.
  void swapController(std::unique_ptr<TrackingController>& controller, const Model& model);
  /// Exchanges the reference, which begins anew.
  void swapReference(ReferencePtr& reference);
  /// Error that is a reason to stop when it lasts [m].
  void setMaxError(double max_error) { watch_.setMaxError(max_error); }
  /// How long it follows the reference [s].
  void setDuration(double duration) { duration_ = duration; }
  /// Stops when the craft moves otherwise than it is told, which on the floor the sender watches.
  /// Takes effect with the next controller.
  void expectObedience() { expects_obedience_ = true; }
  TrackingController* controller() const { return controller_.get(); }
  const ReferencePtr& reference() const { return reference_; }

  void commanded(double time, const Inputs& inputs) override;
  /// As DriveClock::record.
  void driveBegan(double began, double as_of) { drive_.record(began, as_of); }

  void activate(double stamp) override;
  std::string objection(const MeasuredState& measured) override;
  Inputs update(double elapsed, double stamp, const RigidState<double>& state,
                double lift) override;
  double end() const override { return duration_; }

 private:
  ReferencePoint at(double stamp) const;

  Clock clock_;
  Decided decided_;
  std::unique_ptr<TrackingController> controller_;
  double input_max_ = 1;
  double duration_ = std::numeric_limits<double>::infinity();
  ReferencePtr reference_;
  std::optional<double> reference_start_;  ///< none until the first state with this reference [s]
  TrackingWatch watch_;
  bool expects_obedience_ = false;
  std::optional<ObedienceMonitor> obedience_;
  DriveClock drive_;
};

}  // namespace ground
