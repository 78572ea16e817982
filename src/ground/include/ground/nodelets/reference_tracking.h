#pragma once

#include <ground/ModelPredictiveConfig.h>
#include <ground/TrajectoryTrackingConfig.h>
#include <ground_msgs/Drive.h>
#include <ground_msgs/Reference.h>
#include <nav_msgs/Path.h>

#include <limits>
#include <memory>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>

#include "ground/control/controllers.h"
#include "ground/control/feasibility.h"
#include "ground/control/reference_pilot.h"
#include "ground/model/model_file.h"
#include "ground/nodelets/controller.h"
#include "ground/nodelets/decision_publisher.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/model_service.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/time.h"

namespace ground {

/// Base of the controllers that follow a reference. Config is a dynamic_reconfigure class with the
/// fields of cfg/tracking_parameters.py and the child's own.
///
/// Parameters: model (model file, required) and those of Config, all live; a change of the
/// reference starts it anew. What takes long, a reference from a large file above all, is built
/// aside and swapped in: the controller drives on by the old one until then. It stops when the craft
/// does not follow the reference (TrackingWatch, max_error). Service: ~load_model (another model
/// file, also while it drives).
/// Subscribes besides: drive (when the drive began, for a model loaded in the middle of it).
/// Publishes besides: reference, path/reference (latched), and each decision (DecisionPublisher).
/// Which effects of the model the controller uses, and that the craft
/// cannot follow the reference, is said in the log, in ~status and in the answers of ~start and
/// ~load_model. Refused are a reference that does not fit into the room, a model that the controller
/// must not drive by (effectUse), and parameters that only another kind of controller has.
template <class Config>
class ReferenceTracking : public Controller {
 protected:
  /// As the base's; to be called first by every child's destructor.
  void shutdown() {
    reconfigure_.reset();
    model_service_ = ModelService();
    drive_subscriber_.shutdown();
    Controller::shutdown();
  }
  /// Its kind, one of controllerNames().
  virtual const char* kind() const = 0;
  /// Makes the controller; throws on what it cannot do with the model.
  virtual std::unique_ptr<TrackingController> make(const Model& model, const Config& config) = 0;
  /// What is wrong with the child's own parameters; empty when nothing is.
  virtual std::string check(const Config& config) const = 0;
  /// Hands the child's own parameters, good ones, to a controller that make() made.
  virtual void tune(TrackingController& controller, const Config& config) = 0;

 private:
  void load(ros::NodeHandle& nh) override {
    refuseForeign(nh);
    const std::string file = requiredParameter<std::string>(nh, "model");
    model_ = loadModelAndWarn(file);
    const std::string refusal = effectUse(kind(), model_).refusal;
    if (!refusal.empty()) throw std::runtime_error(file + ": " + refusal);
    ros::NodeHandle topics = this->topics();
    reference_publisher_ = topics.advertise<ground_msgs::Reference>("reference", 4);
    decision_publisher_.advertise(topics);
    path_publisher_ = topics.advertise<nav_msgs::Path>("path/reference", 1, true);
    reconfigure_ = std::make_unique<LiveParameters<Config>>(
        nh, [this](const Config& c) { return wrong(c); }, [this](const Config& c) { apply(c); });
    model_service_ =
        ModelService(nh, "load_model", [this](const Model& m, const std::string&) { return take(m); });
    drive_subscriber_ = topics.subscribe("drive", 4, &ReferenceTracking::onDrive, this);
  }

  void onDrive(const ground_msgs::Drive::ConstPtr& message) {
    const std::lock_guard<std::recursive_mutex> lock(mutex());
    pilot_.driveBegan(seconds(message->began), seconds(message->header.stamp));
  }

  template <class AnyConfig>
  static std::set<std::string> names() {
    std::set<std::string> found;
    for (const auto& parameter : AnyConfig::__getParamDescriptions__())
      found.insert(parameter->name);
    return found;
  }

