#pragma once

#include <ground_msgs/Reference.h>
#include <nav_msgs/Path.h>

#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "ground/control/controllers.h"
#include "ground/control/feasibility.h"
#include "ground/control/reference_pilot.h"
#include "ground/model/model_file.h"
#include "ground/nodelets/controller.h"
#include "ground/nodelets/controls.h"
#include "ground/nodelets/messages.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/model_service.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/time.h"

namespace ground {

/// Base of the controllers that follow a reference. Config is a dynamic_reconfigure class with the
/// fields of cfg/tracking_parameters.py and the parameters of this kind in controllerTable().
///
/// Parameters: model (model file, required) and the parameters of Config, which can be changed at run time.
/// A parameter that is not given is taken from the node `controller` beside it, if that follows a
/// reference, so that a controller which is loaded later takes over its reference.
/// A change of the reference restarts it. New controllers and references, which may take long to
/// build from a large file, are built first and then swapped in; until then the controller uses the
/// old ones. It stops if the craft does not follow the reference (TrackingWatch, max_error).
///
/// Service: ~load_model (loads another model file, also while it drives). Also publishes: reference and
/// path/reference (latched).
///
/// The log, ~status and the answers of ~start and ~load_model say which effects of the model the
/// controller uses, and whether the craft cannot follow the reference. Refuses a reference that
/// does not fit into the room, a model that the controller must not drive by (effectUse), and
/// parameters of another kind of controller.
template <class Config>
class ReferenceTracking : public Controller {
 protected:
  /// kind: a name in controllerTable().
  explicit ReferenceTracking(const std::string& kind)
      : Controller(std::make_unique<ReferencePilot>([this] { return seconds(ros::Time::now()); },
                                                    [this](const ReferencePilot::Decision& d) { decided(d); },
                                                    steadyNow)),
        kind_(controllerInfo(kind)),
        pilot_(static_cast<ReferencePilot&>(pilot())) {}
  /// See Controller::shutdown. Every child's destructor must call it first.
  void shutdown() {
    model_service_ = ModelService();
    reconfigure_.reset();
    Controller::shutdown();
  }

 private:
  void load(ros::NodeHandle& nh) override {
    refuseForeign(nh);
    adopt(nh);
    const std::string file = requiredParameter<std::string>(nh, "model");
    model_ = loadModelAndWarn(file);
    const std::string refusal = kind_.effectUse(model_).refusal;
    if (!refusal.empty()) throw std::runtime_error(file + ": " + refusal);
    reference_publisher_ = topics().advertise<ground_msgs::Reference>("reference", 4);
    path_publisher_ = topics().advertise<nav_msgs::Path>("path/reference", 1, true);
    reconfigure_ = std::make_unique<LiveParameters<Config>>(nh, [this](const Config& c) { apply(c); });
    model_service_ = ModelService(reconfigure_->thread(), nh, "load_model",
                                  [this](const Model& m, const std::string&) { return replaceModel(m); });
  }

  /// Replaces the model, also while it drives; returns a warning for the user.
  std::string replaceModel(const Model& model) {
    requireSameThrusters(*model_.thrusters, *model.thrusters);
    std::unique_ptr<TrackingController> controller = made(model, config_);
    const std::string caution = judge(model, *followed_, config_.reference);
    const std::lock_guard lock(mutex());
    pilot_.swapController(controller, model);
    model_ = model;
    pilot_.setCaution(caution);
    return caution;
  }

  /// Refuses parameters of another kind of controller, which would have no effect.
  void refuseForeign(const ros::NodeHandle& nh) const {
    for (const ControllerInfo& other : controllerTable())
      for (const TunableInfo& parameter : other.parameters)
        if (!findNamed(fieldsOf<Config>(), parameter.name) && nh.hasParam(parameter.name))
          throw std::runtime_error(
              "parameter " + nh.resolveName(parameter.name) + " is not one of " + kind_.name +
              ": it comes from the file of gains of another controller, or from an earlier run "
              "(rosparam delete " +
              nh.getNamespace() + ")");
  }

  /// Takes parameters that are not given from the node `controller`.
  void adopt(ros::NodeHandle& nh) {
    const ros::NodeHandle station(getNodeHandle(), "controller");
    if (station.getNamespace() == nh.getNamespace() || !station.hasParam("reference")) return;
    for (const TunableInfo& field : fieldsOf<Config>()) {
      XmlRpc::XmlRpcValue value;
      if (!nh.hasParam(field.name) && station.getParam(field.name, value)) nh.setParam(field.name, value);
    }
  }

