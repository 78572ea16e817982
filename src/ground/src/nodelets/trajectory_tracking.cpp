#include <ground/TrajectoryTrackingConfig.h>
#include <ground_msgs/Reference.h>
#include <nav_msgs/Path.h>

#include <memory>
#include <pluginlib/class_list_macros.hpp>

#include "ground/control/tracking_law.h"
#include "ground/model/model_file.h"
#include "ground/nodelets/controller.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/time.h"

namespace ground {

/// Tracks a reference position by backstepping (thesis 4.2).
///
/// Parameters: model (model file, required) and those of TrajectoryTracking.cfg, all live; a change
/// of the reference starts it anew. Publishes besides: reference, path/reference (latched).
class TrajectoryTracking : public Controller {
 public:
  ~TrajectoryTracking() override { shutdown(); }

 private:
  using Config = TrajectoryTrackingConfig;

  void load(ros::NodeHandle& nh) override {
    const Model model = loadModel(requiredParameter<std::string>(nh, "model"));
    law_ = std::make_unique<TrackingLaw>(model.body);
    ros::NodeHandle& topics = getMTNodeHandle();
    reference_publisher_ = topics.advertise<ground_msgs::Reference>("reference", 4);
    path_publisher_ = topics.advertise<nav_msgs::Path>("path/reference", 1, true);
    reconfigure_ = std::make_unique<LiveParameters<Config>>(
        nh, [](const Config& c) { return wrong(c); }, [this](const Config& c) { apply(c); });
  }

  static TrackingGains gains(const Config& c) {
    return {c.k_e, c.k_z, c.k_phi_1, c.k_phi_2, c.delta_1, c.delta_2};
  }

  static ReferenceParams reference(const Config& c) {
    return {c.reference, {c.x, c.y},         c.size,  c.rate_of_turn, c.petals,
            c.speed,     {c.end_x, c.end_y}, c.smooth};
  }

  static std::string wrong(const Config& c) {
    try {
      makeReference(reference(c));
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return gains(c).validate();
  }

  /// What the reference depends on.
  static auto shape(const Config& c) {
    return std::make_tuple(c.reference, c.x, c.y, c.size, c.rate_of_turn, c.petals, c.speed,
                           c.end_x, c.end_y, c.smooth);
  }

  void apply(const Config& c) {
    const std::lock_guard<std::recursive_mutex> lock(mutex());
    const bool changed = !reference_ || shape(c) != shape(config_);
    config_ = c;
    setParams({c.lift, c.lift_time, c.state_timeout, c.rate});
    if (!changed) return;
    reference_ = makeReference(reference(c));
    reference_start_ = ros::Time();
    publishPath();
  }

  void activate(const ros::Time&) override { reference_start_ = ros::Time(); }

  Vector2<double> update(double, const ros::Time& stamp, const RigidState<double>& state) override {
    if (reference_start_.isZero()) reference_start_ = stamp;
    const double t = std::max(0.0, secondsBetween(reference_start_, stamp));
    const ReferencePoint point = reference_->at(t);
    auto message = boost::make_shared<ground_msgs::Reference>();
    message->header.stamp = stamp;
    message->header.frame_id = "world_ned";
    for (int i = 0; i < 2; ++i) {
      message->p[i] = point.p(i);
      message->p_dot[i] = point.p_dot(i);
      message->p_ddot[i] = point.p_ddot(i);
      message->p_dddot[i] = point.p_dddot(i);
    }
    reference_publisher_.publish(message);
    return law_->run(state, point, gains(config_)).inputs / law_->inputMax();
  }

  bool finished(double elapsed) const override {
    return config_.duration > 0 && elapsed >= config_.duration;
  }

  void publishPath() {
    constexpr int kPoints = 400;
    auto path = boost::make_shared<nav_msgs::Path>();
    path->header.stamp = ros::Time::now();
    path->header.frame_id = "world_ned";
    for (int i = 0; i <= kPoints; ++i) {
      geometry_msgs::PoseStamped pose;
      pose.header = path->header;
      const Vector2<double> p = reference_->at(reference_->extent() * i / kPoints).p;
      pose.pose.position.x = p.x();
      pose.pose.position.y = p.y();
      pose.pose.orientation.w = 1;
      path->poses.push_back(pose);
    }
    path_publisher_.publish(path);
  }

  Config config_;  ///< this and what follows are guarded by mutex()
  ReferencePtr reference_;
  ros::Time reference_start_;  ///< zero until the first update with this reference
  std::unique_ptr<TrackingLaw> law_;
  ros::Publisher reference_publisher_, path_publisher_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::TrajectoryTracking, nodelet::Nodelet)
