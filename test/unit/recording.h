#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "ground/control/input_design.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"

namespace ground {

/// Poses of the Tiny Whoover driven by a 15 Hz PRBS from rest, with mocap noise, and the truth.
struct Recording {
  static constexpr double kTruthStep = 1e-3;

  std::vector<double> stamps;             ///< [s]
  std::vector<Vector3<double>> eta;       ///< measured: x, y [m], wrapped psi [rad]
  std::vector<RigidState<double>> truth;  ///< every kTruthStep from time 0
  std::vector<Vector3<double>> nu_dot;    ///< true accelerations at the same times

  /// True velocities at time t [s].
  Vector3<double> nu(double t) const {
    const double i = std::clamp(t / kTruthStep, 0.0, truth.size() - 1.001);
    const auto k = static_cast<std::size_t>(i);
    return truth[k].nu + (i - k) * (truth[k + 1].nu - truth[k].nu);
  }
};

struct RecordingParams {
  double duration = 8.0;         ///< [s]
  double rate = 100.0;           ///< [Hz]
  double position_noise = 5e-4;  ///< [m]
  double heading_noise = 0.3 * M_PI / 180;
  double gap = 0.0;         ///< length of a loss of tracking every two seconds [s]
  double duplicates = 0.0;  ///< share of poses that are repeated with the same stamp, 0..1
};

inline Recording record(const RecordingParams& params, unsigned long seed) {
  const Model model = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  const Dynamics<double> dynamics(model);
  PrbsParams prbs;
  prbs.duration = params.duration;
  const InputSignal signal = playBits({makePrbs(9, 37 * seed), 1}, prbs);
  InputSequence inputs;
  for (double t = 0; t < params.duration; t = signal.nextChange(t))
    inputs.add(t, signal.at(t).thrusters, 1.0);
  Recording recording;
  RigidState<double> rest;
  rest.eta << 0.3, -0.2, 2.5;
  Simulation<double> simulation(dynamics, inputs, rest, 0.0, Recording::kTruthStep);
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const int stride = static_cast<int>(std::lround(1 / params.rate / Recording::kTruthStep));
  const int count = static_cast<int>(std::lround(params.duration / Recording::kTruthStep));
  for (int i = 0; i < count; ++i) {
    const double t = i * Recording::kTruthStep;
    simulation.advance(t);
    recording.truth.push_back(simulation.state());
    recording.nu_dot.push_back(simulation.derivative().nu);
    if (i % stride != 0 || std::fmod(t + 1, 2.0) < params.gap) continue;
    const int times = uniform(random) < params.duplicates ? 2 : 1;
    for (int j = 0; j < times; ++j) {
      Vector3<double> eta = simulation.state().eta;
      eta.x() += params.position_noise * normal(random);
      eta.y() += params.position_noise * normal(random);
      eta.z() = wrapAngle(eta.z() + params.heading_noise * normal(random));
      recording.stamps.push_back(t);
      recording.eta.push_back(eta);
    }
  }
  return recording;
}

}  // namespace ground