  ControllerChoice choice(const Config& c) const {
    ControllerChoice made;
    made.kind = kind_.name;
    setFields(made, kind_.parameters, c);
    return made;
  }

  std::unique_ptr<TrackingController> made(const Model& model, const Config& config) {
    std::unique_ptr<TrackingController> controller = makeController(model, choice(config));
    if (room()) controller->avoid({Fence(*room(), room()->margin), Fence::kLoss});
    return controller;
  }

  /// Builds what a change needs, and then swaps it in. Throws if it cannot be built.
  void apply(const Config& c) {
    auto params = paramsIn<ReferenceParams>(c);
    params.kind = c.reference;
    const bool changed = !followed_ || !(params == reference_);
    ReferencePtr reference = changed ? makeReference(params) : followed_;
    const std::string leaves = changed && room() ? leavesRoom(params, *reference, *room()) : "";
    if (!leaves.empty()) throw std::invalid_argument("reference " + c.reference + ": " + leaves);
    std::unique_ptr<TrackingController> first = pilot_.controller() ? nullptr : made(model_, c);
    const std::string caution = changed ? judge(model_, *reference, c.reference) : pilot_.caution();
    const nav_msgs::PathConstPtr path = drawn(*reference);
    const double max_error = c.max_error > 0 ? c.max_error : defaultMaxError(*reference);
    {
      const std::lock_guard lock(mutex());
      config_ = c;
      reference_ = params;
      setParams(paramsIn<LifecycleParams>(c));
      if (first) {
        pilot_.swapController(first, model_);
      } else {
        kind_.tune(*pilot_.controller(), choice(c));
      }
      pilot_.setMaxError(max_error);
      pilot_.setDuration(c.duration > 0 ? c.duration : std::numeric_limits<double>::infinity());
      pilot_.setCaution(caution);
      followed_ = reference;
      if (changed) pilot_.swapReference(reference);
    }
    if (changed) path_publisher_.publish(path);
  }

  /// Logs and returns remarks and warnings about a model and a reference.
  std::string judge(const Model& model, const ReferenceTrajectory& reference, const std::string& name) const {
    const EffectUse use = kind_.effectUse(model);
    std::string remark = use.remark();
    const std::string node = getName();
    if (!use.unused.empty()) {
      NODELET_WARN("%s: model %s: %s", node.c_str(), model.name.c_str(), remark.c_str());
    } else if (!remark.empty()) {
      NODELET_INFO("%s: model %s: %s", node.c_str(), model.name.c_str(), remark.c_str());
    }
    const std::string problem = infeasibility(reference, model);
    if (problem.empty()) return remark;
    NODELET_WARN("%s: reference %s: %s", node.c_str(), name.c_str(), problem.c_str());
    return remark + (remark.empty() ? "" : "; ") + problem;
  }

  void decided(const ReferencePilot::Decision& decision) {
    point_ = decision.reference;
    note(decision);
  }

  void sent() override {
    if (point_ && measuredAt() != published_) publishReference(*point_);
    point_.reset();
  }

  void publishReference(const ReferencePoint& point) {
    published_ = measuredAt();
    auto message = inWorld<ground_msgs::Reference>(published_);
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
    auto path = inWorld<nav_msgs::Path>(ros::Time::now());
    for (int i = 0; i <= kPoints; ++i) {
      const Vector2<double> p = reference.at(reference.extent() * i / kPoints).p;
      addPose(*path, path->header.stamp, poseOf(p.x(), p.y(), 0, 0));
    }
    return path;
  }

  const ControllerInfo& kind_;
  // Changes need mutex(), and are made in the thread of reconfigure_, which may read without it.
  Model model_;
  Config config_;
  ReferenceParams reference_;
  ReferencePtr followed_;  ///< made from reference_; read only by the thread of changes
  ReferencePilot& pilot_;
  std::optional<ReferencePoint> point_;  ///< of a decision that is not published yet
  ros::Time published_;                  ///< stamp of the newest message of the reference; guarded by mutex()
  ros::Publisher reference_publisher_, path_publisher_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
  ModelService model_service_;
};

}  // namespace ground
