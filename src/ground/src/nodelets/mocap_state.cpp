#include <geometry_msgs/PoseStamped.h>
#include <ground/MocapStateConfig.h>
#include <ground_msgs/MocapSettings.h>
#include <ground_msgs/State.h>
#include <ground_msgs/Telemetry.h>
#include <nav_msgs/Odometry.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>
#include <xmlrpcpp/XmlRpcException.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdio>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <string>
#include <thread>
#include <vector>

#include "ground/estimation/axis_mapping.h"
#include "ground/estimation/frozen_pose.h"
#include "ground/estimation/velocity_estimator.h"
#include "ground/nodelets/background.h"
#include "ground/nodelets/inheriting_mutex.h"
#include "ground/nodelets/messages.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/real_time_threads.h"
#include "ground/nodelets/shell.h"
#include "ground/nodelets/time.h"

namespace ground {

/// Estimates the state of the craft from motion capture poses.
///
/// Parameters: real_time (false: ordinary priority; see wantsRealTime), axes ("x, z, -y": world_ned
/// in the mocap's axes), those of MocapState.cfg, which can be changed at run time, and recorded
/// (optional): the settings of a replayed run, a list of from
/// [s], axes and heading_offset [rad]. Each applies to poses stamped after `from`, the first also
/// to earlier ones. imu/gyro_scale, acceleration_scale, mounting, ahead, starboard, delay (0: no sensors;
/// see InertialMounting): the craft's gyro and accelerometer make velocities better, never valid.
/// Subscribes: vrpn_client_node/hovercraft/pose, sender/telemetry. Publishes: state, odometry,
/// ~settings (axes and heading_offset, latched), and on tf world -> world_ned (z down) ->
/// hovercraft.
///
/// Publishes no state for repeated and late poses, and for up to three consecutive impossible ones.
/// Restarts the estimate if ROS time is set. Publishes invalid states at 10 Hz if there are no
/// poses or the pose is frozen.
class MocapState : public Shell {
 public:
  ~MocapState() override {
    subscriber_.shutdown();
    {
      const std::lock_guard lock(mutex_);
      alive_ = false;
    }
    wake_.notify_all();
    if (thread_.joinable()) thread_.join();
  }

 private:
  using Config = MocapStateConfig;

  void start(ros::NodeHandle& nh, ros::NodeHandle& topics) override {
    real_time_ = wantsRealTime(nh);
    if (real_time_) callbacks_.prioritise(RealTimePriority::kEstimate);
    axes_ = optionalParameter<std::string>(nh, "axes", AxisMapping::kOptiTrack);
    loadRecorded(nh);
    mapping_ = AxisMapping(axes_);
    settings_publisher_ = nh.advertise<ground_msgs::MocapSettings>("settings", 1, true);
    state_publisher_ = topics.advertise<ground_msgs::State>("state", 4);
    odometry_publisher_ = topics.advertise<nav_msgs::Odometry>("odometry", 4);
    static_broadcaster_ = std::make_unique<tf2_ros::StaticTransformBroadcaster>();
    broadcaster_ = std::make_unique<tf2_ros::TransformBroadcaster>();
    geometry_msgs::TransformStamped down;  // z down: half a turn about x
    down.header.stamp = ros::Time::now();
    down.header.frame_id = "world";
    down.child_frame_id = "world_ned";
    down.transform.rotation.x = 1;
    static_broadcaster_->sendTransform(down);
    loadSensors(nh);
    reconfigure_ = std::make_unique<LiveParameters<Config>>(nh, [this](const Config& c) { apply(c); });
    thread_ = std::thread([this] { watch(); });
    sensors_ = topics.subscribe("sender/telemetry", 10, &MocapState::onTelemetry, this,
                                ros::TransportHints().tcpNoDelay());
    subscriber_ = topics.subscribe("vrpn_client_node/hovercraft/pose", 10, &MocapState::onPose, this,
                                   ros::TransportHints().tcpNoDelay());
  }

