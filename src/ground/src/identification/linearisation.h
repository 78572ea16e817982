// Residuals of all windows at a point. One simulation serves all losses.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "initial_states.h"
#include "normal_equations.h"
#include "window_plans.h"

namespace ground::detail {

/// Parameters and initial states at which windows are simulated.
struct ParameterPoint {
  std::vector<double> coordinates;  ///< coordinates of the model
  const std::vector<int>& free;     ///< indices of the parameters to differentiate by
  const Initials& initial;          ///< initial states of the windows
};

/// Residuals of all windows and their derivatives. Keeps those of the last point with derivatives,
/// up to 64 MB, so that the robust loss and the uncertainty need no simulation at the end of a
/// descent. For one fit at a time.
class Linearisation {
 public:
  /// Uses `threads` threads (0: all cores). Problem and model must outlive it.
  Linearisation(const SimulationError& problem, const Model& model, int threads);
  Linearisation(const SimulationError& problem, Model&& temporary, int threads) = delete;
  ~Linearisation();

  /// Loss of each window; not finite if its simulation is not finite. With `derivatives` it also
  /// computes and keeps these, for normalEquations at the same point.
  std::vector<double> losses(const ParameterPoint& point, const Weigh& weigh,
                             bool derivatives = false);

  /// Residuals of all windows that can be simulated.
  std::vector<double> residuals(const ParameterPoint& point);

  /// Calls take(window, part, equations) for each window and part, in any order, from any thread. A
  /// window is divided into parts(window) stretches of time. Equations are not finite if the
  /// simulation is not finite.
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
  std::vector<std::unique_ptr<Rows>> kept_;  ///< rows of each group of windows, or empty
  std::vector<double> coordinates_;          ///< point of kept_: coordinates, free_ and initial_
  std::vector<int> free_;
  Initials initial_;
  std::vector<std::unique_ptr<Rows>> spare_;
  std::mutex mutex_;  ///< guards spare_
  /// CPU time of the last evaluation, without and with derivatives [s].
  double work_[2] = {kInfinity, kInfinity};
};

}  // namespace ground::detail
