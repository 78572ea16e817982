#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <string>

#include "ground/model/types.h"

namespace ground {

/// Converts between the mocap's frame and world_ned (x, y on the floor, z down).
class AxisMapping {
 public:
  /// OptiTrack's frame, y up: x = x_ot, y = z_ot, z = -y_ot.
  static constexpr const char* kOptiTrack = "x, z, -y";
  /// Message of toPlanar() for a craft that leans by more than 30 degrees.
  static const char* const kLeans;

  /// `axes`: x, y and z of world_ned in terms of the mocap's axes, such as "x, z, -y".
  /// `heading_offset` [rad]: rotation of the mocap's rigid body relative to the craft, measured
  /// minus true heading. Throws std::invalid_argument unless the axes form a right-handed frame.
  explicit AxisMapping(const std::string& axes = kOptiTrack, double heading_offset = 0.0);

  /// x, y [m], psi [rad] in world_ned from a pose in the mocap's frame. Returns nothing, with the
  /// reason in `why`, if the pose is not finite, its quaternion is not normalised or the craft
  /// leans by more than 30 degrees.
  std::optional<Vector3<double>> toPlanar(const Eigen::Vector3d& position,
                                          const Eigen::Quaterniond& orientation,
                                          const char** why = nullptr) const;
  /// The pose in the mocap's frame of a craft at eta (world_ned), `height` [m] above the floor.
  void toMocap(const Vector3<double>& eta, double height, Eigen::Vector3d& position,
               Eigen::Quaterniond& orientation) const;

 private:
  Eigen::Matrix3d to_world_;  ///< mocap's frame to world_ned; the same for body axes
  double heading_offset_;
};

}  // namespace ground
