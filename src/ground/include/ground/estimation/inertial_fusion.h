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

/// The motion by poses and the craft's gyro and accelerometer: a second MotionFilter, which takes the
/// samples, too.
///
/// The filter of the poses alone decides whether a state is valid. It also gives the sensors' biases: what
/// makes them agree with it over seconds. Its velocities are replaced while the sensors do not make the
/// predictions of poses worse, after a second of that; at once no longer when they do, or when samples are
/// missing. No allocation after construction.
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
  void integrate(double stamp, const Vector3<double>& measured);
  void beginSpan(double stamp, const Vector3<double>& measured);
  void endSpan(double stamp, double span, const Sample* next);
  void learnBias(const MotionFilter& by_poses, double dt);
  void compare(const MotionFilter& by_poses, double dt);
  Vector2<double> lever(double outward, double turn) const;

  InertialMounting mounting_;
  std::array<Sample, 64> samples_{};
  std::size_t count_ = 0;
  MotionFilter motion_;
  bool following_ = false;
  double agreed_ = 0;                               ///< time since the sensors made predictions worse [s]
  double learned_ = 0;                              ///< time over which biases were learned [s]
  double with_ = 0, without_ = 0;                   ///< mean squared innovation of poses in the last moments
  Vector3<double> bias_ = Vector3<double>::Zero();  ///< body [m/s^2, m/s^2, rad/s]
  // What measuredBy() gave since the last pose, whose stamp is began_ [s]:
  double began_ = 0, began_rate_ = 0;                 ///< yaw rate at the pose [rad/s]
  Vector3<double> last_ = Vector3<double>::Zero();    ///< at last_stamp_
  double last_stamp_ = 0;                             ///< [s]
  Vector3<double> change_ = Vector3<double>::Zero();  ///< integral up to last_stamp_
  double outward_ = 0;                                ///< integral of the yaw rate's square
  std::optional<InertialMeasurement> measured_;       ///< up to the last pose
  const char* status_ = "no samples yet";
};

}  // namespace ground
