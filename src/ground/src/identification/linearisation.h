// Residuals of all windows at a point. One simulation serves all losses.
#pragma once

#include <functional>
#include <vector>

#include "normal_equations.h"
#include "window_residuals.h"

namespace ground::detail {

/// Parameters and initial states at which windows are simulated.
struct ParameterPoint {
  std::vector<double> coordinates;  ///< coordinates of the model
  const std::vector<int>& free;     ///< indices of the parameters to differentiate by
  const Initials& initial;          ///< initial states of the windows
};

/// Residuals of all windows and their derivatives.
class Linearisation {
 public:
  /// Uses `threads` threads (0: all cores). Problem and model must outlive it.
  Linearisation(const SimulationError& problem, const Model& model, int threads)
      : problem_(problem), model_(model), threads_(threads) {}
  Linearisation(const SimulationError& problem, Model&& temporary, int threads) = delete;

  /// Loss of each window; not finite if its simulation is not finite.
  std::vector<double> losses(const ParameterPoint& point, const Weigh& weigh) const;

  /// Residuals of all windows that can be simulated.
  std::vector<double> residuals(const ParameterPoint& point) const;

  /// Calls take(window, part, equations) for each window and part, in any order, from any thread. A
  /// window is divided into parts(window) stretches of time. Equations are not finite if the
  /// simulation is not finite.
  void normalEquations(const ParameterPoint& point, const Weigh& weigh,
                       const std::function<int(int window)>& parts,
                       const std::function<void(int, int, const NormalEquations&)>& take) const;

  const SimulationError& problem() const { return problem_; }
  const Model& model() const { return model_; }

 private:
  /// Calls use(window, rows) for each window, from several threads.
  template <class Use>
  void evaluate(const ParameterPoint& point, bool derivatives, const Use& use) const;

  const SimulationError& problem_;
  const Model& model_;
  const int threads_;
};

}  // namespace ground::detail
