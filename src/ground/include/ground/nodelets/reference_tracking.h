#pragma once

#include <ground_msgs/Drive.h>
#include <ground_msgs/Reference.h>
#include <nav_msgs/Path.h>

#include <algorithm>
#include <memory>
#include <string>
#include <tuple>

#include "ground/control/feasibility.h"
#include "ground/control/tracking_controller.h"
#include "ground/model/drive_clock.h"
#include "ground/model/model_file.h"
#include "ground/nodelets/controller.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/model_service.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/time.h"

namespace ground {

/// Base of the controllers that follow a reference. Config is a dynamic_reconfigure class with the
/// fields of cfg/tracking_parameters.py and the child's own.
///
/// Parameters: model (model file, required) and those of Config, all live; a change of the
/// reference starts it anew. Service: ~load_model (another model file, also while it drives).
/// Subscribes besides: drive (when the drive began, for a model loaded in the middle of it).
/// Publishes besides: reference, path/reference (latched), controls/wanted (the inputs before they
/// are limited, of full scale). A reference that the craft cannot follow is warned of, also in the
/// answer of ~start and in ~status.
template <class Config>
class ReferenceTracking : public Controller {
 protected:
  /// As the base's; to be called first by every child's destructor.
  void shutdown() {
    reconfigure_.reset();
    model_service_ = ModelService();
    Controller::shutdown();
  }
  /// Makes the controller; throws on what it cannot do with the model.
  virtual std::unique_ptr<TrackingController> make(const Model& model, const Config& config) = 0;
  /// What is wrong with the child's own parameters; empty when nothing is.
  virtual std::string check(const Config& config) const = 0;
  /// Takes over the child's own parameters, good ones.
  virtual void tune(const Config& config) = 0;

 private:
  void load(ros::NodeHandle& nh) override {
    model_ = loadModelAndWarn(requiredParameter<std::string>(nh, "model"));
    epoch_ = ros::Time::now();
    ros::NodeHandle topics = this->topics();
    reference_publisher_ = topics.advertise<ground_msgs::Reference>("reference", 4);
    wanted_publisher_ = topics.advertise<ground_msgs::Controls>("controls/wanted", 4);
    path_publisher_ = topics.advertise<nav_msgs::Path>("path/reference", 1, true);
    reconfigure_ = std::make_unique<LiveParameters<Config>>(
        nh, [this](const Config& c) { return wrong(c); }, [this](const Config& c) { apply(c); });
    model_service_ =
        ModelService(nh, "load_model", [this](const Model& m, const std::string&) { take(m); });
    drive_subscriber_ = topics.subscribe("drive", 4, &ReferenceTracking::onDrive, this);
  }

  void onDrive(const ground_msgs::Drive::ConstPtr& message) {
    const std::lock_guard<std::recursive_mutex> lock(mutex());
    drive_.record(seconds(message->began), seconds(message->header.stamp));
  }

  static ReferenceParams reference(const Config& c) {
    ReferenceParams params;
    params.kind = c.reference;
    params.origin = {c.x, c.y};
    params.size = c.size;
    params.rate_of_turn = c.rate_of_turn;
    params.petals = c.petals;
    params.speed = c.speed;
    params.end = {c.end_x, c.end_y};
    params.smooth = c.smooth;
    params.file = c.file;
    return params;
  }

  /// What the reference depends on.
  static auto shape(const Config& c) {
    return std::make_tuple(c.reference, c.x, c.y, c.size, c.rate_of_turn, c.petals, c.speed,
                           c.end_x, c.end_y, c.smooth, c.file);
  }

  std::string wrong(const Config& c) const {
    try {
      makeReference(reference(c));
    } catch (const std::exception& error) {
      return error.what();
    }
    return check(c);
  }

  void apply(const Config& c) {
    const std::lock_guard<std::recursive_mutex> lock(mutex());
    const bool changed = !reference_ || shape(c) != shape(config_);
    config_ = c;
    ControllerParams params;
    params.lift = c.lift;
    params.lift_time = c.lift_time;
    params.state_timeout = c.state_timeout;
    params.recovery_time = c.recovery_time;
    params.rate = c.rate;
    setParams(params);
    if (controller_) {
      tune(c);
    } else {
      controller_ = make(model_, c);
    }
    if (!changed) return;
    reference_ = makeReference(reference(c));
    reference_start_ = ros::Time();
    warn(infeasibility(*reference_, model_.body));
    publishPath();
  }

  /// Goes on with another model, also while it drives.
  void take(const Model& model) {
    const std::lock_guard<std::recursive_mutex> lock(mutex());
    std::string caution = infeasibility(*reference_, model.body);
    controller_ = make(model, config_);
    model_ = model;
    warn(std::move(caution));
  }

  void warn(std::string caution) {
    caution_ = std::move(caution);
    if (!caution_.empty())
      NODELET_WARN("%s: reference %s: %s", getName().c_str(), config_.reference.c_str(),
                   caution_.c_str());
  }

  std::string caution() const override { return caution_; }

  void activate(const ros::Time&) override {
    reference_start_ = ros::Time();
    controller_->reset();
  }

  double seconds(const ros::Time& time) const { return secondsBetween(epoch_, time); }

  Vector2<double> update(double, const ros::Time& stamp, const RigidState<double>& state) override {
    if (reference_start_.isZero()) reference_start_ = stamp;
    if (stamp != published_) publishReference(stamp);
    Observation seen;
    seen.stamp = seconds(stamp);
    seen.now = std::max(seen.stamp, seconds(ros::Time::now()));
    seen.state = state;
    seen.reference = reference_.get();
    seen.reference_start = seconds(reference_start_);
    seen.drive_start = drive_.origin(seen.now);
    seen.lift = config_.lift;
    const Vector2<double> inputs = controller_->decide(seen) / model_.body.input_max;
    publishWanted(controller_->wanted() / model_.body.input_max);
    return inputs;
  }

  void publishWanted(const Vector2<double>& wanted) {
    auto message = boost::make_shared<ground_msgs::Controls>();
    message->header.stamp = ros::Time::now();
    message->header.frame_id = getName();
    message->left = wanted.x();
    message->right = wanted.y();
    message->lift = config_.lift;
    wanted_publisher_.publish(message);
  }

  void published(const ros::Time& stamp, double left, double right, double lift) override {
    drive_.command(seconds(stamp), lift);
    if (controller_)
      controller_->commanded(seconds(stamp), model_.body.input_max * Vector2<double>(left, right),
                             lift);
  }

  bool finished(double elapsed) const override {
    return config_.duration > 0 && elapsed >= config_.duration;
  }

  void publishReference(const ros::Time& stamp) {
    published_ = stamp;
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

  Model model_;
  ros::Time epoch_;  ///< from which the controller's clock counts
  Config config_;    ///< this and what follows are guarded by mutex()
  ReferencePtr reference_;
  std::string caution_;
  ros::Time reference_start_;  ///< zero until the first update with this reference
  DriveClock drive_;           ///< on the controller's clock
  ros::Time published_;        ///< stamp of the newest message of the reference
  std::unique_ptr<TrackingController> controller_;
  ros::Publisher reference_publisher_, path_publisher_, wanted_publisher_;
  ModelService model_service_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
  ros::Subscriber drive_subscriber_;  ///< last: its callback uses what is above
};

}  // namespace ground
