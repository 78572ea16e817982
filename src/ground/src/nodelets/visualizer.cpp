#include <ground/VisualizerConfig.h>
#include <ground_msgs/Controls.h>
#include <ground_msgs/State.h>
#include <nav_msgs/Path.h>
#include <nodelet/nodelet.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <deque>
#include <mutex>
#include <pluginlib/class_list_macros.hpp>

#include "ground/model/model_file.h"
#include "ground/model/simulation.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/time.h"

namespace ground {

/// Paths, craft and thrust arrows for rviz.
///
/// Parameters: model (model file, required) and those of Visualizer.cfg, live. Subscribes: state,
/// controls. Publishes: path/measured; path/predicted, the model run over the last `horizon`
/// seconds from the state measured then, with the commands since; markers.
class Visualizer : public nodelet::Nodelet {
 private:
  using Config = VisualizerConfig;

  void onInit() override {
    try {
      ros::NodeHandle& nh = getPrivateNodeHandle();
      ros::NodeHandle& topics = getNodeHandle();
      model_ = loadModel(requiredParameter<std::string>(nh, "model"));
      dynamics_ = std::make_unique<Dynamics<double>>(model_);
      measured_publisher_ = topics.advertise<nav_msgs::Path>("path/measured", 1);
      predicted_publisher_ = topics.advertise<nav_msgs::Path>("path/predicted", 1);
      markers_publisher_ = topics.advertise<visualization_msgs::MarkerArray>("markers", 1);
      reconfigure_ = std::make_unique<LiveParameters<Config>>(nh, nullptr, [this](const Config& c) {
        const std::lock_guard<std::mutex> lock(mutex_);
        config_ = c;
      });
      controls_subscriber_ = topics.subscribe("controls", 50, &Visualizer::onControls, this);
      state_subscriber_ = topics.subscribe("state", 50, &Visualizer::onState, this);
    } catch (const std::exception& error) {
      NODELET_FATAL("visualizer: %s", error.what());
      throw;
    }
  }

