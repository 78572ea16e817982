#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "ground/identification/run_data.h"

namespace ground {

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
  bool near = false;   ///< the model's values are near: no fit of short pieces has to lead there
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
  bool identified;  ///< false: not identifiable from the data, the interval is its whole range
};

struct FitResult {
  Model model;  ///< with the fitted values
  std::vector<FittedParameter> parameters;
  Eigen::MatrixXd correlation;           ///< of the estimates
  double condition = 0;                  ///< of the scaled information matrix
  double objective = 0;                  ///< mean of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r at the end
  double width = 0;                      ///< of the last robust loss
  std::vector<Eigen::VectorXd> initial;  ///< states of the windows
  int starts = 0;                        ///< that could be simulated
  int starts_at_best = 0;                ///< that came to the same end as the best
  int iterations = 0;
  bool converged = false;
  std::string message;
};

/// What a simulation is compared with.
enum class Target {
  kVelocities,  ///< measured velocities, each divided by its standard deviation in the run
  kPoses        ///< measured poses, each divided by the run's noise: nothing is differenced
};

namespace detail {
class Evaluation;
class WindowPlans;
}  // namespace detail

/// The difference between simulation and measurement over windows of runs (thesis 3.3). A window
/// starts at its measured pose with a velocity of its own; when poses are the target, at a pose of
/// its own as well.
class SimulationError {
 public:
  /// Throws std::invalid_argument when there is no window, a run does not move, arrays differ in
  /// length, a value is not finite or a noise is not positive.
  SimulationError(std::vector<RunData> runs, std::vector<Window> windows,
                  Target target = Target::kVelocities);
  ~SimulationError();
  SimulationError(SimulationError&&) noexcept;

  /// Fits the free parameters of a model and the windows' initial states. Throws
  /// std::invalid_argument on options that cannot be met, std::runtime_error when the model cannot
  /// be simulated at its start values.
  FitResult fit(const Model& model, const FitOptions& options) const;

  /// Simulates every window with the initial states that suit the model best by the objective.
  /// Throws std::runtime_error when the model cannot be simulated.
  WindowSimulation simulate(const Model& model, FitOptions::Objective objective =
                                                    FitOptions::Objective::kLeastSquares) const;

  /// The thesis's objective (3.4) over all windows, from a simulation of them: the mean over
  /// samples of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r.
  double objective(const WindowSimulation& simulation) const;

  /// Standard deviations of u, v [m/s], r [rad/s] in a run.
  const Vector3<double>& sigma(int run) const;
  const std::vector<RunData>& runs() const;
  const std::vector<Window>& windows() const { return windows_; }
  Target target() const { return target_; }
  /// Numbers of an initial state: u, v, r, or x, y, psi, u, v, r where poses are the target.
  int initialSize() const { return target_ == Target::kPoses ? 6 : 3; }

 private:
  friend class detail::Evaluation;
  struct Data;

  SimulationError(std::shared_ptr<const Data> data, std::vector<Window> windows, Target target);
  static std::shared_ptr<const Data> prepare(std::vector<RunData> runs, Target target);

  std::shared_ptr<const Data> data_;  ///< shared with the same runs cut into other windows
  std::vector<Window> windows_;
  Target target_;
  std::unique_ptr<detail::WindowPlans> plans_;
};

}  // namespace ground
