// Recordings, windows of recordings, and simulations of windows.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "ground/model/simulation.h"

namespace ground {

/// Samples of a gyro and an accelerometer that are turned into the frame of the measured poses, on the
/// clock of the run, without bias and delay.
struct InertialData {
  std::vector<double> times;  ///< ascending [s]
  /// Yaw rate [rad/s], specific force ahead and to starboard [m/s^2] at `place`, a row a sample.
  Eigen::MatrixX3d values = {};
  Vector3<double> noise = {2e-3, 0.05, 0.05};  ///< standard deviations of a sample [rad/s], [m/s^2]
  Vector2<double> place = {0, 0};              ///< from the measured point, ahead and to starboard [m]

  bool empty() const { return times.empty(); }
};

/// Scales of a run that follow from its poses and its craft.
struct RunScales {
  double max_gap = 0.1;       ///< longest time between poses that is bridged [s]
  double linear_jerk = 5;     ///< by which the poses were smoothed: EstimatorParams [m/s^2.5]
  double angular_jerk = 120;  ///< the same of the heading [rad/s^2.5]
  double window = 1.5;        ///< length of the windows over which errors are taken [s]
};

/// One recording: measurements and commands, on a clock that is 0 at the start of the run.
struct RunData {
  std::string name;
  std::vector<double> times;                   ///< times of the measurements, ascending [s]
  Eigen::MatrixX3d eta;                        ///< x, y [m], psi unwrapped [rad], world_ned, smoothed
  Eigen::MatrixX3d nu;                         ///< u, v [m/s], r [rad/s], body
  InputSequence inputs;                        ///< in the model's units; its drive clock gives the model's t
  Eigen::MatrixX3d poses;                      ///< eta as measured, not smoothed; empty: eta is used instead
  Vector3<double> noise = {4e-4, 4e-4, 6e-3};  ///< standard deviations of the poses [m], [rad]
  /// Known wrench X, Y [N], N [N m], body, that acts beside the model, each row until the next sample;
  /// empty: none. Only GreyBox takes one.
  Eigen::MatrixX3d wrench = {};
  InertialData inertial = {};  ///< empty: none. Only GreyBox uses it.
  Payload payload = {};        ///< what the craft carried
  RunScales scales = {};
};

/// The smoothed motion of a run.
inline Motion motionOf(const RunData& run) { return {&run.times, &run.eta, &run.nu}; }

/// Throws std::invalid_argument unless a run has samples, arrays of equal length, finite measurements
/// at finite ascending times, a positive noise, positive scales, no known wrench or a finite one, and the
/// same of what is inertial.
void checkRun(const RunData& run);

/// A stretch of a run that is simulated from its own initial state.
struct Window {
  int run;          ///< index into the runs of a problem
  int first, last;  ///< first and last sample
};

/// Cuts the part [from, to] s of a run into windows of `length` seconds that share their end
/// points. Drops a last piece of half a window or less. Windows do not contain gaps in the measurements
/// longer than `max_gap` seconds (default: the run's). Throws std::invalid_argument if checkRun(run)
/// does, a time is NaN, or the length or the gap is not positive.
std::vector<Window> cutWindows(const RunData& run, int run_index, double from, double to, double length,
                               std::optional<double> max_gap = std::nullopt);

/// Simulated measurements of poses and velocities of windows, at the samples of their runs.
struct WindowSimulation {
  std::vector<Eigen::MatrixX3d> eta, nu;  ///< per window, one row a sample
};

}  // namespace ground
