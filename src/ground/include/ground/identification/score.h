#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "ground/identification/simulation_error.h"

namespace ground {

/// The robust cost of a simulation around a model, to first and second order in some parameters:
/// all that score tests (Rao 1948) need. Initial states follow along: they are projected out of
/// each window.
struct Scores {
  std::vector<double> scale;  ///< of the parameters' coordinates; scores are by coordinate / scale
  std::vector<double> cost;   ///< of each window: half the sum of its losses
  std::vector<int> window;    ///< of each block
  std::vector<Eigen::VectorXd> initial;  ///< states of the windows
  Eigen::MatrixXd score;                 ///< minus the cost's derivatives, one row a block
  Eigen::MatrixXd information;           ///< second derivatives of the whole (Gauss-Newton)
};

/// Simulates all windows with the initial states that suit the model best, or with given ones, and
/// derives their cost by the named parameters (none: costs only). A window is split into blocks of
/// about `block` seconds; `width` is that of FitOptions. Throws std::runtime_error when a
/// simulation is not finite, std::invalid_argument on an unknown parameter.
Scores scores(const SimulationError& problem, const Model& model,
              const std::vector<std::string>& parameters, double width, double block, int threads,
              const std::vector<Eigen::VectorXd>& initial = {});

/// Noise of the poses and the disturbance beside the model, of each run: those under which the
/// innovations of its windows (Whitening), simulated by the model, are likeliest; by their M-scale,
/// so that outliers weigh little. Poses have to be the target.
struct NoiseLevels {
  Vector3<double> noise, disturbance;
  /// Log-likelihood ratio 2 (L1 - L0) against no disturbance: of x and y together, and of psi.
  /// About chi squared with one degree of freedom, or zero half of the time, when the model is
  /// true.
  double gain[2] = {0, 0};
};
std::vector<NoiseLevels> likeliestDisturbance(const SimulationError& problem, const Model& model,
                                              double width, int threads);

}  // namespace ground
