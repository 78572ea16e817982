#include <ground/VisualizerConfig.h>
#include <ground_msgs/Controls.h>
#include <ground_msgs/ModelComparison.h>
#include <ground_msgs/ModelError.h>
#include <ground_msgs/State.h>
#include <nav_msgs/Path.h>
#include <nodelet/nodelet.h>
#include <tf2_ros/transform_broadcaster.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <iomanip>
#include <mutex>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "ground/control/room.h"
#include "ground/estimation/floor_map.h"
#include "ground/model/typical.h"
#include "ground/nodelets/callback_thread.h"
#include "ground/nodelets/controls.h"
#include "ground/nodelets/legend.h"
#include "ground/nodelets/markers.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/time.h"

namespace ground {

/// Shows the craft in rviz: its path, the force of each thruster, the missing force, a map of a
/// model's prediction errors on the floor, and a legend with units, scales and the errors of models.
///
/// Parameters: model (model file, required), room (file of a room, whose walls and floor are shown;
/// empty: a floor of 10 x 10 m) and those of Visualizer.cfg, which can be changed at run time.
/// Subscribes: state, controls, model_error, model_error2, model_comparison. Publishes:
/// path/measured, markers, legend, floor_map, room (latched). Broadcasts the frame "view": at the
/// craft, or at the home of the room (follow), with the axes of world_ned; views and the legend are
/// in it.
class Visualizer : public nodelet::Nodelet {
 private:
  using Config = VisualizerConfig;

  void onInit() override {
    try {
      ros::NodeHandle nh = callbacks_.handle(getPrivateNodeHandle());
      ros::NodeHandle topics = callbacks_.handle(getNodeHandle());
      model_ = loadModelAndWarn(requiredParameter<std::string>(nh, "model"));
      measured_publisher_ = topics.advertise<nav_msgs::Path>("path/measured", 1);
      markers_publisher_ = topics.advertise<visualization_msgs::MarkerArray>("markers", 1);
      legend_publisher_ = topics.advertise<visualization_msgs::MarkerArray>("legend", 1, true);
      floor_publisher_ = topics.advertise<visualization_msgs::Marker>("floor_map", 1, true);
      room_publisher_ = topics.advertise<visualization_msgs::MarkerArray>("room", 1, true);
      const auto room = optionalParameter<std::string>(nh, "room", "");
      const Room plan = room.empty() ? openFloor() : loadRoom(room);
      home_ = plan.home;
      grid_cell_ = gridCell(plan);
      room_publisher_.publish(floorOf(plan, grid_cell_, !room.empty()));
      reconfigure_ = std::make_unique<LiveParameters<Config>>(nh, nullptr, [this](const Config& c) {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (c.cell != floor_.cell()) floor_ = FloorMap(c.cell);
        config_ = c;
      });
      const auto listen = [&](const std::string& topic, ground_msgs::ModelError::ConstPtr& newest) {
        return topics.subscribe<ground_msgs::ModelError>(
            topic, 50, [this, &newest](const auto& m) { onError(m, newest); });
      };
      error_subscribers_ = {listen("model_error", errors_[0]), listen("model_error2", errors_[1])};
      comparison_subscriber_ = topics.subscribe("model_comparison", 5, &Visualizer::onComparison, this);
      controls_subscriber_ = topics.subscribe("controls", 50, &Visualizer::onControls, this);
      state_subscriber_ = topics.subscribe("state", 50, &Visualizer::onState, this);
    } catch (const std::exception& error) {
      NODELET_FATAL("visualizer: %s", error.what());
      throw;
    }
  }

  void onControls(const ground_msgs::Controls::ConstPtr& controls) {
    const std::lock_guard<std::mutex> lock(mutex_);
    controls_ = controls;
  }

  void onError(const ground_msgs::ModelError::ConstPtr& error, ground_msgs::ModelError::ConstPtr& newest) {
    const std::lock_guard<std::mutex> lock(mutex_);
    newest = error;
    if (&newest != &errors_[0] || error->window < kMinWindow) return;
    floor_.add(error->eta[0] + error->eta_error[0], error->eta[1] + error->eta_error[1], error->error_now);
  }

  void onComparison(const ground_msgs::ModelComparison::ConstPtr& comparison) {
    const std::lock_guard<std::mutex> lock(mutex_);
    comparison_ = comparison;
  }

