#pragma once

#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "ground/control/input_design.h"
#include "ground/control/predictive_control.h"
#include "ground/control/reference_pilot.h"
#include "ground/control/room_plan.h"

namespace ground {

/// How an excitation is kept inside a room.
struct ReturnParams {
  RoomPlan room;
  double burst = 4.0;    ///< longest burst [s]
  double arrival = 0;    ///< a return ends so near to home [m]; 0: half way from home to a wall
  PredictiveParams predictive;

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// Plays an input signal, whatever the state; between its bursts ModelPredictive drives the craft
/// home.
///
/// While a burst lasts, the way home is planned again and again (kCheck). The burst ends as soon as
/// somewhere on that way a craft whose mocap is lost for Fence::kLoss could no longer be stopped inside
/// (Fence), were all ways longer by kModelError. A return ends near home, moving or not, as soon as
/// there is room for a burst. The next burst goes on with the next row of the signal. All inputs are
/// known, those of the returns as well, so that feedback does not bias an identification by prediction
/// errors (Ljung, System Identification, 2nd ed., 13.4).
class ExcitationPilot : public Pilot {
 public:
  static constexpr double kCheck = 0.05;      ///< between plans of the way home [s]
  static constexpr double kModelError = 0.3;  ///< of ways, a share
  static constexpr double kBurstRoom = 0.1;   ///< to spare on the way home when a burst begins [m]

  /// A burst or a return begins.
  struct Mark {
    double time;        ///< clock of the stamps [s]
    int number;         ///< of the burst, from 1 on; a return has that of the burst before
    bool burst;
    std::string reason;  ///< why
  };
  using Marked = std::function<void(const Mark&)>;

  ExcitationPilot(ReferencePilot::Clock clock, Marked marked, ReferencePilot::Decided decided);
  ExcitationPilot(const ExcitationPilot&) = delete;
  ExcitationPilot& operator=(const ExcitationPilot&) = delete;

  /// What to play from the next activation on, for `duration` [s] or until the signal ends; open
  /// loop.
  void play(InputSignal signal, double duration);
  /// The same in bursts, between which a controller that believes in `model` returns home. Throws
  /// std::invalid_argument when parameters are bad.
  void playInside(InputSignal signal, double duration, const Model& model,
                  const ReturnParams& params);

  void commanded(double time, const Inputs& inputs) override { home_.commanded(time, inputs); }
  /// As DriveClock::record.
  void driveBegan(double began, double as_of) { home_.driveBegan(began, as_of); }

  void activate(double stamp) override;
  std::string objection(const MeasuredState& measured) override;
  Inputs update(double elapsed, double stamp, const RigidState<double>& state,
                double lift) override;
  double end() const override { return std::min(duration_, ended_); }
  double nextChange(double elapsed) const override;

 private:
  double spare() const;
  bool home(const RigidState<double>& state) const;
  void begin(bool burst, const std::string& reason);

  InputSignal signal_;
  double duration_ = 0;
  ReferencePilot::Clock clock_;
  Marked marked_;
  ReferencePilot home_;
  std::optional<ReturnParams> returns_;
  PredictiveControl* control_ = nullptr;  ///< of home_
  bool bursting_ = true, due_ = true;     ///< due_: the first inputs of the burst
  int number_ = 0;
  double activated_ = 0;  ///< clock of the stamps [s]
  double began_ = 0;      ///< the burst, since it was activated [s]
  double played_ = 0;     ///< of the signal before this burst [s]
  double checked_ = 0;    ///< stamp [s]
  double lift_ = 1;       ///< of the last update
  double ended_ = std::numeric_limits<double>::infinity();
};

}  // namespace ground
