// Recordings, windows of them, and what a model makes of windows.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "ground/model/simulation.h"

namespace ground {

/// One recording: what was measured and what was commanded, on one clock that starts at the run's
/// start.
struct RunData {
  std::string name;
  std::vector<double> times;  ///< of the measurements, ascending [s]
  Eigen::MatrixX3d eta;       ///< x, y [m], psi unwrapped [rad], world_ned, smoothed
  Eigen::MatrixX3d nu;        ///< u, v [m/s], r [rad/s], body
  InputSequence inputs;       ///< in the model's units; its drive clock gives the model's t
  Eigen::MatrixX3d poses;     ///< the same as eta, as measured; as many as eta, or none: eta then
  Vector3<double> noise = {4e-4, 4e-4, 6e-3};  ///< standard deviations of the poses [m], [rad]
};

/// A stretch of a run that is simulated from an initial state of its own.
struct Window {
  int run;          ///< index into the runs of a problem
  int first, last;  ///< first and last sample
};

/// Cuts the part [from, to] s of a run into windows of `length` seconds that share their end
/// points; a last piece of half a window or less is left out. Windows do not reach over gaps longer
/// than `max_gap` seconds in the measurements. Throws std::invalid_argument unless the length is
/// positive.
std::vector<Window> cutWindows(const RunData& run, int run_index, double from, double to,
                               double length, double max_gap = 0.1);

/// Simulated poses and velocities of windows at the samples of their runs, as the mocap sees them.
struct WindowSimulation {
  std::vector<Eigen::MatrixX3d> eta, nu;  ///< per window, one row a sample
};

}  // namespace ground