  void onState(const ground_msgs::State::ConstPtr& state) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!states_.empty() && state->header.stamp < states_.back()->header.stamp) {
      states_.clear();  // a bag that starts again
      floor_ = FloorMap(config_.cell);
      errors_ = {};
      comparison_.reset();
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
    view.transform.translation.x = config_.follow ? state.eta[0] : home_.x();
    view.transform.translation.y = config_.follow ? state.eta[1] : home_.y();
    view.transform.rotation.w = 1;
    broadcaster_.sendTransform(view);
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

  /// Stamp of the first message minus stamp of the second [s]. Computed as a difference, because
  /// ROS does not allow times before zero.
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
      if (secondsBetween(last, s->header.stamp) < 0.02) continue;
      last = s->header.stamp;
      path->poses.push_back(pose(last, s->eta[0], s->eta[1], s->eta[2]));
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

  /// Half of the craft's width, which the lever arm tells, or the thrusters' places [m].
  double halfWidth() const {
    double half = 1.8 * model_.body.l;
    if (!model_.thrusters->isPair())
      for (const Thruster& one : model_.thrusters->thrusters()) half = std::max(half, one.position.norm());
    return half;
  }

  /// Where a thruster is drawn, forward and to starboard [m]. The place of one of the pair along the
  /// craft has no influence on the motion: it is drawn at the stern.
  Vector2<double> placeOf(int i) const {
    const double l = model_.body.l;
    if (model_.thrusters->isPair()) return {-1.5 * l, i == 0 ? -l : l};
    return (*model_.thrusters)[i].position;
  }

  /// Force of each thruster at the newest command [N].
  Thrusters<double> thrust() const {
    const ThrusterLayout& layout = *model_.thrusters;
    const bool fits = controls_ && misfit(*controls_, layout).empty();
    const Inputs inputs = fits ? readInputs(*controls_) : Inputs::off(layout.size());
    Thrusters<double> forces = layout.forces(layout.clipped(inputs.thrusters, 1));
    forces *= model_.body.k * model_.body.input_max;
    return forces;
  }

  /// Force of the strongest thruster at full input [N].
  double fullThrust() const {
    double gain = 1;
    for (const Thruster& one : model_.thrusters->thrusters()) gain = std::max(gain, one.gain);
    return gain * model_.body.k * model_.body.input_max;
  }

  /// Hull, bow, and an arrow of force at each thruster.
  void publishMarkers(const ground_msgs::State& state) {
    using visualization_msgs::Marker;
    auto array = boost::make_shared<visualization_msgs::MarkerArray>();
    const ros::Time& stamp = state.header.stamp;
    const double size = halfWidth(), l = size / 1.8, psi = state.eta[2];
    const auto craft = pose(stamp, state.eta[0], state.eta[1], psi).pose;
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
    const Thrusters<double> forces = thrust();
    for (int i = 0; i < forces.size(); ++i) {
      const Vector2<double> place = placeOf(i);
      const Vector2<double> along(model_.thrusters->forward(i), model_.thrusters->starboard(i));
      const std::size_t shade = static_cast<std::size_t>(i) % palette::kThrusters.size();
      Marker thruster = marker(stamp, kThrusters + i, Marker::CYLINDER, palette::kThrusters[shade]);
      thruster.pose = craft;
      thruster.pose.position = at(place.x(), place.y(), -l);
      thruster.scale.x = thruster.scale.y = 1.4 * l;
      thruster.scale.z = 0.6 * l;
      Marker arrow = marker(stamp, kThrust + i, Marker::ARROW, palette::kThrusters[shade]);
      const Vector2<double> tip = place + per_newton * forces(i) * along;
      arrow.points = {at(place.x(), place.y(), -1.5 * l), at(tip.x(), tip.y(), -1.5 * l)};
      arrow.scale.x = kArrowWidth;
      arrow.scale.y = 2.3 * kArrowWidth;
      if ((tip - place).norm() < 1e-3) arrow.action = Marker::DELETE;
      array.markers.push_back(thruster);
      array.markers.push_back(arrow);
    }
  }

  bool isRecent(const ground_msgs::ModelError::ConstPtr& error) const {
    return error && !states_.empty() && std::abs(age(*states_.back(), *error)) < kRecent;
  }

  /// Adds arrows for the missing force of the first model, at the craft, and its moment as a
  /// lateral force at the bow.
  template <class At>
  void addMissing(visualization_msgs::MarkerArray& array, const ros::Time& stamp, At at) {
    using visualization_msgs::Marker;
    const bool known = isRecent(errors_[0]);
    const double l = model_.body.l, full = typical::force(model_.body);
    const std::array<double, 3> w =
        known ? std::array<double, 3>{errors_[0]->wrench[0], errors_[0]->wrench[1], errors_[0]->wrench[2]}
              : std::array<double, 3>{};
    const double per_newton = config_.missing_length / full;
    const auto arrow = [&](int id, double from, double forward, double starboard) {
      Marker m = marker(stamp, id, Marker::ARROW, palette::kMissing);
      m.points = {at(from, 0, -3 * l), at(from + per_newton * forward, per_newton * starboard, -3 * l)};
      m.scale.x = 1.5 * kArrowWidth;
      m.scale.y = 3.5 * kArrowWidth;
      if (!known || std::hypot(forward, starboard) < kMinPart * full) m.action = Marker::DELETE;
      array.markers.push_back(m);
    };
    arrow(kMissing, 0, w[0], w[1]);
    arrow(kMissing + 1, 2.5 * l, 0, w[2] / l);
  }

  /// Publishes the legend when it changes.
  void publishLegend() {
    const std::vector<LegendEntry> entries = config_.legend ? legendEntries() : std::vector<LegendEntry>();
    if (entries == legend_) return;
    legend_ = entries;
    legend_publisher_.publish(legendMarkers(entries, kView, config_.legend_ahead, config_.legend_aside));
  }

  /// What each line, arrow and colour is, with its unit and scale; the error of each model.
  std::vector<LegendEntry> legendEntries() const {
    using Sample = LegendEntry::Sample;
    std::vector<LegendEntry> entries = {{"measured path", Sample::kPath, palette::kMeasured},
                                        {"reference", Sample::kPath, palette::kReference, 0.6, 0.05}};
    for (std::size_t i = 0; i < errors_.size(); ++i) {
      if (!isRecent(errors_[i])) continue;
      const ground_msgs::ModelError& error = *errors_[i];
      const bool better = isRecent(errors_[1]) && comparison_ && comparison_->better == error.model;
      entries.push_back({error.model + ", " + rounded(error.horizon) + " s ahead: error " +
                             rounded(error.error) + (better ? " [-], better" : " [-]"),
                         Sample::kPath, palette::kModels[i]});
    }
    const double missing = kMissingSample * typical::force(model_.body) / config_.missing_length;
    entries.push_back({"thrust of each thruster: " + rounded(1e3 * fullThrust()) + " mN", Sample::kArrow,
                       palette::kThrusters[0], config_.thrust_length, kArrowWidth});
    if (isRecent(errors_[0]))
      entries.push_back({"force missing in " + errors_[0]->model + ": " + rounded(1e3 * missing) + " mN",
                         Sample::kArrow, palette::kMissing, kMissingSample, 1.5 * kArrowWidth});
    if (config_.floor_map && !floor_.cells().empty())
      entries.push_back(
          {"error by place: 0 to " + rounded(floor_.large()) + " [-]", Sample::kScale, palette::kBlack, 1.0});
    entries.push_back(
        {"1 m (grid: " + rounded(grid_cell_) + " m)", Sample::kBar, palette::kBlack, 1.0, 0.015});
    return entries;
  }

  /// Two digits, as in "0.45", "62".
  static std::string rounded(double value) {
    std::ostringstream text;
    text << std::setprecision(2) << value;
    return text.str();
  }

  /// The floor that is shown without a room.
  static Room openFloor() {
    Room floor;
    floor.corners = {{-5, -5}, {5, -5}, {5, 5}, {-5, 5}};
    return floor;
  }

  /// Lower and upper ends of a room along x and y [m].
  static std::pair<Vector2<double>, Vector2<double>> ends(const Room& room) {
    Vector2<double> low = room.corners.front(), high = low;
    for (const Vector2<double>& corner : room.corners) {
      low = low.cwiseMin(corner);
      high = high.cwiseMax(corner);
    }
    return {low, high};
  }

  /// Distance of the grid lines on a floor [m].
  static double gridCell(const Room& room) {
    constexpr double kMaxLines = 40;
    const auto [low, high] = ends(room);
    return std::max(0.5, std::ceil((high - low).maxCoeff() / kMaxLines));
  }

  /// Grid lines over the floor, and the walls and the home of a room.
  static visualization_msgs::MarkerArrayPtr floorOf(const Room& room, double cell, bool walls) {
    using visualization_msgs::Marker;
    const auto lines = [](int id, double width, const std::string& color) {
      Marker m = makeMarker("world_ned", "room", id, Marker::LINE_LIST, markerColor(color));
      m.scale.x = width;
      return m;
    };
    const auto add = [](Marker& m, double x0, double y0, double x1, double y1) {
      constexpr double kBelow = 0.015;  // below paths and floor map
      m.points.push_back(markerPoint(x0, y0, kBelow));
      m.points.push_back(markerPoint(x1, y1, kBelow));
    };
    const auto [low, high] = ends(room);
    Marker grid = lines(0, 0.004, "#b0b0b0"), wall = lines(1, 0.03, "#404040"),
           home = lines(2, 0.015, "#606060");
    for (double x = cell * std::ceil(low.x() / cell); x <= high.x(); x += cell)
      add(grid, x, low.y(), x, high.y());
    for (double y = cell * std::ceil(low.y() / cell); y <= high.y(); y += cell)
      add(grid, low.x(), y, high.x(), y);
    auto array = boost::make_shared<visualization_msgs::MarkerArray>();
    array->markers.push_back(grid);
    if (!walls) return array;
    for (std::size_t i = 0; i < room.corners.size(); ++i) {
      const Vector2<double>&a = room.corners[i], &b = room.corners[(i + 1) % room.corners.size()];
      add(wall, a.x(), a.y(), b.x(), b.y());
    }
    add(home, room.home.x() - 0.1, room.home.y(), room.home.x() + 0.1, room.home.y());
    add(home, room.home.x(), room.home.y() - 0.1, room.home.x(), room.home.y() + 0.1);
    array->markers.push_back(wall);
    array->markers.push_back(home);
    return array;
  }

  /// Publishes the mean error of the first model in each cell of the floor.
  void publishFloor() {
    using visualization_msgs::Marker;
    auto m = boost::make_shared<Marker>(
        marker(states_.back()->header.stamp, 0, Marker::CUBE_LIST, palette::kBlack));
    m->ns = "floor";
    m->action = config_.floor_map ? Marker::ADD : Marker::DELETE;
    m->scale.x = m->scale.y = 0.96 * config_.cell;
    m->scale.z = 0.002;
    const double most = floor_.large();
    for (const auto& cell : floor_.cells()) {
      m->points.push_back(markerPoint(cell.x, cell.y, 0.01));  // below the paths
      m->colors.push_back(scaleColor(cell.mean / most, kFloorOpacity));
    }
    if (m->points.empty()) m->action = Marker::DELETE;
    floor_publisher_.publish(m);
  }

  static constexpr double kRecent = 1.0;         // largest age of an error that is shown [s]
  static constexpr double kMinWindow = 2.0;      // shortest window with well normalised errors [s]
  static constexpr double kFloorPeriod = 1.0;    // interval of floor maps [s]
  static constexpr double kMinPart = 0.01;       // smallest force shown, relative to full thrust
  static constexpr double kLegendPeriod = 1.0;   // interval of legends [s]
  static constexpr double kArrowWidth = 0.03;    // shaft of an arrow of thrust [m]
  static constexpr double kMissingSample = 0.5;  // arrow of a missing force in the legend [m]
  static constexpr const char* kView = "view";   // frame that views and the legend follow
  static constexpr const char *kHullColor = "#c8c8c8", *kBowColor = "#404040";
  /// First numbers of the markers of the craft.
  enum { kHull = 0, kBow = 1, kMissing = 2, kThrusters = 10, kThrust = kThrusters + kMaxThrusters };

  CallbackThread callbacks_;
  std::mutex mutex_;  ///< guards config_ and the data of the callbacks
  Config config_;
  Model model_;
  std::deque<ground_msgs::State::ConstPtr> states_;
  ground_msgs::Controls::ConstPtr controls_;
  std::array<ground_msgs::ModelError::ConstPtr, 2> errors_;
  ground_msgs::ModelComparison::ConstPtr comparison_;
  FloorMap floor_{0.25};
  ros::Time last_update_, last_floor_, last_legend_;
  bool shown_ = false;
  Vector2<double> home_{0, 0};  ///< of the room, world_ned [m]
  double grid_cell_ = 0;        ///< distance of the grid lines on the floor [m]
  std::vector<LegendEntry> legend_;
  tf2_ros::TransformBroadcaster broadcaster_;
  ros::Publisher measured_publisher_, markers_publisher_, legend_publisher_, floor_publisher_,
      room_publisher_;
  ros::Subscriber state_subscriber_, controls_subscriber_, comparison_subscriber_;
  std::array<ros::Subscriber, 2> error_subscribers_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::Visualizer, nodelet::Nodelet)