  /// The gains of another kind of controller would have no effect.
  void refuseForeign(const ros::NodeHandle& nh) const {
    const std::set<std::string> own = names<Config>();
    for (const auto& other : {names<TrajectoryTrackingConfig>(), names<ModelPredictiveConfig>()})
      for (const std::string& name : other)
        if (own.count(name) == 0 && nh.hasParam(name))
          throw std::runtime_error(
              "parameter " + nh.resolveName(name) + " is not one of " + kind() +
              ": it comes from the file of gains of another controller, or from an earlier run "
              "(rosparam delete " + nh.getNamespace() + ")");
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

  std::unique_ptr<TrackingController> made(const Model& model, const Config& config) {
    std::unique_ptr<TrackingController> controller = make(model, config);
    if (room()) controller->avoid({Fence(*room(), room()->margin), Fence::kLoss});
    return controller;
  }

  /// LiveParameters asks this, and then calls apply() if nothing is wrong, one change at a time.
  std::string wrong(const Config& c) {
    built_.reset();
    std::string reason = check(c);
    if (!reason.empty() || (pilot_.reference() && shape(c) == shape(config_))) return reason;
    try {
      if (!pilot_.controller()) first_ = made(model_, c);
      built_ = makeReference(reference(c));
      const std::string leaves = room() ? leavesRoom(*built_, *room()) : "";
      if (!leaves.empty()) reason = "reference " + c.reference + ": " + leaves;
    } catch (const std::exception& error) {
      reason = error.what();
    }
    return reason;
  }

  void apply(const Config& c) {
    const std::lock_guard<std::mutex> one(changing_);
    const bool changed = built_ != nullptr;
    ReferencePtr reference = changed ? std::move(built_) : pilot_.reference();
    built_.reset();
    std::string caution = caution_;
    if (changed) caution = judge(model_, *reference, c.reference);
    const nav_msgs::PathConstPtr path = drawn(*reference);
    const double max_error = c.max_error > 0 ? c.max_error : defaultMaxError(*reference);
    {
      const std::lock_guard<std::recursive_mutex> lock(mutex());
      config_ = c;
      LifecycleParams params;
      params.lift = c.lift;
      params.lift_time = c.lift_time;
      params.state_timeout = c.state_timeout;
      params.recovery_time = c.recovery_time;
      params.rate = c.rate;
      setParams(params);
      if (first_) {
        pilot_.swapController(first_, model_);
      } else {
        tune(*pilot_.controller(), c);
      }
      pilot_.setMaxError(max_error);
      pilot_.setDuration(c.duration > 0 ? c.duration : std::numeric_limits<double>::infinity());
      caution_ = std::move(caution);
      if (changed) {
        pilot_.swapReference(reference);
        path_publisher_.publish(path);
      }
    }
  }

  /// Goes on with another model, also while it drives; gives what whoever loads it should know.
  std::string take(const Model& model) {
    const std::lock_guard<std::mutex> one(changing_);
    std::unique_ptr<TrackingController> controller = made(model, config_);
    const std::string caution = judge(model, *pilot_.reference(), config_.reference);
    const std::lock_guard<std::recursive_mutex> lock(mutex());
    pilot_.swapController(controller, model);
    model_ = model;
    caution_ = caution;
    return caution;
  }

  /// What there is to say of a model and a reference, which is logged as well.
  std::string judge(const Model& model, const ReferenceTrajectory& reference,
                    const std::string& name) const {
    const EffectUse use = effectUse(kind(), model);
    std::string said = use.remark();
    const std::string who = getName();
    if (!use.unused.empty()) {
      NODELET_WARN("%s: model %s: %s", who.c_str(), model.name.c_str(), said.c_str());
    } else if (!said.empty()) {
      NODELET_INFO("%s: model %s: %s", who.c_str(), model.name.c_str(), said.c_str());
    }
    const std::string beyond = infeasibility(reference, model.body);
    if (beyond.empty()) return said;
    NODELET_WARN("%s: reference %s: %s", who.c_str(), name.c_str(), beyond.c_str());
    return said + (said.empty() ? "" : "; ") + beyond;
  }

  std::string caution() const override { return caution_; }

  void activate(double stamp) override { pilot_.activate(stamp); }
  std::string objection(const MeasuredState& measured) override {
    return pilot_.objection(measured);
  }
  Inputs update(double elapsed, double stamp, const RigidState<double>& state,
                double lift) override {
    return pilot_.update(elapsed, stamp, state, lift);
  }
  double end() const override { return pilot_.end(); }

  void decided(const ReferencePilot::Decision& decision) {
    if (measuredAt() != published_) publishReference(decision.reference);
    decision_publisher_.publish(decision, measuredAt(), getName(), config_.lift);
  }

  void commanded(double time, const Inputs& inputs) override { pilot_.commanded(time, inputs); }

  void publishReference(const ReferencePoint& point) {
    published_ = measuredAt();
    auto message = boost::make_shared<ground_msgs::Reference>();
    message->header.stamp = published_;
    message->header.frame_id = "world_ned";
    for (int i = 0; i < 2; ++i) {
      message->p[i] = point.p(i);
      message->p_dot[i] = point.p_dot(i);
      message->p_ddot[i] = point.p_ddot(i);
      message->p_dddot[i] = point.p_dddot(i);
    }
    reference_publisher_.publish(message);
  }

  static nav_msgs::PathConstPtr drawn(const ReferenceTrajectory& reference) {
    constexpr int kPoints = 400;
    auto path = boost::make_shared<nav_msgs::Path>();
    path->header.stamp = ros::Time::now();
    path->header.frame_id = "world_ned";
    for (int i = 0; i <= kPoints; ++i) {
      geometry_msgs::PoseStamped pose;
      pose.header = path->header;
      const Vector2<double> p = reference.at(reference.extent() * i / kPoints).p;
      pose.pose.position.x = p.x();
      pose.pose.position.y = p.y();
      pose.pose.orientation.w = 1;
      path->poses.push_back(pose);
    }
    return path;
  }

  ReferencePtr built_;  ///< by wrong() for apply(), as the first controller is
  std::unique_ptr<TrackingController> first_;
  /// Held while something is built and swapped in: who holds it may read the following four without
  /// mutex(), and changes them with both.
  std::mutex changing_;
  Model model_;
  Config config_;
  std::string caution_;
  ReferencePilot pilot_{[this] { return seconds(ros::Time::now()); },
                        [this](const ReferencePilot::Decision& d) { decided(d); }};
  ros::Time published_;  ///< stamp of the newest message of the reference; guarded by mutex()
  ros::Publisher reference_publisher_, path_publisher_;
  DecisionPublisher decision_publisher_;
  ModelService model_service_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
  ros::Subscriber drive_subscriber_;
};

}  // namespace ground
