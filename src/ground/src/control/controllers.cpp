#include "ground/control/controllers.h"

#include <stdexcept>

#include "ground/control/input_design.h"

namespace ground {
namespace {

/// Its levels are those of a left and a right thruster.
EffectUse openLoopUse(const Model& model) {
  EffectUse use;
  if (!model.thrusters->isPair())
    use.refusal = "OpenLoopPRBS has levels for a left and a right thruster, and " + model.name +
                  " lists others (" + model.thrusters->names() + "): use an excitation of design prbs";
  return use;
}

/// Plays a binary sequence in open loop, for comparison with tracking.
class OpenLoop : public TrackingController {
 public:
  OpenLoop(const Model& model, const ControllerChoice& choice) : input_max_(model.body.input_max) {
    const std::string refusal = openLoopUse(model).refusal;
    if (!refusal.empty()) throw std::invalid_argument(refusal);
    setParams(choice);
  }
  void setParams(const ControllerChoice& choice) {
    signal_ = playBits({makePrbs(choice.prbs_order, choice.prbs_seed), 1}, choice.prbs);
  }
  bool follows() const override { return false; }
  Thrusters<double> decide(const Observation& seen) override {
    wanted_ = signal_.at(seen.now - seen.reference_start).thrusters;
    return wanted_ *= input_max_;
  }
  Thrusters<double> wanted() const override { return wanted_; }

 private:
  double input_max_;
  InputSignal signal_;
  Thrusters<double> wanted_{0.0, 0.0};
};

ControllerInfo openLoop() {
  using C = ControllerChoice;
  Tunables<C> parameters = lifted(&C::prbs, PrbsParams::table());
  parameters.push_back({{"order", "-", "Order of the sequence of 2^order - 1 bits", 2, 20}, &C::prbs_order});
  parameters.push_back({{"seed", "-", "Start of the sequence in its period", 0, 1e6}, &C::prbs_seed});
  return {"OpenLoopPRBS",
          "Plays a binary sequence in open loop",
          false,
          parameters,
          [parameters](const C& choice) {
            const std::string wrong = rangeError(parameters, choice);
            return wrong.empty() ? choice.prbs.validate() : wrong;
          },
          &openLoopUse,
          [](const Model& model, const C& choice) { return std::make_unique<OpenLoop>(model, choice); },
          [](TrackingController& controller, const C& choice) {
            static_cast<OpenLoop&>(controller).setParams(choice);
          }};
}

/// Description of a Control that follows a reference, with its Params in ControllerChoice.
template <class Control, class Params>
ControllerInfo following(const std::string& name, const std::string& text, Params ControllerChoice::*params) {
  using C = ControllerChoice;
  return {name,
          text,
          true,
          lifted(params, Params::table()),
          [params](const C& choice) { return (choice.*params).validate(); },
          &Control::effectUse,
          [params](const Model& model, const C& choice) {
            return std::make_unique<Control>(model, choice.*params);
          },
          [params](TrackingController& controller, const C& choice) {
            static_cast<Control&>(controller).setParams(choice.*params);
          }};
}

}  // namespace

const std::vector<ControllerInfo>& controllerTable() {
  static const std::vector<ControllerInfo> table = {
      openLoop(),
      following<BacksteppingControl>("TrajectoryTracking", "Backstepping on the rigid body (thesis 4.2)",
                                     &ControllerChoice::gains),
      following<PredictiveControl>("ModelPredictive",
                                   "Model predictive control on the whole model, effects included",
                                   &ControllerChoice::predictive),
  };
  return table;
}

const ControllerInfo& controllerInfo(const std::string& kind) {
  const ControllerInfo* const info = findNamed(controllerTable(), kind);
  if (!info)
    throw std::invalid_argument("the controller must be one of " + namesOf(controllerTable()) + ", not '" +
                                kind + "'");
  return *info;
}

std::string ControllerChoice::validate() const {
  try {
    return controllerInfo(kind).validate(*this);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
}

EffectUse effectUse(const std::string& kind, const Model& model) {
  return controllerInfo(kind).effectUse(model);
}

std::unique_ptr<TrackingController> makeController(const Model& model, const ControllerChoice& params) {
  const std::string wrong = params.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  return controllerInfo(params.kind).make(model, params);
}

}  // namespace ground
