#pragma once

#include <Eigen/Core>
#include <memory>
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
  Eigen::MatrixX3d poses;     ///< the same as measured; as many as eta, or none: eta then
  Vector3<double> noise = {4e-4, 4e-4, 6e-3};  ///< standard deviations of the poses [m], [rad]
};

/// A stretch of a run that is simulated from an initial velocity of its own; the initial pose is
/// the measured one.
struct Window {
  int run;
  int first, last;  ///< first and last sample
};

/// Cuts the part [from, to] s of a run into windows of `length` seconds that share their end
/// points; a last piece shorter than half a window is left out. Windows do not reach over gaps
/// longer than `max_gap` seconds in the measurements.
std::vector<Window> cutWindows(const RunData& run, int run_index, double from, double to,
                               double length, double max_gap = 0.1);

/// Simulated velocities of windows at the samples of their runs.
struct WindowSimulation {
  std::vector<Eigen::MatrixX3d> eta, nu;  ///< per window, one row a sample
};

/// What to fit, and how.
struct FitOptions {
  enum class Objective {
    kLeastSquares,  ///< weighted least squares with a robust loss
    kThesis         ///< weighted absolute errors, (3.4)
  };
  std::vector<std::string> free;  ///< names of the free parameters
  Objective objective = Objective::kLeastSquares;
  int starts = 1;  ///< from the model's values, and from so many less one others
  int max_iterations = 200;
  int threads = 0;     ///< 0: all cores
  double block = 0.5;  ///< length of stretches taken as independent for the intervals [s]
  bool near = false;   ///< the model's values are near: brief windows need not lead there
  /// Residual from which on the robust loss grows as the absolute value; 0: twice the deviation of
  /// the residuals. Fits compare by their cost only where it is the same.
  double width = 0;
  /// Initial states of the windows to start from, as a fit gives them; none: as measured.
  std::vector<Eigen::VectorXd> initial;
};

struct FittedParameter {
  std::string name, unit;
  double start, value, lower, upper;  ///< lower, upper: 95% interval
  double deviation;  ///< standard deviation of the estimate; infinite when not identified
  bool at_bound;
  bool identified;  ///< false: the data say nothing of it, the interval is its whole range
};

struct FitResult {
  Model model;  ///< with the fitted values
  std::vector<FittedParameter> parameters;
  Eigen::MatrixXd correlation;           ///< of the estimates
  double condition = 0;                  ///< of the scaled information matrix
  double objective = 0;                  ///< mean of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r at the end
  double width = 0;                      ///< of the robust loss that was descended by last
  std::vector<Eigen::VectorXd> initial;  ///< states of the windows
  int starts = 0;                        ///< that could be simulated
  int starts_at_best = 0;                ///< that came to the same end as the best
  int iterations = 0;
  bool converged = false;
  std::string message;
};

/// What a simulation is held against.
enum class Target {
  kVelocities,  ///< measured velocities, each divided by its standard deviation in the run
  kPoses        ///< measured poses, each divided by the run's noise: nothing is differenced
};

/// Derivatives of a window's residuals, a row each; the columns are the free parameters, then the
/// numbers of the initial state, then as many zeros as make them a multiple of eight.
using Derivatives = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

using Rows3 = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

/// Residuals of a window at some parameters and initial state.
struct WindowResiduals {
  int window;
  bool finite;                ///< else the simulation was not
  Eigen::VectorXd residuals;  ///< u, v, r (x, y, psi) after each other for every sample
  Derivatives derivatives;    ///< empty where not asked for
};

class Evaluation;
class WindowPlans;

/// The difference between simulation and measurement over windows of runs (thesis 3.3). A window
/// starts at its measured pose with a velocity of its own; when poses are the target, at a pose of
/// its own as well.
class SimulationError {
 public:
  /// Throws std::invalid_argument when there is no window, a run does not move or arrays differ in
  /// length.
  SimulationError(std::vector<RunData> runs, std::vector<Window> windows,
                  Target target = Target::kVelocities);
  ~SimulationError();
  SimulationError(SimulationError&&) noexcept;

  /// Fits the free parameters of a model and the windows' initial velocities. Throws
  /// std::invalid_argument on options that cannot be met, std::runtime_error when the model cannot
  /// be simulated at its start values.
  FitResult fit(const Model& model, const FitOptions& options) const;

  /// Simulates every window with the initial velocities that suit the model best by the
  /// objective. Throws std::runtime_error when the model cannot be simulated.
  WindowSimulation simulate(const Model& model, FitOptions::Objective objective =
                                                    FitOptions::Objective::kLeastSquares) const;

  /// The thesis's objective (3.4) over all windows, from a simulation of them: the mean over
  /// samples of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r.
  double objective(const WindowSimulation& simulation) const;
  /// The same from given initial states. Throws std::runtime_error when the model cannot be
  /// simulated.
  double objective(const Model& model, const std::vector<Eigen::VectorXd>& initial) const;

  /// Standard deviations of u, v, r in a run.
  const Vector3<double>& sigma(int run) const { return data_->sigma[run]; }
  const std::vector<RunData>& runs() const { return data_->runs; }
  const std::vector<Window>& windows() const { return windows_; }

  /// Numbers of an initial state: u, v, r, or x, y, psi, u, v, r where poses are the target.
  int initialSize() const { return target_ == Target::kPoses ? 6 : 3; }

  /// Weighted residuals of one window; with `derivatives` also those by the parameters of the
  /// indices `free` and by the initial state.
  WindowResiduals residuals(const Model& model, const std::vector<double>& coordinates,
                            const std::vector<int>& free, int window,
                            const Eigen::VectorXd& initial, bool derivatives) const;

  /// Simulates every window from the given initial states.
  WindowSimulation simulateFrom(const Model& model,
                                const std::vector<Eigen::VectorXd>& initial) const;

 private:
  friend class Evaluation;

  /// What windows of all lengths are cut from.
  struct Data {
    std::vector<RunData> runs;
    std::vector<Vector3<double>> sigma;
    std::vector<Rows3> measured;          ///< what each run's simulations are compared with
    std::vector<Vector3<double>> weight;  ///< of their errors: one over the standard deviations
  };
  SimulationError(std::shared_ptr<const Data> data, std::vector<Window> windows, Target target);
  static std::shared_ptr<const Data> prepare(std::vector<RunData> runs, Target target);

  std::shared_ptr<const Data> data_;
  std::vector<Window> windows_;
  Target target_;
  std::unique_ptr<WindowPlans> plans_;
};

}  // namespace ground
