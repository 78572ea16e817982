// The thesis's artificial data (3.3.2), for the tests of the fit and the benchmark.
#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "ground/control/input_design.h"
#include "ground/identification/simulation_error.h"
#include "ground/model/model_file.h"

namespace ground {

inline const std::vector<std::string> kNominal = {"I_z", "X_u", "Y_v", "N_r", "k"};

inline Model with(const std::vector<double>& five) {
  Model model = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  for (std::size_t i = 0; i < kNominal.size(); ++i) model.setValue(kNominal[i], five[i]);
  return model;
}

inline Model truth() { return with({1e-3, 5e-2, 5e-2, 1e-3, 0.1}); }  // table 3.1
inline Model start() { return with({0.2, 0.2, 0.2, 0.2, 0.2}); }

/// PRBS {0, 1} at 20 Hz from rest, sampled at 100 Hz. The noise is independent in each channel,
/// with epsilon times the standard deviation of the velocity. (As printed, (3.5) divides by sigma
/// and has the same random number in all channels.) `memory` is the noise's correlation between
/// samples.
inline RunData record(const Model& model, double duration, double epsilon, unsigned seed, double memory = 0) {
  PrbsParams params;
  params.clock = 20;
  params.duration = duration;
  const InputSignal prbs = playBits({makePrbs(9, seed), 1}, params);
  RunData run;
  run.name = "artificial";
  for (double t = 0; t < duration; t = prbs.nextChange(t)) run.inputs.add(t, prbs.at(t).thrusters, 1);
  const Dynamics<double> dynamics(model);
  Simulation<double> simulation(dynamics, run.inputs, {}, 0);
  const int samples = static_cast<int>(duration * 100) + 1;
  run.eta.resize(samples, 3);
  run.nu.resize(samples, 3);
  for (int i = 0; i < samples; ++i) {
    run.times.push_back(i * 0.01);
    simulation.advance(i * 0.01);
    run.eta.row(i) = simulation.measure().eta;
    run.nu.row(i) = simulation.measure().nu;
  }
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const Vector3<double> mean = run.nu.colwise().mean();
  const Vector3<double> sigma =
      (run.nu.rowwise() - mean.transpose()).array().square().colwise().mean().sqrt();
  Vector3<double> noise = Vector3<double>::Zero();
  for (int i = 0; i < samples; ++i) {
    for (int c = 0; c < 3; ++c)
      noise(c) =
          (i > 0 ? memory : 0) * noise(c) + (i > 0 ? std::sqrt(1 - memory * memory) : 1) * normal(random);
    run.nu.row(i) += epsilon * sigma.cwiseProduct(noise);
  }
  return run;
}

/// A spin without thrust and with noise, which identifies only the ratio N_r / I_z in yaw.
inline RunData spinningRun() {
  RunData run = record(truth(), 4, 0, 1);
  run.inputs = InputSequence();
  run.inputs.add(0, 0, 0, 1);
  const Model spinning = truth();
  const Dynamics<double> dynamics(spinning);
  RigidState<double> initial;
  initial.nu << 0.5, 0.3, 6;
  Simulation<double> simulation(dynamics, run.inputs, initial, 0);
  std::mt19937 random(1);
  std::normal_distribution<double> normal(0, 0.01);
  for (std::size_t i = 0; i < run.times.size(); ++i) {
    simulation.advance(run.times[i]);
    run.eta.row(static_cast<Eigen::Index>(i)) = simulation.measure().eta;
    run.nu.row(static_cast<Eigen::Index>(i)) = simulation.measure().nu;
    for (int c = 0; c < 3; ++c) run.nu(static_cast<Eigen::Index>(i), c) += normal(random);
  }
  return run;
}

inline SimulationError problem(const RunData& run, double window = 4.0) {
  return SimulationError({run}, cutWindows(run, 0, 0, 1e9, window));
}

inline FitOptions options(FitOptions::Objective objective = FitOptions::Objective::kLeastSquares) {
  FitOptions o;
  o.free = kNominal;
  o.objective = objective;
  return o;
}

/// Largest relative error of a parameter.
inline double worst(const FitResult& result) {
  double largest = 0;
  for (const FittedParameter& p : result.parameters)
    largest = std::max(largest, std::abs(p.value / truth().value(p.name) - 1));
  return largest;
}

/// Number of 95% intervals that hold the truth.
struct Coverage {
  int covered = 0, intervals = 0;

  void add(const FitResult& fit) {
    for (const FittedParameter& p : fit.parameters) {
      ++intervals;
      covered += p.lower <= truth().value(p.name) && truth().value(p.name) <= p.upper;
    }
  }
  double percent() const { return 100.0 * covered / intervals; }
};

/// One row of table 3.1, over many PRBS sequences and draws of noise.
struct NoiseStudy {
  double median, largest;  ///< over the runs, of the largest relative error of a parameter
  Coverage coverage;
};

inline NoiseStudy studyNoise(double epsilon, unsigned seeds, FitOptions::Objective objective) {
  NoiseStudy study;
  std::vector<double> errors;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    const FitResult fit = problem(record(truth(), 4, epsilon, seed)).fit(start(), options(objective));
    errors.push_back(worst(fit));
    study.coverage.add(fit);
  }
  std::sort(errors.begin(), errors.end());
  study.median = errors[errors.size() / 2];
  study.largest = errors.back();
  return study;
}

}  // namespace ground