  void loadRecorded(ros::NodeHandle& nh) {
    XmlRpc::XmlRpcValue list;
    if (!nh.getParam("recorded", list)) return;
    const auto number = [](XmlRpc::XmlRpcValue& value) {
      const bool whole = value.getType() == XmlRpc::XmlRpcValue::TypeInt;
      return whole ? static_cast<double>(static_cast<int>(value)) : static_cast<double>(value);
    };
    try {
      for (int i = 0; i < list.size(); ++i) {
        XmlRpc::XmlRpcValue& entry = list[i];
        recorded_.push_back({number(entry["from"]), entry["axes"], number(entry["heading_offset"])});
        AxisMapping(recorded_.back().axes, recorded_.back().heading_offset);
      }
    } catch (const XmlRpc::XmlRpcException& error) {
      throw std::runtime_error("parameter recorded is not a list of from, axes and heading_offset: " +
                               error.getMessage());
    }
    if (recorded_.empty()) return;
    axes_ = recorded_.front().axes;
    nh.setParam("axes", axes_);
    nh.setParam("heading_offset", recorded_.front().heading_offset);
  }

  void loadSensors(ros::NodeHandle& nh) {
    InertialMounting mounting;
    mounting.gyro_scale = optionalParameter<double>(nh, "imu/gyro_scale", 0.0);
    mounting.acceleration_scale = optionalParameter<double>(nh, "imu/acceleration_scale", 0.0);
    mounting.mounting = optionalParameter<double>(nh, "imu/mounting", 0.0);
    mounting.ahead = optionalParameter<double>(nh, "imu/ahead", 0.0);
    mounting.starboard = optionalParameter<double>(nh, "imu/starboard", 0.0);
    mounting.delay = optionalParameter<double>(nh, "imu/delay", 0.0);
    for (const double value : {mounting.gyro_scale, mounting.acceleration_scale, mounting.mounting,
                               mounting.ahead, mounting.starboard, mounting.delay})
      if (!std::isfinite(value)) throw std::runtime_error("parameters imu/* must be finite");
    has_sensors_ = mounting.gyro_scale != 0;
    estimator_.inertial().setMounting(mounting);
  }

  void onTelemetry(const ground_msgs::Telemetry::ConstPtr& sample) {
    const std::lock_guard lock(mutex_);
    estimator_.inertial().sample(sample->header.stamp.toSec(), sample->gyro[2],
                                 {sample->acc[0], sample->acc[1]});
  }

  /// Logs that the craft's sensors begin or cease to count.
  void reportSensors() {
    const bool used = estimator_.inertial().agrees();
    if (!has_sensors_ || used == sensors_used_) return;
    sensors_used_ = used;
    const std::string name = "mocap_state: gyro and accelerometer ";
    if (used) log_.info(name + "agree with the poses; now used");
    if (!used) log_.warn(name + "do not count: " + estimator_.inertial().status());
  }

  /// Warns of poses that are noisier than their settings, once until these are set again.
  void reportNoise() {
    const InnovationScatter& found = estimator_.innovations();
    const double times = std::sqrt(std::max(found.excess(0), found.excess(2)));
    if (noisy_ || times < kNoisy) return;
    noisy_ = true;
    char text[160];
    std::snprintf(text, sizeof text,
                  "mocap_state: poses are %.1f times as noisy as position_noise and heading_noise; set these "
                  "to the noise that `identify info` prints",
                  times);
    log_.warn(text);
  }

  void apply(const Config& c) {
    const std::lock_guard lock(mutex_);
    estimator_.setParams(paramsIn<EstimatorParams>(c));
    noisy_ = false;
    if (c.heading_offset != wanted_offset_) measureBy(axes_, c.heading_offset);
    wanted_offset_ = c.heading_offset;
    timeout_ = c.timeout;
    max_age_ = c.max_age;
    freezes_ = c.freezes;
    upright_time_ = c.upright_time;
    wake_.notify_all();
  }

  /// Applies new settings from the next pose.
  void measureBy(const std::string& axes, double heading_offset) {
    mapping_ = AxisMapping(axes, heading_offset);
    axes_ = axes;
    estimator_.reset();
    auto settings = boost::make_shared<ground_msgs::MocapSettings>();
    settings->header.stamp = stamp_.isZero() ? ros::Time::now() : stamp_;
    settings->axes = axes;
    settings->heading_offset = heading_offset;
    settings_publisher_.publish(settings);
  }

