#include <ground/VisualizerConfig.h>
#include <ground_msgs/Controls.h>
#include <ground_msgs/ModelComparison.h>
#include <ground_msgs/ModelError.h>
#include <ground_msgs/State.h>
#include <nav_msgs/Path.h>
#include <nodelet/nodelet.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <iomanip>
#include <mutex>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>

#include "ground/control/room_plan.h"
#include "ground/estimation/floor_map.h"
#include "ground/model/model_file.h"
#include "ground/model/typical.h"
#include "ground/nodelets/callback_thread.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/time.h"

namespace ground {

/// Shows the craft in rviz: its path, its thrust, the missing force, the prediction errors of
/// models, and a map of these errors on the floor.
///
/// Parameters: model (model file, required), room (file of a room, whose walls and floor are shown;
/// empty: a floor of 10 x 10 m) and those of Visualizer.cfg, which can be changed at run time.
/// Subscribes: state, controls, model_error, model_error2, model_comparison. Publishes:
/// path/measured, markers, floor_map, room (latched).
class Visualizer : public nodelet::Nodelet {
 private:
  using Config = VisualizerConfig;

  void onInit() override {
    try {
      ros::NodeHandle nh = callbacks_.handle(getPrivateNodeHandle());
      ros::NodeHandle topics = callbacks_.handle(getNodeHandle());
      model_ = loadModel(requiredParameter<std::string>(nh, "model"));
      measured_publisher_ = topics.advertise<nav_msgs::Path>("path/measured", 1);
      markers_publisher_ = topics.advertise<visualization_msgs::MarkerArray>("markers", 1);
      floor_publisher_ = topics.advertise<visualization_msgs::Marker>("floor_map", 1, true);
      room_publisher_ = topics.advertise<visualization_msgs::MarkerArray>("room", 1, true);
      const auto room = optionalParameter<std::string>(nh, "room", "");
      room_publisher_.publish(room.empty() ? floorOf(openFloor(), false)
                                           : floorOf(loadRoomPlan(room), true));
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
      comparison_subscriber_ =
          topics.subscribe("model_comparison", 5, &Visualizer::onComparison, this);
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

  void onError(const ground_msgs::ModelError::ConstPtr& error,
               ground_msgs::ModelError::ConstPtr& newest) {
    const std::lock_guard<std::mutex> lock(mutex_);
    newest = error;
    if (&newest != &errors_[0] || error->window < kMinWindow) return;
    floor_.add(error->eta[0] + error->eta_error[0], error->eta[1] + error->eta_error[1],
               error->error_now);
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
      last_update_ = ros::Time();
    }
    if (state->valid) {
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
    if (secondsBetween(last_floor_, state->header.stamp) < 0 ||
        secondsBetween(last_floor_, state->header.stamp) > kFloorPeriod) {
      last_floor_ = state->header.stamp;
      publishFloor();
    }
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
    const double inputs[2] = {controls_ ? controls_->left : 0.0,
                              controls_ ? controls_->right : 0.0};
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
    addMissing(*array, stamp, at);
    addText(*array, stamp, craft.position);
    markers_publisher_.publish(array);
  }

  bool isRecent(const ground_msgs::ModelError::ConstPtr& error) const {
    return error && !states_.empty() && std::abs(age(*states_.back(), *error)) < kRecent;
  }

  /// Adds arrows for the missing force of the first model, at the craft, and its moment as a
  /// lateral force at the bow. The colour, from green to red, shows the size relative to full
  /// thrust.
  template <class At>
  void addMissing(visualization_msgs::MarkerArray& array, const ros::Time& stamp, At at) {
    using visualization_msgs::Marker;
    const bool known = isRecent(errors_[0]);
    const double l = model_.body.l, full = typical::force(model_.body);
    const std::array<double, 3> w =
        known ? std::array<double, 3>{errors_[0]->wrench[0], errors_[0]->wrench[1],
                                      errors_[0]->wrench[2]}
              : std::array<double, 3>{};
    const double per_newton = config_.missing_length / full;
    const auto arrow = [&](int id, double from, double forward, double starboard) {
      const double part = std::hypot(forward, starboard) / full;
      const auto color = heat(part / kRedPart);
      Marker m = marker(stamp, id, Marker::ARROW, color[0], color[1], color[2]);
      m.points = {at(from, 0, -3 * l),
                  at(from + per_newton * forward, per_newton * starboard, -3 * l)};
      m.scale.x = 0.6 * l;
      m.scale.y = 1.4 * l;
      if (!known || part < kMinPart) m.action = Marker::DELETE;
      array.markers.push_back(m);
    };
    arrow(6, 0, w[0], w[1]);
    arrow(7, 2.5 * l, 0, w[2] / l);
  }

  /// Adds a text with the current errors of the models, and which one is better.
  void addText(visualization_msgs::MarkerArray& array, const ros::Time& stamp,
               geometry_msgs::Point place) {
    using visualization_msgs::Marker;
    Marker text = marker(stamp, 8, Marker::TEXT_VIEW_FACING, 0.1f, 0.1f, 0.1f);
    for (const auto& error : errors_) {
      if (!isRecent(error)) continue;
      std::ostringstream line;
      line << (text.text.empty() ? "" : "\n") << error->model << ": error " << std::fixed
           << std::setprecision(3) << error->error;
      if (isRecent(errors_[1]) && comparison_ && comparison_->better == error->model)
        line << " (better)";
      text.text += line.str();
    }
    text.pose.position = place;
    text.pose.position.x -= 0.45;
    text.pose.position.z = -0.3;
    text.scale.z = 0.16;
    if (text.text.empty()) text.action = Marker::DELETE;
    array.markers.push_back(text);
  }

  /// The floor that is shown without a room.
  static RoomPlan openFloor() {
    RoomPlan floor;
    floor.corners = {{-5, -5}, {5, -5}, {5, 5}, {-5, 5}};
    return floor;
  }

  /// Grid lines over the floor, and the walls and the home of a room.
  static visualization_msgs::MarkerArrayPtr floorOf(const RoomPlan& room, bool walls) {
    using visualization_msgs::Marker;
    const auto lines = [](int id, double width, float grey) {
      Marker m;
      m.header.frame_id = "world_ned";
      m.ns = "room";
      m.id = id;
      m.type = Marker::LINE_LIST;
      m.pose.orientation.w = 1;
      m.scale.x = width;
      m.color.r = m.color.g = m.color.b = grey;
      m.color.a = 1;
      return m;
    };
    const auto add = [](Marker& m, double x0, double y0, double x1, double y1) {
      geometry_msgs::Point p;
      p.z = 0.015;  // below paths and floor map
      p.x = x0;
      p.y = y0;
      m.points.push_back(p);
      p.x = x1;
      p.y = y1;
      m.points.push_back(p);
    };
    Vector2<double> low = room.corners.front(), high = low;
    for (const Vector2<double>& corner : room.corners) {
      low = low.cwiseMin(corner);
      high = high.cwiseMax(corner);
    }
    constexpr double kMaxLines = 40;
    const double cell = std::max(0.5, std::ceil((high - low).maxCoeff() / kMaxLines));
    Marker grid = lines(0, 0.004, 0.7f), wall = lines(1, 0.03, 0.25f), home = lines(2, 0.015, 0.4f);
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

  /// Publishes the mean error of the first model in each cell of the floor, from green to red.
  void publishFloor() {
    using visualization_msgs::Marker;
    auto m = boost::make_shared<Marker>(
        marker(states_.back()->header.stamp, 0, Marker::CUBE_LIST, 1, 1, 1));
    m->ns = "floor";
    m->action = config_.floor_map ? Marker::ADD : Marker::DELETE;
    m->scale.x = m->scale.y = 0.96 * config_.cell;
    m->scale.z = 0.002;
    const double most = floor_.large();
    for (const auto& cell : floor_.cells()) {
      geometry_msgs::Point p;
      p.x = cell.x;
      p.y = cell.y;
      p.z = 0.01;  // below the paths
      const auto color = heat(cell.mean / most);
      std_msgs::ColorRGBA c;
      c.r = color[0];
      c.g = color[1];
      c.b = color[2];
      c.a = 0.35f;
      m->points.push_back(p);
      m->colors.push_back(c);
    }
    if (m->points.empty()) m->action = Marker::DELETE;
    floor_publisher_.publish(m);
  }

  /// Colour from green (0) over yellow to red (1 and above).
  static std::array<float, 3> heat(double part) {
    const float x = static_cast<float>(std::clamp(part, 0.0, 1.0));
    return {std::min(1.0f, 0.2f + 1.6f * x), std::min(0.75f, 1.5f - 1.4f * x), 0.15f};
  }

  static constexpr double kRecent = 1.0;       // largest age of an error that is shown [s]
  static constexpr double kMinWindow = 2.0;    // shortest window with well normalised errors [s]
  static constexpr double kFloorPeriod = 1.0;  // interval of floor maps [s]
  static constexpr double kMinPart = 0.01;     // smallest force shown, relative to full thrust
  static constexpr double kRedPart = 0.5;      // force shown in red, relative to full thrust

  CallbackThread callbacks_;
  std::mutex mutex_;  ///< guards config_ and the data of the callbacks
  Config config_;
  Model model_;
  std::deque<ground_msgs::State::ConstPtr> states_;
  ground_msgs::Controls::ConstPtr controls_;
  std::array<ground_msgs::ModelError::ConstPtr, 2> errors_;
  ground_msgs::ModelComparison::ConstPtr comparison_;
  FloorMap floor_{0.25};
  ros::Time last_update_, last_floor_;
  bool shown_ = false;
  ros::Publisher measured_publisher_, markers_publisher_, floor_publisher_, room_publisher_;
  ros::Subscriber state_subscriber_, controls_subscriber_, comparison_subscriber_;
  std::array<ros::Subscriber, 2> error_subscribers_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::Visualizer, nodelet::Nodelet)
