#pragma once

#include <geometry_msgs/PoseStamped.h>
#include <ground_msgs/State.h>
#include <ground_msgs/Telemetry.h>
#include <nav_msgs/Path.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <optional>
#include <string>

#include "ground/model/pose_measurement.h"
#include "ground/model/types.h"
#include "ground/safety/fence_guard.h"

namespace ground {

inline RigidState<double> stateIn(const ground_msgs::State& message) {
  RigidState<double> state;
  std::copy(message.eta.begin(), message.eta.end(), state.eta.data());
  std::copy(message.nu.begin(), message.nu.end(), state.nu.data());
  return state;
}

/// The pose of a message as it was measured, if it has one.
inline PoseMeasurement poseIn(const ground_msgs::State& message) {
  PoseMeasurement measured;
  std::copy(message.pose_covariance.begin(), message.pose_covariance.end(), measured.covariance.data());
  if (measured.covariance.isZero()) return measured;
  std::copy(message.pose.begin(), message.pose.end(), measured.eta.data());
  if (message.inertial_variance[2] == 0) return measured;
  InertialMeasurement& inertial = measured.inertial.emplace();
  inertial.acceleration << message.inertial[0], message.inertial[1];
  inertial.yaw_rate = message.inertial[2];
  std::copy(message.inertial_variance.begin(), message.inertial_variance.end(), inertial.variance.data());
  inertial.span = message.inertial_span;
  return measured;
}

inline void writePose(const PoseMeasurement& measured, ground_msgs::State& message) {
  if (!measured.eta.allFinite()) return;
  std::copy_n(measured.eta.data(), 3, message.pose.begin());
  std::copy_n(measured.covariance.data(), 9, message.pose_covariance.begin());
  if (!measured.inertial) return;
  message.inertial = {measured.inertial->acceleration.x(), measured.inertial->acceleration.y(),
                      measured.inertial->yaw_rate};
  std::copy_n(measured.inertial->variance.data(), 3, message.inertial_variance.begin());
  message.inertial_span = measured.inertial->span;
}

/// `stamp`: stamp of the message, on the clock of the caller [s].
inline MeasuredState measuredState(const ground_msgs::State& message, double stamp) {
  MeasuredState measured;
  measured.stamp = stamp;
  measured.state = stateIn(message);
  for (int i = 0; i < 3; ++i)
    measured.nu_variance(i) = message.nu_covariance[static_cast<std::size_t>(4 * i)];
  measured.pose = poseIn(message);
  measured.valid = message.valid;
  measured.problem = message.status;
  return measured;
}

/// The voltage of the battery [V], where the craft measures one.
inline std::optional<double> voltageIn(const ground_msgs::Telemetry& message) {
  const double volts = message.voltage;
  return std::isfinite(volts) && volts > 0 ? std::optional(volts) : std::nullopt;
}

inline bool isFinite(const RigidState<double>& state) {
  return state.eta.allFinite() && state.nu.allFinite();
}

inline geometry_msgs::Quaternion headingOf(double psi) {
  geometry_msgs::Quaternion q;
  q.z = std::sin(psi / 2);
  q.w = std::cos(psi / 2);
  return q;
}

inline geometry_msgs::Pose poseOf(double x, double y, double z, double psi) {
  geometry_msgs::Pose pose;
  pose.position.x = x;
  pose.position.y = y;
  pose.position.z = z;
  pose.orientation = headingOf(psi);
  return pose;
}

/// A message with this stamp in world_ned.
template <class Message>
boost::shared_ptr<Message> inWorld(const ros::Time& stamp) {
  auto message = boost::make_shared<Message>();
  message->header.stamp = stamp;
  message->header.frame_id = "world_ned";
  return message;
}

inline void addPose(nav_msgs::Path& path, const ros::Time& stamp, const geometry_msgs::Pose& pose) {
  path.poses.emplace_back();
  path.poses.back().header = path.header;
  path.poses.back().header.stamp = stamp;
  path.poses.back().pose = pose;
}

}  // namespace ground