  /// Applies the settings of the replayed run.
  void follow(double stamp) {
    std::size_t now = recorded_.size() - 1;
    while (now > 0 && stamp <= recorded_[now].from) --now;
    if (now == followed_) return;
    followed_ = now;
    measureBy(recorded_[now].axes, recorded_[now].heading_offset);
  }

  void onPose(const geometry_msgs::PoseStamped::ConstPtr& pose) {
    const std::lock_guard lock(mutex_);
    const std::string jump = time_watch_.look();
    if (!jump.empty()) {
      log_.warn("mocap_state: " + jump + ": the estimate restarts");
      estimator_.reset();
    }
    if (!recorded_.empty()) follow(pose->header.stamp.toSec());
    if (repeats(pose->pose)) return;
    const StateEstimate& estimate = take(*pose);
    if (!estimate.used && (estimate.ignored || estimate.valid)) {
      if (!estimate.ignored) reportRejection(estimate.status);
      return;
    }
    if (!pose->header.stamp.isZero()) stamp_ = pose->header.stamp;
    const bool was_stale = steadyNow() - last_pose_ > timeout_;
    last_pose_ = steadyNow();
    if (was_stale) wake_.notify_all();
    reportSensors();
    reportNoise();
    const std::string doubt = estimate.valid ? doubts() : estimate.status;
    publish(estimate, estimate.valid && doubt.empty(), doubt);
    if (estimate.used) publishOdometry(estimate);
  }

  /// Logs once a second at most.
  void reportRejection(const char* why) {
    const double now = steadyNow();
    if (now - rejection_logged_ < 1) return;
    rejection_logged_ = now;
    log_.warn(std::string("mocap_state: a pose is rejected: ") + why);
  }

  /// Whether a pose repeats the last one of a mocap that has lost the craft.
  bool repeats(const geometry_msgs::Pose& pose) {
    const bool same = frozen_.repeats({pose.position.x, pose.position.y, pose.position.z, pose.orientation.w,
                                       pose.orientation.x, pose.orientation.y, pose.orientation.z});
    return freezes_ && same;
  }

  /// Passes a pose to the estimator.
  const StateEstimate& take(const geometry_msgs::PoseStamped& pose) {
    const auto& p = pose.pose.position;
    const auto& q = pose.pose.orientation;
    const char* why = "the pose has no stamp";
    std::optional<Vector3<double>> eta;
    if (!pose.header.stamp.isZero()) eta = mapping_.toPlanar({p.x, p.y, p.z}, {q.w, q.x, q.y, q.z}, &why);
    const StateEstimate& estimate =
        eta ? estimator_.update(pose.header.stamp.toSec(), *eta) : estimator_.reject(why);
    if (why == AxisMapping::kLeans && !estimate.valid) leaned_ = steadyNow();
    return estimate;
  }

  /// Age of the newest pose [s]; 0 without ROS time or pose.
  double age() const {
    return ros::Time::isValid() && !stamp_.isZero() ? secondsBetween(stamp_, ros::Time::now()) : 0.0;
  }

  /// Why a state is invalid although the estimate is valid; empty if the state is valid.
  std::string doubts() const {
    // With wrong axes, a turning craft seems to lean and to be upright in turn. It must not be
    // driven again as soon as it seems to be upright, unlike a craft that was lost.
    if (last_pose_ - leaned_ < upright_time_) return "the craft leaned too far a moment ago";
    if (max_age_ == 0 || std::abs(age()) <= max_age_) return "";
    return age() > 0 ? "the pose's stamp is too old: the clocks differ, or the network is slow"
                     : "the pose's stamp is ahead of time: the clocks differ";
  }

  void publish(const StateEstimate& estimate, bool valid, const std::string& status) {
    auto state = inWorld<ground_msgs::State>(stamp_);
    for (int i = 0; i < 3; ++i) {
      state->eta[i] = estimate.eta(i);
      state->nu[i] = estimate.nu(i);
      state->nu_dot[i] = estimate.nu_dot(i);
      for (int j = 0; j < 3; ++j) state->nu_covariance[3 * i + j] = estimate.nu_covariance(i, j);
    }
    writePose(estimate.pose, *state);
    state->age = age();
    state->valid = valid;
    state->status = status;
    state_publisher_.publish(state);
    if (valid && !was_valid_) log_.info("mocap_state: the state is valid");
    if (!valid && was_valid_) log_.warn("mocap_state: the state is invalid: " + status);
    was_valid_ = valid;
  }