  void onControls(const ground_msgs::Controls::ConstPtr& controls) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!controls_.empty() && controls->header.stamp < controls_.back()->header.stamp)
      controls_.clear();
    controls_.push_back(controls);
    const double keep = config_.horizon + 2.0;
    while (controls_.size() > 1 && age(*controls, *controls_[1]) > keep) controls_.pop_front();
  }

  void onState(const ground_msgs::State::ConstPtr& state) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!states_.empty() && state->header.stamp < states_.back()->header.stamp) {
      states_.clear();  // a bag that starts again
      last_update_ = ros::Time();
    }
    if (state->valid) {
      states_.push_back(state);
      const double keep = std::max(config_.history, config_.horizon) + 0.5;
      while (age(*state, *states_.front()) > keep) states_.pop_front();
    }
    const double since = secondsBetween(last_update_, state->header.stamp);
    if (!last_update_.isZero() && state->valid == shown_ && since < 1 / config_.rate) return;
    last_update_ = state->header.stamp;
    shown_ = state->valid;
    publishMarkers(*state);
    if (states_.empty()) return;
    publishMeasured();
    publishPredicted();
  }

  static geometry_msgs::PoseStamped pose(const ros::Time& stamp, double x, double y, double psi) {
    geometry_msgs::PoseStamped p;
    p.header.stamp = stamp;
    p.header.frame_id = "world_ned";
    p.pose.position.x = x;
    p.pose.position.y = y;
    p.pose.position.z = -0.01;  // above the grid
    p.pose.orientation.z = std::sin(psi / 2);
    p.pose.orientation.w = std::cos(psi / 2);
    return p;
  }

  /// How much earlier the second message was stamped [s]; a difference of times, since an instant
  /// before zero is an error to ROS.
  template <class A, class B>
  static double age(const A& now, const B& then) {
    return secondsBetween(then.header.stamp, now.header.stamp);
  }

  void publishMeasured() {
    auto path = boost::make_shared<nav_msgs::Path>();
    path->header.stamp = states_.back()->header.stamp;
    path->header.frame_id = "world_ned";
    ros::Time last;
    for (const auto& s : states_) {
      const bool close = secondsBetween(last, s->header.stamp) < 0.02;
      if (age(*states_.back(), *s) > config_.history || close) continue;
      last = s->header.stamp;
      path->poses.push_back(pose(last, s->eta[0], s->eta[1], s->eta[2]));
    }
    measured_publisher_.publish(path);
  }

  void publishPredicted() {
    const ros::Time end = states_.back()->header.stamp;
    const auto from = std::find_if(states_.begin(), states_.end(), [&](const auto& s) {
      return age(*states_.back(), *s) <= config_.horizon;
    });
    InputSequence inputs;
    const double origin = (*from)->header.stamp.toSec(), most = model_.body.input_max;
    for (const auto& c : controls_)
      inputs.add(c->header.stamp.toSec() - origin, most * c->left, most * c->right, c->lift);
    RigidState<double> initial;
    std::copy((*from)->eta.begin(), (*from)->eta.end(), initial.eta.data());
    std::copy((*from)->nu.begin(), (*from)->nu.end(), initial.nu.data());
    Simulation<double> simulation(*dynamics_, inputs, initial, 0);
    auto path = boost::make_shared<nav_msgs::Path>();
    path->header.stamp = end;
    path->header.frame_id = "world_ned";
    const double duration = end.toSec() - origin;
    const int steps = std::max(1, static_cast<int>(duration / 0.02));
    for (int i = 0; i <= steps; ++i) {
      simulation.advance(duration * i / steps);
      const Vector3<double>& eta = simulation.state().eta;
      if (!eta.allFinite()) break;
      path->poses.push_back(pose(end, eta.x(), eta.y(), eta.z()));
    }
    predicted_publisher_.publish(path);
  }

  visualization_msgs::Marker marker(const ros::Time& stamp, int id, int type, float r, float g,
                                    float b) const {
    visualization_msgs::Marker m;
    m.header.stamp = stamp;
    m.header.frame_id = "world_ned";
    m.ns = "craft";
    m.id = id;
    m.type = type;
    m.action = shown_ ? visualization_msgs::Marker::ADD : visualization_msgs::Marker::DELETE;
    m.pose.orientation.w = 1;
    m.color.r = r;
    m.color.g = g;
    m.color.b = b;
    m.color.a = 1;
    return m;
  }

  /// Hull, bow, and an arrow of force at each thruster; sizes follow from the lever arm.
  void publishMarkers(const ground_msgs::State& state) {
    using visualization_msgs::Marker;
    auto array = boost::make_shared<visualization_msgs::MarkerArray>();
    const ros::Time& stamp = state.header.stamp;
    const double l = model_.body.l, psi = state.eta[2];
    const auto craft = pose(stamp, state.eta[0], state.eta[1], psi).pose;
    const auto at = [&](double forward, double starboard, double down) {
      const Vector2<double> moved = bodyToWorld<double>(psi, Vector2<double>(forward, starboard));
      geometry_msgs::Point p;
      p.x = state.eta[0] + moved.x();
      p.y = state.eta[1] + moved.y();
      p.z = down;
      return p;
    };
    Marker hull = marker(stamp, 0, Marker::CYLINDER, 0.15f, 0.35f, 0.75f);
    hull.pose = craft;
    hull.scale.x = 5 * l;
    hull.scale.y = 3.6 * l;
    hull.scale.z = 0.8 * l;
    Marker bow = marker(stamp, 1, Marker::SPHERE, 1.0f, 0.8f, 0.1f);
    bow.pose = craft;
    bow.pose.position = at(2 * l, 0, -0.8 * l);
    bow.scale.x = bow.scale.y = bow.scale.z = l;
    array->markers = {hull, bow};
    const bool driven = !controls_.empty();
    const double inputs[2] = {driven ? controls_.back()->left : 0.0,
                              driven ? controls_.back()->right : 0.0};
    for (int side = 0; side < 2; ++side) {
      Marker thruster = marker(stamp, 2 + side, Marker::CYLINDER, 0.3f, 0.3f, 0.3f);
      thruster.pose = craft;
      thruster.pose.position = at(-1.5 * l, side == 0 ? -l : l, -l);
      thruster.scale.x = thruster.scale.y = 1.4 * l;
      thruster.scale.z = 0.6 * l;
      Marker arrow = marker(stamp, 4 + side, Marker::ARROW, 0.9f, 0.15f, 0.15f);
      const double length = std::clamp(inputs[side], 0.0, 1.0) * config_.thrust_length;
      arrow.points = {at(-1.5 * l, side == 0 ? -l : l, -1.5 * l),
                      at(-1.5 * l + length, side == 0 ? -l : l, -1.5 * l)};
      arrow.scale.x = 0.4 * l;
      arrow.scale.y = 0.9 * l;
      if (length < 1e-3) arrow.action = Marker::DELETE;
      array->markers.push_back(thruster);
      array->markers.push_back(arrow);
    }
    markers_publisher_.publish(array);
  }

  std::mutex mutex_;  ///< guards config_ and what the callbacks collect
  Config config_;
  Model model_;
  std::unique_ptr<Dynamics<double>> dynamics_;
  std::deque<ground_msgs::State::ConstPtr> states_;
  std::deque<ground_msgs::Controls::ConstPtr> controls_;
  ros::Time last_update_;
  bool shown_ = false;
  ros::Publisher measured_publisher_, predicted_publisher_, markers_publisher_;
  ros::Subscriber state_subscriber_, controls_subscriber_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::Visualizer, nodelet::Nodelet)
