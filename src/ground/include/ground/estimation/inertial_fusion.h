#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "ground/estimation/motion_filter.h"
#include "ground/model/pose_measurement.h"
#include "ground/model/types.h"

namespace ground {

/// How a craft's gyro and accelerometer measure, as `identify info` finds it in recordings.
struct InertialMounting {
  double gyro_scale = 0;          ///< [rad/s] of a unit, negative if z points up; 0: the sensors are not used
  double acceleration_scale = 0;  ///< [m/s^2] of a unit; 0: only the gyro is used
  double mounting = 0;            ///< angle of the sensor in the frame of the poses [rad]
  double ahead = 0, starboard = 0;  ///< place, from the markers [m]
  double delay = 0;                 ///< of the samples after the poses [s]
};

/// Velocities from poses and the craft's gyro and accelerometer, beside the filter that has the poses alone.
///
/// The filter of the poses decides alone whether a state is valid. It also gives the sensors' biases, as
/// what makes them agree with it over seconds. Its velocities replace these after a second in which the
/// two agree within its own uncertainty, and at once when they do not, or samples are missing. No allocation
/// after construction.
class InertialFusion {
 public:
  void setMounting(const InertialMounting& mounting);
  /// Adds a sample, in the sensor's units, at its stamp [s]. One that is not finite or late is ignored.
  void sample(double stamp, double gyro, const Vector2<double>& acceleration);
  void restart();
  /// Follows `by_poses`, which has just been corrected by a pose.
  void update(double stamp, const Vector3<double>& eta, const MotionFilter& by_poses,
              const EstimatorParams& params);
  /// Whether motion() is to be used for the last pose.
  bool agrees() const { return following_ && agreed_ >= kAgreement; }
  const MotionFilter& motion() const { return motion_; }
  /// What was measured up to the last pose; nothing unless agrees().
  std::optional<InertialMeasurement> measurement() const { return agrees() ? measured_ : std::nullopt; }
  /// Why sensors that are mounted are not used; empty if they are.
  const char* status() const { return status_; }

 private:
  struct Sample {
    double stamp, gyro;
    Vector2<double> acceleration;
  };
  static constexpr double kAgreement = 1;  ///< time for which both filters agree before it counts [s]

  /// Stops following; `why` must outlive this.
  void stop(const char* why);
  /// Acceleration of the sensor ahead and to starboard, and yaw rate, with their biases.
  Vector3<double> measuredBy(const Sample& sample) const;
  void correctBy(const Sample& sample);
  void integrate(double stamp, const Vector3<double>& felt);
  void beginSpan(double stamp, const Vector3<double>& felt);
  void endSpan(double stamp, double span, const Sample* next);
  void learnBias(const MotionFilter& by_poses, double dt);
  void compare(const MotionFilter& by_poses, double dt);
  Vector2<double> atMarkers(const Vector2<double>& acceleration) const;

  InertialMounting mounting_;
  std::array<Sample, 64> samples_{};
  std::size_t count_ = 0;
  MotionFilter motion_;
  bool following_ = false;
  double agreed_ = 0;                  ///< time since the filters disagreed [s]
  double learned_ = 0;                 ///< time over which biases were learned [s]
  double distance_ = 0;   ///< mean squared distance of the filters in the last moments, per component
  double turn_bias_ = 0;  ///< [rad/s]
  Vector2<double> bias_ = Vector2<double>::Zero();  ///< body [m/s^2]
  // Sums over the samples since the last pose:
  double turns_ = 0;
  Vector2<double> pushes_ = Vector2<double>::Zero();
  int summed_ = 0;
  // Of measuredBy():
  Vector3<double> felt_ = Vector3<double>::Zero();    ///< at the time felt_at_
  Vector3<double> change_ = Vector3<double>::Zero();  ///< integral from the last pose to felt_at_
  double outward_ = 0;                                ///< integral of the yaw rate's square
  double felt_at_ = 0, began_rate_ = 0;               ///< [s]; yaw rate at the last pose [rad/s]
  std::optional<InertialMeasurement> measured_;       ///< up to the last pose
  const char* status_ = "no samples yet";
};

}  // namespace ground
