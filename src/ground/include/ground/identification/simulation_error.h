#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "ground/identification/run_data.h"

namespace ground {

/// What is known of a parameter before a fit: its mean and standard deviation, in its unit.
struct ParameterPrior {
  std::string name;
  double mean, deviation;
};

/// Options of a fit.
struct FitOptions {
  enum class Objective {
    kLeastSquares,  ///< weighted least squares with a robust loss
    kThesis         ///< weighted absolute errors, (3.4)
  };
  std::vector<std::string> free;  ///< names of the free parameters
  std::vector<std::string> kept;  ///< free parameters that are not identifiable: they keep the model's values
  Objective objective = Objective::kLeastSquares;
  int starts = 1;  ///< number of starts, including the model's values
  int max_iterations = 200;
  int threads = 0;    ///< 0: all cores
  bool warm = false;  ///< the model's values are near the solution: skips the fit of short pieces
  /// Residual beyond which the robust loss grows as the absolute value; 0 means twice the deviation
  /// of the residuals. The costs of two fits are comparable only for equal widths.
  double width = 0;
  /// What is known of free parameters. It counts as much as data that determine them as well: squared
  /// residuals are correlated, and are scaled by a magnitude adjustment (Pauli, Racugno and Ventura,
  /// Bayesian composite marginal likelihoods, Stat. Sinica 21 (2011)).
  std::vector<ParameterPrior> priors;
  /// Initial states of the windows to start from, as in FitResult; empty means the measured ones.
  std::vector<Eigen::VectorXd> initial;
};

struct FittedParameter {
  std::string name, unit;
  double start, value, lower, upper;  ///< lower, upper: 95% interval
  double deviation;                   ///< standard deviation of the estimate; infinite if not identified
  bool at_bound;
  bool identified;  ///< false: not identifiable from the data, the interval is its whole range
};

struct FitResult {
  Model model;  ///< with the fitted values
  std::vector<FittedParameter> parameters;
  Eigen::MatrixXd correlation;           ///< correlation matrix of the estimates
  double condition = 0;                  ///< condition number of the scaled information matrix
  double objective = 0;                  ///< mean of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r at the end
  double width = 0;                      ///< width of the last robust loss
  std::vector<Eigen::VectorXd> initial;  ///< initial states of the windows
  /// The model as it would be if the mean of one of the priors were a deviation more, for each of them.
  std::vector<Model> shifted;
  int starts = 0;          ///< starts that could be simulated
  int starts_at_best = 0;  ///< starts that converged to the best solution
  double freedom = 1;      ///< degrees of freedom of Student's t of the intervals
  int iterations = 0;
  bool converged = false;
};

/// The measurements that a simulation is compared with.
enum class Target {
  kVelocities,  ///< velocities, each divided by its standard deviation in the run
  kPoses        ///< poses, each divided by the run's noise; poses are not differentiated
};

/// The difference between simulation and measurement over windows of runs (thesis 3.3). The initial
/// velocity of each window is free. Its initial pose is the measured one, or free if poses are the
/// target. See identification.h for an example.
///
/// The error of long windows has many local minima, and random disturbances add up in them; short windows say
/// little about slow effects. RunScales::window is a good length. Free parameters that the runs do not
/// identify keep the model's values, and are marked.
class SimulationError {
 public:
  /// Throws std::invalid_argument if there is no window, the craft does not move in a run, or
  /// checkRun() refuses one.
  SimulationError(std::vector<RunData> runs, std::vector<Window> windows,
                  Target target = Target::kVelocities);

  /// Fits the free parameters of a model and the windows' initial states. Throws
  /// std::invalid_argument on invalid options, std::runtime_error if the model cannot be simulated
  /// at its start values.
  FitResult fit(const Model& model, const FitOptions& options) const;

  /// Simulates every window with the initial states that minimise the objective. Throws
  /// std::runtime_error if the model cannot be simulated.
  WindowSimulation simulate(const Model& model,
                            FitOptions::Objective objective = FitOptions::Objective::kLeastSquares) const;

  /// The thesis's objective (3.4) of a simulation of all windows: the mean over samples of
  /// |e_u|/s_u + |e_v|/s_v + |e_r|/s_r.
  double objective(const WindowSimulation& simulation) const;

  /// Standard deviations of u, v [m/s], r [rad/s] in a run. Throws std::out_of_range if there is no
  /// such run.
  const Vector3<double>& sigma(int run) const;
  const std::vector<RunData>& runs() const;
  const std::vector<Window>& windows() const { return windows_; }
  Target target() const { return target_; }
  /// Size of an initial state: 3 (u, v, r), or 6 (x, y, psi, u, v, r) if poses are the target.
  int initialSize() const { return target_ == Target::kPoses ? 6 : 3; }

  /// The runs as residuals need them (internal).
  struct Data;
  const Data& data() const { return *data_; }

 private:
  SimulationError(std::shared_ptr<const Data> data, std::vector<Window> windows, Target target);
  static std::shared_ptr<const Data> prepare(std::vector<RunData> runs, Target target);

  std::shared_ptr<const Data> data_;  ///< shared by problems with other windows of the same runs
  std::vector<Window> windows_;
  Target target_;
};

/// Simulates windows of a run, each from the measured pose and the given velocity at its start,
/// without correction. Returns the simulated measurement at every sample. `initial_nu` has one row
/// a window. Throws std::invalid_argument if checkRun() refuses the run, a window lies outside it, the
/// numbers of rows differ or a velocity is not finite; std::runtime_error if a motion is not finite.
WindowSimulation predict(const Model& model, const RunData& run, const std::vector<Window>& windows,
                         const Eigen::MatrixX3d& initial_nu);

}  // namespace ground
