// Recordings of a craft with a known disturbance, for the tests of the stochastic likelihood.
#pragma once

#include <algorithm>
#include <random>
#include <string>
#include <vector>

#include "artificial_run.h"
#include "ground/identification/grey_box.h"
#include "ground/model/typical.h"
#include "ground/simulation/disturbance_source.h"

namespace ground {

inline constexpr double kPosition = 3e-4, kHeading = 5e-3;  // noise of the poses [m], [rad]

inline Model craft() { return loadModel("cfg/hovercraft/tiny_whoover.yaml"); }

/// Disturbance with sigma a share of full thrust, correlated over 0.3 s, and trims of half of it.
inline Disturbance pushes(const Model& model, double share) {
  Disturbance disturbance;
  const double force = typical::force(model.body), moment = typical::moment(model.body);
  disturbance.sigma = share * Vector3<double>(force, force, moment);
  disturbance.time.setConstant(0.3);
  disturbance.trim = 0.5 * disturbance.sigma;
  return disturbance;
}

/// A force along the axes of the room: deviation of each component [N], correlation time [s].
struct Draught {
  double sigma = 0, time = 1;
};

/// Poses at 120 Hz of the model with a disturbance in steps of 1 ms.
inline RunData disturbedRun(const Model& model, const Disturbance& disturbance, unsigned seed,
                            double duration = 8, const Draught& draught = {}) {
  constexpr double kStep = 1e-3;
  PrbsParams params;
  params.clock = 10;
  params.duration = duration;
  const InputSignal prbs = playBits({makePrbs(9, seed), 1}, params);
  RunData run;
  run.name = "disturbed";
  run.noise = {kPosition, kPosition, kHeading};
  for (double t = 0; t < duration; t = prbs.nextChange(t)) run.inputs.add(t, prbs.at(t).thrusters, 1);
  DisturbanceSource source(disturbance, kStep, seed);
  Disturbance in_room;
  in_room.sigma << draught.sigma, draught.sigma, 0;
  in_room.time.setConstant(draught.time);
  DisturbanceSource force(in_room, kStep, seed + 1000);
  const Dynamics<double> dynamics(model);
  Simulation<double> simulation(dynamics, run.inputs, {}, 0);
  const Vector3<double> over(1 / model.body.m, 1 / model.body.m, 1 / model.body.I_z);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto samples = static_cast<Eigen::Index>(duration * 120);
  run.eta.resize(samples, 3);
  run.nu.resize(samples, 3);
  run.poses.resize(samples, 3);
  for (Eigen::Index i = 0; i < samples; ++i) {
    const double time = static_cast<double>(i) / 120;
    while (simulation.time() < time - 1e-9) {
      const double step = std::min(kStep, time - simulation.time());
      Vector3<double> wrench = source.next();
      const Vector2<double> push = force.next().head<2>();
      wrench.head<2>() += worldToBody(simulation.state().eta.z(), push);
      simulation.state().nu += step * over.cwiseProduct(wrench);
      simulation.advance(simulation.time() + step);
    }
    run.times.push_back(time);
    run.eta.row(i) = simulation.state().eta;
    run.nu.row(i) = simulation.state().nu;
    run.poses.row(i) = simulation.state().eta;
    for (int c = 0; c < 3; ++c) run.poses(i, c) += run.noise(c) * normal(random);
  }
  return run;
}

inline std::vector<RunData> disturbedRuns(const Model& model, double share, int count, unsigned seed = 1) {
  std::vector<RunData> runs;
  for (int i = 0; i < count; ++i)
    runs.push_back(disturbedRun(model, pushes(model, share), seed + static_cast<unsigned>(i)));
  return runs;
}

/// Options for a start far from the optimum.
inline GreyBoxOptions cold(std::vector<std::string> free = kNominal) {
  GreyBoxOptions options;
  options.free = std::move(free);
  return options;
}

}  // namespace ground
