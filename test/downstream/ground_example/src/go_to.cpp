#include <algorithm>
#include <cmath>
#include <limits>
#include <pluginlib/class_list_macros.hpp>

#include "ground/nodelets/controller.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/parameters.h"

namespace ground_example {

/// Drives to a point and stops there: a spring and a damper between craft and point give a force;
/// the craft turns into its direction and uses it as thrust.
///
/// Parameters: model (file, required), x, y (the point, world_ned, required) [m], tolerance (0.1)
/// [m], and those of every controller (ground::Controller).
class GoToPilot : public ground::Pilot {
 public:
  static constexpr double kApproach = 0.7;  ///< natural frequency of spring and damper [rad/s]
  static constexpr double kTurn = 3.0;      ///< natural frequency of the turn [rad/s]
  static constexpr double kSlow = 0.1;      ///< the craft counts as stopped below this speed [m/s]
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  ground::LifecycleParams load(ros::NodeHandle& nh) {
    body_ = ground::loadModelAndWarn(ground::requiredParameter<std::string>(nh, "model")).body;
    point_ = {ground::requiredParameter<double>(nh, "x"), ground::requiredParameter<double>(nh, "y")};
    tolerance_ = ground::optionalParameter<double>(nh, "tolerance", 0.1);
    if (!(tolerance_ > 0)) throw std::runtime_error("parameter tolerance must be above 0 m");
    ground::LifecycleParams params;
    params.recovery_time = 0.5;  // a short loss of the mocap: no thrust, then it continues
    return params;
  }

  void activate(double) override { end_ = kNever; }
  double end() const override { return end_; }

  ground::Inputs update(double elapsed, double, const ground::RigidState<double>& state,
                        double lift) override {
    using ground::Vector2;
    const double psi = state.eta.z(), r = state.nu.z();
    const Vector2<double> way = point_ - state.eta.head<2>();
    const Vector2<double> velocity = ground::bodyToWorld<double>(psi, state.nu.head<2>().eval());
    if (way.norm() < tolerance_ && velocity.norm() < kSlow) {
      end_ = elapsed;
      return {0, 0, lift};
    }
    const Vector2<double> force = body_.m * (kApproach * kApproach * way - 2 * kApproach * velocity);
    const double turn = std::remainder(std::atan2(force.y(), force.x()) - psi, 2 * M_PI);
    const double moment = body_.I_z * (kTurn * kTurn * turn - 2 * kTurn * r);
    const double sum = std::min(force.norm(), body_.k) * std::max(std::cos(turn), 0.0) / body_.k;
    const double difference = moment / (body_.k * body_.l);
    return {std::clamp((sum + difference) / 2, 0.0, 1.0), std::clamp((sum - difference) / 2, 0.0, 1.0), lift};
  }

 private:
  ground::Body<double> body_;
  ground::Vector2<double> point_;  ///< world_ned [m]
  double tolerance_ = 0;           ///< [m]
  double end_ = kNever;            ///< time at the point, since the start [s]
};

class GoTo : public ground::ControllerOf<GoToPilot> {};

}  // namespace ground_example

PLUGINLIB_EXPORT_CLASS(ground_example::GoTo, nodelet::Nodelet)