  void publishOdometry(const StateEstimate& estimate) {
    auto odometry = inWorld<nav_msgs::Odometry>(stamp_);
    odometry->child_frame_id = "hovercraft";
    odometry->pose.pose = poseOf(estimate.eta.x(), estimate.eta.y(), 0, estimate.eta.z());
    odometry->twist.twist.linear.x = estimate.nu.x();
    odometry->twist.twist.linear.y = estimate.nu.y();
    odometry->twist.twist.angular.z = estimate.nu.z();
    constexpr int kIndex[3] = {0, 1, 5};  // indices of x, y, psi and of u, v, r among six
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        const int index = 6 * kIndex[i] + kIndex[j];
        odometry->pose.covariance[index] = estimate.eta_covariance(i, j);
        odometry->twist.covariance[index] = estimate.nu_covariance(i, j);
      }
    }
    odometry_publisher_.publish(odometry);

    geometry_msgs::TransformStamped transform;
    transform.header = odometry->header;
    transform.child_frame_id = odometry->child_frame_id;
    transform.transform.translation.x = estimate.eta.x();
    transform.transform.translation.y = estimate.eta.y();
    transform.transform.rotation = odometry->pose.pose.orientation;
    broadcaster_->sendTransform(transform);
  }

  /// Publishes invalid states while there are no poses: at once and then at 10 Hz, steady clock.
  void watch() {
    if (real_time_) prioritise(RealTimePriority::kEstimate);
    std::unique_lock lock(mutex_);
    while (alive_) {
      const double left = last_pose_ + timeout_ - steadyNow();
      if (left > 0) {
        wake_.wait_for(lock, std::chrono::duration<double>(std::min(left, kLook)));
        continue;
      }
      StateEstimate last = estimator_.estimate();
      last.pose = PoseMeasurement();  // it is not new
      publish(last, false,
              last_pose_ == kNever           ? "no pose yet"
              : freezes_ && frozen_.frozen() ? "the pose is frozen"
                                             : "no pose for too long");
      wake_.wait_for(lock, std::chrono::milliseconds(100));
    }
  }

  static constexpr double kLook = 0.02;  // longest interval of reading the clock [s]
  static constexpr double kNoisy = 1.7;  // scatter of poses relative to their settings that is reported
  static constexpr double kNever = -std::numeric_limits<double>::infinity();

  Background log_;
  InheritingMutex mutex_;  ///< guards all data below
  /// Settings of a recorded run.
  struct Recorded {
    double from;  ///< applies to poses stamped later [s]
    std::string axes;
    double heading_offset;  ///< [rad]
  };
  std::vector<Recorded> recorded_;  ///< settings of the replayed run; empty without one
  std::size_t followed_ = 0;        ///< index of the current settings in `recorded_`
  std::string axes_;
  double wanted_offset_ = std::numeric_limits<double>::quiet_NaN();  ///< parameter heading_offset
  AxisMapping mapping_;
  VelocityEstimator estimator_{EstimatorParams()};
  RosTimeWatch time_watch_;
  // Times of the steady clock [s]
  double timeout_ = 0, upright_time_ = 0, last_pose_ = kNever, rejection_logged_ = kNever;
  double leaned_ = kNever;  ///< last time at which the craft leaned for several poses
  double max_age_ = 0;      ///< [s]; 0: any
  bool freezes_ = true;
  FrozenPose frozen_;
  ros::Time stamp_;  ///< stamp of the newest pose
  bool alive_ = true;
  bool real_time_ = false;  ///< constant after start()
  bool was_valid_ = false;
  std::condition_variable_any wake_;
  std::thread thread_;
  std::unique_ptr<tf2_ros::StaticTransformBroadcaster> static_broadcaster_;
  std::unique_ptr<tf2_ros::TransformBroadcaster> broadcaster_;
  ros::Publisher state_publisher_, odometry_publisher_, settings_publisher_;
  ros::Subscriber subscriber_, sensors_;
  bool has_sensors_ = false, sensors_used_ = false, noisy_ = false;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::MocapState, nodelet::Nodelet)
