#pragma once

#include <algorithm>

#include "ground/control/allocation.h"
#include "ground/control/effect_use.h"
#include "ground/control/tracking_controller.h"
#include "ground/model/dynamics.h"
#include "ground/parameters/TrackingGains.h"

namespace ground {

/// Position tracking of an underactuated hovercraft by backstepping (Aguiar, Cremean, Hespanha
/// 2003; thesis 4.2 with the derivatives of alpha corrected). It takes the measured state as the current
/// state of the craft's centre, uses the same damping d_v = Y_v for surge and sway, and no effects of the
/// model.
class BacksteppingControl : public TrackingController {
 public:
  /// It takes thrusters that give a forward force, and moments to both sides.
  static EffectUse effectUse(const Model& model);

  /// Throws std::invalid_argument if gains are bad or it must not drive by this model (effectUse).
  BacksteppingControl(const Model& model, const TrackingGains& gains);
  void setParams(const TrackingGains& gains) { gains_ = gains; }

  struct Output {
    Vector2<double> error;      ///< position error e in the body frame [m]
    Vector2<double> alpha;      ///< wanted force [N] and yaw rate [rad/s]
    Vector2<double> alpha_dot;  ///< time derivative of alpha
    double force = 0.0;         ///< u_1 [N]
    double torque = 0.0;        ///< u_2 [N m]
    Thrusters<double> wanted;   ///< inputs before they are limited, (4.8): see Allocation
    Thrusters<double> inputs;   ///< inputs within the ranges of the thrusters
  };
  Output run(const RigidState<double>& state, const ReferencePoint& reference) const;

  Thrusters<double> decide(const Observation& seen) override {
    const double t = std::max(0.0, seen.stamp - seen.reference_start);
    const Output out = run(seen.state, seen.reference->at(t));
    wanted_ = out.wanted;
    return out.inputs;
  }
  Thrusters<double> wanted() const override { return wanted_; }

 private:
  Body<double> body_;
  Allocation allocation_;
  double least_force_, most_force_;  ///< what all thrusters together can push forward [N]
  TrackingGains gains_;
  Thrusters<double> wanted_;
};

}  // namespace ground
