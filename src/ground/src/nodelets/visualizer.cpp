#include <ground/VisualizerConfig.h>
#include <ground_msgs/Controls.h>
#include <ground_msgs/ModelComparison.h>
#include <ground_msgs/ModelError.h>
#include <ground_msgs/Reference.h>
#include <ground_msgs/State.h>
#include <nav_msgs/Path.h>
#include <tf2_ros/transform_broadcaster.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <mutex>
#include <pluginlib/class_list_macros.hpp>
#include <string>
#include <utility>
#include <vector>

#include "ground/estimation/floor_map.h"
#include "ground/model/typical.h"
#include "ground/nodelets/controls.h"
#include "ground/nodelets/markers.h"
#include "ground/nodelets/messages.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/shell.h"
#include "ground/nodelets/time.h"
#include "ground/safety/room.h"
#include "legend.h"

namespace ground {

/// Shows the craft in rviz: its path, the force of each thruster, the missing force where it is more than
/// noise, a map of a model's prediction errors on the floor, and a legend in the colours of what it
/// explains, with units, scales and how far models are off.
///
/// Parameters: model (model file, required), room (file of a room, whose walls are shown;
/// empty: none) and those of Visualizer.cfg, which can be changed at run time.
/// Subscribes: state, controls, reference, model_error, model_error2, model_comparison.
/// Publishes: path/measured, markers, legend, floor_map, room (latched). Broadcasts the frame "view" with the
/// axes of world_ned: at the home of the room, or at the craft if there is no room or by `follow`; views and
/// the legend are in it.
class Visualizer : public Shell {
 private:
  using Config = VisualizerConfig;

  void start(ros::NodeHandle& nh, ros::NodeHandle& topics) override {
    model_ = loadModelAndWarn(requiredParameter<std::string>(nh, "model"));
    measured_publisher_ = topics.advertise<nav_msgs::Path>("path/measured", 1);
    markers_publisher_ = topics.advertise<visualization_msgs::MarkerArray>("markers", 1);
    legend_publisher_ = topics.advertise<visualization_msgs::MarkerArray>("legend", 1, true);
    floor_publisher_ = topics.advertise<visualization_msgs::Marker>("floor_map", 1, true);
    room_publisher_ = topics.advertise<visualization_msgs::MarkerArray>("room", 1, true);
    const auto room = optionalParameter<std::string>(nh, "room", "");
    if (!room.empty()) showRoom(loadRoom(room));
    reconfigure_ = std::make_unique<LiveParameters<Config>>(nh, [this](const Config& c) {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (c.cell != floor_.cell()) floor_ = FloorMap(c.cell);
      config_ = c;
    });
    error_subscribers_ = {
        topics.subscribe<ground_msgs::ModelError>("model_error", 50, [this](const auto& m) { onError(m); }),
        keep(topics, "model_error2", errors_[1])};
    comparison_subscriber_ = keep(topics, "model_comparison", comparison_);
    controls_subscriber_ = keep(topics, "controls", controls_);
    reference_subscriber_ = keep(topics, "reference", reference_);
    state_subscriber_ = topics.subscribe("state", 50, &Visualizer::onState, this);
  }

  /// Stores the newest message of a topic.
  template <class Message>
  ros::Subscriber keep(ros::NodeHandle& topics, const std::string& topic,
                       boost::shared_ptr<const Message>& newest) {
    return topics.subscribe<Message>(topic, 50, [this, &newest](const auto& message) {
      const std::lock_guard<std::mutex> lock(mutex_);
      newest = message;
    });
  }

  void onError(const ground_msgs::ModelError::ConstPtr& error) {
    const std::lock_guard<std::mutex> lock(mutex_);
    errors_[0] = error;
    if (error->window < kMinHorizons * error->horizon || !error->excited) return;
    floor_noise_ = error->position_noise;
    floor_.add(error->eta[0] + error->eta_error[0], error->eta[1] + error->eta_error[1],
               std::hypot(error->eta_error[0], error->eta_error[1]));
  }

