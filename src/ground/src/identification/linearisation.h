// Residuals of all windows at a point, simulated once whatever loss they are put under.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "initial_states.h"
#include "normal_equations.h"
#include "window_plans.h"

namespace ground::detail {

/// Where windows are simulated.
struct ParameterPoint {
  std::vector<double> coordinates;  ///< of the model
  const std::vector<int>& free;     ///< parameters to take derivatives by
  const Initials& initial;          ///< states of the windows
};

/// Residuals of all windows and their derivatives. It keeps those of the last point at which it
/// took derivatives, up to 64 MB: the robust loss starts and the uncertainty is found where a
/// descent ended, without another simulation. For one fit at a time.
class Linearisation {
 public:
  /// Over so many threads (0: all cores). Problem and model have to outlive it.
  Linearisation(const SimulationError& problem, const Model& model, int threads);
  ~Linearisation();

  /// Loss of each window; not finite where a simulation is not. With `derivatives` it takes and
  /// keeps these as well, for normalEquations at the same point.
  std::vector<double> losses(const ParameterPoint& point, const Weigh& weigh,
                             bool derivatives = false);

  /// Residuals of all windows that can be simulated.
  std::vector<double> residuals(const ParameterPoint& point);

  /// Calls take(window, part, equations) for each window and part, in any order, from any of the
  /// threads. A window is divided into parts(window) stretches of time. Equations are not finite
  /// where the simulation is not.
  void normalEquations(const ParameterPoint& point, const Weigh& weigh,
                       const std::function<int(int window)>& parts,
                       const std::function<void(int, int, const NormalEquations&)>& take);

  const SimulationError& problem() const { return problem_; }
  const Model& model() const { return model_; }

 private:
  struct Rows;

  void keepFor(const ParameterPoint& point, std::size_t groups);
  std::unique_ptr<Rows> borrow();
  template <class Use>
  void evaluate(const ParameterPoint& point, bool derivatives, const Use& use);

  const SimulationError& problem_;
  const Model& model_;
  const int threads_;
  std::vector<std::unique_ptr<Rows>> kept_;  ///< of the groups of windows, or empty
  std::vector<double> coordinates_;          ///< what they were taken at
  std::vector<int> free_;
  Initials initial_;
  std::vector<std::unique_ptr<Rows>> spare_;
  std::mutex mutex_;  ///< of spare_
  /// Work of the last evaluation, without and with derivatives [s].
  double work_[2] = {kInfinity, kInfinity};
};

}  // namespace ground::detail
