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
#include "ground/safety/room.h"

namespace ground {

/// How an excitation is kept inside a room.
struct ReturnParams {
  Room room;
  double burst = 4.0;  ///< longest burst [s]

  std::string validate() const;  ///< error message; empty if all values are valid
};

/// Plays an input signal in open loop. Between its bursts, ModelPredictive drives the craft home.
///
/// During a burst, the way home is planned repeatedly (kCheck). The burst ends before the craft
/// could no longer be stopped inside the room (Fence) at some point of that way, if the mocap were
/// lost for Fence::kLoss and all distances were longer by kModelError. A return ends half way from home to
/// a wall as soon as there is room for a burst; the craft may still move. The next burst continues with the
/// next row of the signal. All inputs are known, including inputs of the returns, so feedback does
/// not bias an identification by prediction errors (Ljung, System Identification, 2nd ed., 13.4).
class ExcitationPilot : public Pilot {
 public:
  static constexpr double kCheck = 0.05;      ///< interval of plans of the way home [s]
  static constexpr double kModelError = 0.3;  ///< relative error of predicted distances
  static constexpr double kBurstRoom = 0.1;   ///< smallest spare distance to begin a burst [m]

  /// The beginning of a burst or a return.
  struct Mark {
    double time;  ///< clock of stamps [s]
    int number;   ///< number of the burst, from 1; a return has the number of the burst before
    bool burst;
    std::string reason;  ///< why it begins
  };
  using Marked = std::function<void(const Mark&)>;

  /// See ReferencePilot.
  ExcitationPilot(ReferencePilot::Clock clock, Marked marked, ReferencePilot::Decided decided,
                  ReferencePilot::Clock steady = nullptr);
  ExcitationPilot(const ExcitationPilot&) = delete;
  ExcitationPilot& operator=(const ExcitationPilot&) = delete;

  /// Sets the signal to play in open loop, for `duration` [s] or until it ends. Takes effect with the
  /// next activation.
  /// `craft`: its model, for the fence; null if it is unknown.
  void play(InputSignal signal, double duration, const Model* craft = nullptr);
  /// Like play(), in bursts; in between, a controller with the internal model `model` returns home.
  /// Throws std::invalid_argument if parameters are bad or the model has other thrusters than the
  /// signal.
  void playInside(InputSignal signal, double duration, const Model& model, const ReturnParams& params);

  const ThrusterLayout& layout() const override { return *signal_.thrusters; }
  Vector2<double> acceleration(double time, const Inputs& inputs) const override {
    return home_.acceleration(time, inputs);
  }
  void commanded(double time, const Inputs& inputs) override { home_.commanded(time, inputs); }
  void voltage(double volts) override { home_.voltage(volts); }
  void driveBegan(double began, double as_of) override { home_.driveBegan(began, as_of); }

  void activate(double stamp) override;
  void deactivate() override { active_ = false; }
  void observe(const MeasuredState& measured) override {
    if (returns_) home_.observe(measured);
  }
  std::string objection(const MeasuredState& measured) override;
  Inputs update(double elapsed, double stamp, const RigidState<double>& state, double lift) override;
  double end() const override { return std::min(duration_, ended_); }
  double nextChange(double elapsed) const override;

 private:
  /// What to play.
  struct Program {
    InputSignal signal;
    double duration = 0;
    std::optional<ReturnParams> returns;
    std::optional<Model> model;  ///< of the craft; set if there are returns
  };
  void setNext(Program program);
  void takeNext();
  double spare() const;
  bool home(const RigidState<double>& state) const;
  void begin(bool burst, const std::string& reason);

  std::optional<Program> next_;  ///< from the next activation on
  bool active_ = false;
  InputSignal signal_;
  double duration_ = 0;
  ReferencePilot::Clock clock_;
  Marked marked_;
  ReferencePilot home_;
  std::optional<ReturnParams> returns_;
  PredictiveControl* control_ = nullptr;  ///< controller of home_
  bool bursting_ = true, due_ = true;     ///< due_: the burst's first inputs are not yet sent
  int number_ = 0;
  double activated_ = 0;  ///< time of activation, clock of stamps [s]
  double began_ = 0;      ///< start of the burst, since activation [s]
  double played_ = 0;     ///< duration of the signal played before this burst [s]
  double checked_ = 0;    ///< stamp of the last check [s]
  double lift_ = 1;       ///< lift of the last update
  double ended_ = std::numeric_limits<double>::infinity();
};

}  // namespace ground