  void onState(const ground_msgs::State::ConstPtr& state) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!states_.empty() && state->header.stamp < states_.back()->header.stamp) {
      states_.clear();  // a bag that starts again
      floor_ = FloorMap(config_.cell);
      errors_ = {};
      comparison_.reset();
      reference_.reset();
      last_update_ = last_floor_ = last_legend_ = ros::Time();
    }
    if (state->valid) {
      broadcastView(*state);
      states_.push_back(state);
      while (age(*state, *states_.front()) > config_.history) states_.pop_front();
    }
    const double since = secondsBetween(last_update_, state->header.stamp);
    if (!last_update_.isZero() && state->valid == shown_ && since < 1 / config_.rate) return;
    last_update_ = state->header.stamp;
    shown_ = state->valid;
    publishMarkers(*state);
    if (states_.empty()) return;
    publishMeasured();
    if (isDue(last_floor_, state->header.stamp, kFloorPeriod)) publishFloor();
    if (isDue(last_legend_, state->header.stamp, kLegendPeriod)) publishLegend();
  }

  /// Whether a period has passed; `last` is then set to now.
  static bool isDue(ros::Time& last, const ros::Time& now, double period) {
    const double since = secondsBetween(last, now);
    if (!last.isZero() && since >= 0 && since <= period) return false;
    last = now;
    return true;
  }

  void broadcastView(const ground_msgs::State& state) {
    geometry_msgs::TransformStamped view;
    view.header.stamp = state.header.stamp;
    view.header.frame_id = "world_ned";
    view.child_frame_id = kView;
    view.transform.translation.x = follows() ? state.eta[0] : home_.x();
    view.transform.translation.y = follows() ? state.eta[1] : home_.y();
    view.transform.rotation.w = 1;
    broadcaster_.sendTransform(view);
  }

  bool follows() const { return config_.follow || !has_room_; }

  /// Stamp of the first message minus stamp of the second [s]. Computed as a difference, because
  /// ROS does not allow times before zero.
  template <class A, class B>
  static double age(const A& now, const B& then) {
    return secondsBetween(then.header.stamp, now.header.stamp);
  }

  void publishMeasured() {
    auto path = inWorld<nav_msgs::Path>(states_.back()->header.stamp);
    ros::Time last;
    for (const auto& s : states_) {
      if (secondsBetween(last, s->header.stamp) < 0.02) continue;
      last = s->header.stamp;
      addPose(*path, last, poseOf(s->eta[0], s->eta[1], kAboveGrid, s->eta[2]));
    }
    measured_publisher_.publish(path);
  }

  visualization_msgs::Marker marker(const ros::Time& stamp, int id, int type,
                                    const std::string& color) const {
    visualization_msgs::Marker m = makeMarker("world_ned", "craft", id, type, markerColor(color));
    m.header.stamp = stamp;
    m.action = shown_ ? visualization_msgs::Marker::ADD : visualization_msgs::Marker::DELETE;
    return m;
  }

  /// Where a thruster is, forward and to starboard [m].
  Vector2<double> placeOf(int i) const {
    return (*model_.thrusters)[i].position * model_.body.l / model_.thrusters->lever();
  }

  /// Half of the craft's width, which the lever arm tells, or the thrusters' places [m].
  double halfWidth() const {
    double half = 1.8 * model_.body.l;
    for (int i = 0; i < model_.thrusters->size(); ++i) half = std::max(half, placeOf(i).norm());
    return half;
  }

  /// The newest command.
  Thrusters<double> commanded() const {
    const bool fits = controls_ && misfit(*controls_, *model_.thrusters).empty();
    return fits ? readInputs(*controls_).thrusters : Thrusters<double>::zero(model_.thrusters->size());
  }

  /// Force of thruster i alone, with all angles, forward and to starboard [N].
  Vector2<double> force(int i, Thrusters<double> inputs) const {
    const ThrusterLayout& layout = *model_.thrusters;
    const double full = model_.body.input_max;
    for (int j = 0; j < inputs.size(); ++j)
      if (layout.pushes(j) && j != i) inputs(j) = 0;
    if (!layout.pushes(i)) return {0, 0};
    return model_.body.k *
           layout.atRest(layout.clipped(Thrusters<double>(full * asVector(inputs)), full)).head<2>();
  }

  /// Force of the strongest thruster at full input [N].
  double fullThrust() const {
    const ThrusterLayout& layout = *model_.thrusters;
    double full = 0;
    for (int i = 0; i < layout.size(); ++i) {
      Thrusters<double> inputs = Thrusters<double>::zero(layout.size());
      inputs(i) = layout[i].most;
      full = std::max(full, force(i, inputs).norm());
    }
    return full;
  }

  /// Hull, bow, and an arrow of force at each thruster.
  void publishMarkers(const ground_msgs::State& state) {
    using visualization_msgs::Marker;
    auto array = boost::make_shared<visualization_msgs::MarkerArray>();
    const ros::Time& stamp = state.header.stamp;
    const double size = halfWidth(), l = size / 1.8, psi = state.eta[2];
    const auto craft = poseOf(state.eta[0], state.eta[1], kAboveGrid, psi);
    const auto at = [&](double forward, double starboard, double down) {
      const Vector2<double> moved = bodyToWorld<double>(psi, Vector2<double>(forward, starboard));
      return markerPoint(state.eta[0] + moved.x(), state.eta[1] + moved.y(), down);
    };
    Marker hull = marker(stamp, kHull, Marker::CYLINDER, kHullColor);
    hull.pose = craft;
    hull.scale.x = 5 * l;
    hull.scale.y = 2 * size;
    hull.scale.z = 0.8 * l;
    Marker bow = marker(stamp, kBow, Marker::SPHERE, kBowColor);
    bow.pose = craft;
    bow.pose.position = at(2 * l, 0, -0.8 * l);
    bow.scale.x = bow.scale.y = bow.scale.z = l;
    array->markers = {hull, bow};
    addThrusters(*array, stamp, craft, at);
    addMissing(*array, stamp, at);
    markers_publisher_.publish(array);
  }

  /// Adds each thruster, and an arrow along its force.
  template <class At>
  void addThrusters(visualization_msgs::MarkerArray& array, const ros::Time& stamp,
                    const geometry_msgs::Pose& craft, At at) const {
    using visualization_msgs::Marker;
    const double l = halfWidth() / 1.8, per_newton = config_.thrust_length / fullThrust();
    const Thrusters<double> inputs = commanded();
    for (int i = 0; i < inputs.size(); ++i) {
      const Vector2<double> place = placeOf(i);
      const std::size_t shade = static_cast<std::size_t>(i) % palette::kThrusters.size();
      Marker thruster = marker(stamp, kThrusters + i, Marker::CYLINDER, palette::kThrusters[shade]);
      thruster.pose = craft;
      thruster.pose.position = at(place.x(), place.y(), -l);
      thruster.scale.x = thruster.scale.y = 1.4 * l;
      thruster.scale.z = 0.6 * l;
      Marker arrow = marker(stamp, kThrust + i, Marker::ARROW, palette::kThrusters[shade]);
      const Vector2<double> tip = place + per_newton * force(i, inputs);
      arrow.points = {at(place.x(), place.y(), -1.5 * l), at(tip.x(), tip.y(), -1.5 * l)};
      arrow.scale.x = kArrowWidth;
      arrow.scale.y = 2.3 * kArrowWidth;
      if ((tip - place).norm() < 1e-3) arrow.action = Marker::DELETE;
      array.markers.push_back(thruster);
      array.markers.push_back(arrow);
    }
  }

  template <class Message>
  bool isRecent(const boost::shared_ptr<const Message>& message) const {
    return message && !states_.empty() && std::abs(age(*states_.back(), *message)) < kRecent;
  }

  /// Adds arrows for the missing force of the first model, at the craft, and its moment as a
  /// lateral force at the bow, where they are more than noise. Their length is limited.
  template <class At>
  void addMissing(visualization_msgs::MarkerArray& array, const ros::Time& stamp, At at) {
    using visualization_msgs::Marker;
    const double l = model_.body.l, per_newton = config_.missing_length / typical::force(model_.body);
    const auto arrow = [&](int id, double from, Vector2<double> force, bool is_sure) {
      Vector2<double> along = per_newton * force;
      if (along.norm() > kLongest) along *= kLongest / along.norm();
      Marker m = marker(stamp, id, Marker::ARROW, palette::kMissing);
      m.points = {at(from, 0, -3 * l), at(from + along.x(), along.y(), -3 * l)};
      m.scale.x = 1.5 * kArrowWidth;
      m.scale.y = 3.5 * kArrowWidth;
      if (!is_sure || along.norm() < kShortest) m.action = Marker::DELETE;
      array.markers.push_back(m);
    };
    const bool known = isRecent(errors_[0]);
    const ground_msgs::ModelError error = known ? *errors_[0] : ground_msgs::ModelError();
    const auto &w = error.wrench, &noise = error.wrench_noise;
    arrow(kMissing, 0, {w[0], w[1]}, known && std::hypot(w[0] / noise[0], w[1] / noise[1]) > kSure);
    arrow(kMissing + 1, 2.5 * l, {0, w[2] / l}, known && std::abs(w[2]) > kSure * noise[2]);
  }

  /// Publishes the legend when it changes, left of the room's walls or of the craft that the view follows.
  void publishLegend() {
    const LegendLines lines = config_.legend ? legendLines() : LegendLines();
    if (lines == legend_) return;
    legend_ = lines;
    const double near = follows() ? kNear : 1;
    const double right = follows() ? kLegendRight : left_wall_ - home_.y() - kGap;
    legend_publisher_.publish(legendMarkers(
        lines, kView, {near * config_.legend_ahead, near * config_.legend_aside, right, near * kLetter}));
  }

  /// What each line, arrow and colour is, with its unit and scale; how far each model is off.
  LegendLines legendLines() const {
    LegendLines lines = {{"measured path", palette::kMeasured}};
    if (isRecent(reference_)) lines.push_back({"reference", palette::kReference});
    for (std::size_t i = 0; i < errors_.size(); ++i) {
      if (!isRecent(errors_[i])) continue;
      const bool is_better = isRecent(errors_[1]) && comparison_ && comparison_->better == errors_[i]->model;
      addModel(lines, *errors_[i], is_better, palette::kModels[i]);
    }
    lines.push_back(
        {"thrust of each thruster: " + rounded(config_.thrust_length) + " m is " + newtons(fullThrust()),
         palette::kThrusters[0]});
    if (!isRecent(errors_[0])) return lines;
    lines.push_back({"missing force, beyond noise: 1 m is " +
                         newtons(typical::force(model_.body) / config_.missing_length),
                     palette::kMissing});
    if (config_.floor_map && !floor_.cells().empty())
      lines.push_back({"floor: off by " + rounded(1e3 * floor_noise_) + " mm (dark, noise) to " +
                           rounded(1e3 * floorTop()) + " mm",
                       palette::kScale.back()});
    return lines;
  }

  /// Error of the brightest colour of the floor [m].
  double floorTop() const { return std::max(floor_.large(), kFloorSpan * floor_noise_); }

  /// Publishes the walls and the home of a room.
  void showRoom(const Room& room) {
    using visualization_msgs::Marker;
    home_ = room.home;
    has_room_ = true;
    for (const Vector2<double>& corner : room.corners) left_wall_ = std::min(left_wall_, corner.y());
    auto array = boost::make_shared<visualization_msgs::MarkerArray>();
    const auto draw = [&array](double width, const std::string& color,
                               const std::vector<Vector2<double>>& ends) {
      const int id = static_cast<int>(array->markers.size());
      array->markers.push_back(makeMarker("world_ned", "room", id, Marker::LINE_LIST, markerColor(color)));
      array->markers.back().scale.x = width;
      for (const Vector2<double>& end : ends)  // below paths and floor map
        array->markers.back().points.push_back(markerPoint(end.x(), end.y(), 0.015));
    };
    std::vector<Vector2<double>> walls;
    for (std::size_t i = 0; i < room.corners.size(); ++i)
      walls.insert(walls.end(), {room.corners[i], room.corners[(i + 1) % room.corners.size()]});
    draw(0.03, "#404040", walls);
    const Vector2<double> ahead(0.1, 0), aside(0, 0.1);
    draw(0.015, "#606060", {home_ - ahead, home_ + ahead, home_ - aside, home_ + aside});
    room_publisher_.publish(array);
  }

  /// Publishes how far the first model is off in each cell of the floor, over what noise leaves.
  void publishFloor() {
    using visualization_msgs::Marker;
    auto m = boost::make_shared<Marker>(
        marker(states_.back()->header.stamp, 0, Marker::CUBE_LIST, palette::kBlack));
    m->ns = "floor";
    m->action = config_.floor_map ? Marker::ADD : Marker::DELETE;
    m->scale.x = m->scale.y = 0.96 * config_.cell;
    m->scale.z = 0.002;
    const double span = floorTop() - floor_noise_;
    for (const auto& cell : floor_.cells()) {
      m->points.push_back(markerPoint(cell.x, cell.y, 0.01));  // below the paths
      m->colors.push_back(scaleColor((cell.mean - floor_noise_) / span, kFloorOpacity));
    }
    if (m->points.empty()) m->action = Marker::DELETE;
    floor_publisher_.publish(m);
  }

  static constexpr double kRecent = 1.0;       // largest age of an error that is shown [s]
  static constexpr double kMinHorizons = 2.0;  // shortest window after which a model has settled, in horizons
  static constexpr double kFloorPeriod = 1.0;  // interval of floor maps [s]
  static constexpr double kFloorSpan = 5;      // least error of the brightest floor, relative to noise
  static constexpr double kSure = 3.5;         // least missing force that is shown, relative to noise
  static constexpr double kShortest = 0.02, kLongest = 0.8;  // arrow of a missing force [m]
  static constexpr double kGap = 0.2;                        // between legend and wall [m]
  static constexpr double kLetter = 0.165;                   // height in a view of the room [m]
  static constexpr double kNear =
      132. / 420;  // size of what the view near the craft shows, by that of a room
  static constexpr double kLegendRight = -0.2;  // right edge of a legend that follows the craft [m]
  static constexpr double kLegendPeriod = 1.0;  // interval of legends [s]
  static constexpr double kArrowWidth = 0.014;  // shaft of an arrow of thrust [m]
  static constexpr double kAboveGrid = -0.01;   // z points down [m]
  static constexpr const char* kView = "view";  // frame that views and the legend follow
  static constexpr const char *kHullColor = "#c8c8c8", *kBowColor = "#404040";
  /// First numbers of the markers of the craft.
  enum { kHull = 0, kBow = 1, kMissing = 2, kThrusters = 10, kThrust = kThrusters + kMaxThrusters };

  std::mutex mutex_;  ///< guards config_ and the data of the callbacks
  Config config_;
  Model model_;
  std::deque<ground_msgs::State::ConstPtr> states_;
  ground_msgs::Controls::ConstPtr controls_;
  ground_msgs::Reference::ConstPtr reference_;
  std::array<ground_msgs::ModelError::ConstPtr, 2> errors_;
  ground_msgs::ModelComparison::ConstPtr comparison_;
  FloorMap floor_{0.25};
  double floor_noise_ = 0;  ///< error of a right model [m]
  ros::Time last_update_, last_floor_, last_legend_;
  bool shown_ = false;
  bool has_room_ = false;
  Vector2<double> home_{0, 0};                                  ///< of the room, world_ned [m]
  double left_wall_ = std::numeric_limits<double>::infinity();  ///< smallest y of its corners [m]
  LegendLines legend_;
  tf2_ros::TransformBroadcaster broadcaster_;
  ros::Publisher measured_publisher_, markers_publisher_, legend_publisher_, floor_publisher_,
      room_publisher_;
  ros::Subscriber state_subscriber_, controls_subscriber_, comparison_subscriber_, reference_subscriber_;
  std::array<ros::Subscriber, 2> error_subscribers_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::Visualizer, nodelet::Nodelet)
