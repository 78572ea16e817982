#include "ground/identification/simulation_error.h"

#include <ceres/ceres.h>
#include <ceres/tiny_solver.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <atomic>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace ground {
namespace {

constexpr int kPass = 8;        // derivatives that a Jet carries
constexpr double kBrief = 0.3;  // windows so short are fitted first [s]
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// True state whose measured pose is the given one; nu is the true velocity. A fixed point, reached
/// in two rounds: offsets of heading and position do not feed back on each other.
template <typename T>
RigidState<T> stateMeasuredAt(const Dynamics<T>& dynamics, const Vector3<double>& measured,
                              const Vector3<T>& nu) {
  RigidState<T> state{measured.cast<T>(), nu};
  for (int i = 0; i < 2; ++i) {
    const Vector3<T> seen = dynamics.measure(state).eta;
    state.eta += measured.cast<T>() - seen;
  }
  return state;
}

/// From an initial velocity at the measured pose, or from an initial pose and velocity. Poses are
/// integrated only if asked for or needed.
template <typename T, class Visit>
void simulateWindow(const Dynamics<T>& dynamics, const RunData& run, const Window& window,
                    const Eigen::Matrix<T, Eigen::Dynamic, 1>& initial, bool with_pose,
                    Visit visit) {
  const double start = run.times[window.first];
  const Vector3<double> measured = run.eta.row(window.first);
  const Vector3<T> nu = initial.template tail<3>();
  const RigidState<T> state = initial.size() == 3 ? stateMeasuredAt(dynamics, measured, nu)
                                                  : RigidState<T>{initial.template head<3>(), nu};
  Simulation<T> simulation(dynamics, run.inputs, state, start);
  if (!with_pose && !dynamics.usesPose()) simulation.forgetPose();
  for (int i = window.first; i <= window.last; ++i) {
    simulation.advance(run.times[i]);
    visit(i - window.first, simulation.measure());
  }
}

/// Pseudo-Huber: square for residuals below delta, absolute value above, as a residual of its own.
struct Robust {
  double delta = kInfinity;

  double operator()(double r) const { return r * factor(r); }
  double derivative(double r) const {
    if (std::isinf(delta)) return 1;
    const double root = std::sqrt(1 + r * r / (delta * delta)), f = factor(r);
    return r == 0 ? 1 : f * (1 - (root - 1) / (2 * root));
  }
  /// Half the derivative of the loss by the residual.
  double score(double r) const {
    return std::isinf(delta) ? r : r / std::sqrt(1 + r * r / (delta * delta));
  }
  /// Half the second derivative of the loss, averaged over about `width` (no less than delta):
  /// absolute values have all their curvature at zero, where few residuals are.
  double curvature(double r, double width) const {
    return std::isinf(delta) ? 1 : delta / width * std::pow(1 + r * r / (width * width), -1.5);
  }

 private:
  double factor(double r) const {
    return std::isinf(delta) ? 1 : std::sqrt(2 / (1 + std::sqrt(1 + r * r / (delta * delta))));
  }
};

/// Scaling between solver variables of order one and coordinates of the model.
struct Free {
  std::vector<double> base;  ///< coordinates of all parameters, the free ones at their start
  std::vector<int> index;
  std::vector<double> scale, lower, upper;  ///< bounds in coordinates
  std::vector<bool> reciprocal;             ///< the value is one over the coordinate

  std::vector<double> coordinates(const double* scaled) const {
    std::vector<double> all = base;
    for (std::size_t i = 0; i < index.size(); ++i) all[index[i]] = scaled[i] * scale[i];
    return all;
  }
  /// Whether the value grows with the coordinate, or falls.
  double sign(int i) const { return reciprocal[i] ? -1 : 1; }
  /// Sign of the way from the bound that a value sits on into the range; 0 inside the range.
  int inward(std::size_t i, double scaled) const {
    return scaled * scale[i] <= lower[i] ? 1 : scaled * scale[i] >= upper[i] ? -1 : 0;
  }
};

class WindowCost : public ceres::CostFunction {
 public:
  WindowCost(const SimulationError& problem, const Model& model, const Free& free, int window,
             const Robust& robust)
      : problem_(problem), model_(model), free_(free), window_(window), robust_(robust) {
    const Window& w = problem.windows()[window];
    set_num_residuals(3 * (w.last - w.first + 1));
    if (!free.index.empty())
      mutable_parameter_block_sizes()->push_back(static_cast<int>(free.index.size()));
    mutable_parameter_block_sizes()->push_back(problem.initialSize());
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const int count = static_cast<int>(free_.index.size());
    const int initial_block = count > 0 ? 1 : 0;
    const int initial_size = problem_.initialSize();
    const std::vector<double> coordinates = free_.coordinates(parameters[0]);
    const Eigen::Map<const Eigen::VectorXd> initial(parameters[initial_block], initial_size);
    Eigen::VectorXd r;
    Eigen::MatrixXd J;
    if (!problem_.residuals(model_, coordinates, free_.index, window_, initial, r,
                            jacobians ? &J : nullptr))
      return false;
    for (Eigen::Index i = 0; i < r.size(); ++i) {
      residuals[i] = robust_(r(i));
      if (jacobians) J.row(i) *= robust_.derivative(r(i));
    }
    if (!jacobians) return true;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    if (count > 0 && jacobians[0]) {
      Eigen::Map<RowMajor> out(jacobians[0], r.size(), count);
      for (int i = 0; i < count; ++i) out.col(i) = J.col(i) * free_.scale[i];
    }
    if (jacobians[initial_block])
      Eigen::Map<RowMajor>(jacobians[initial_block], r.size(), initial_size) =
          J.rightCols(initial_size);
    return true;
  }

 private:
  const SimulationError& problem_;
  const Model& model_;
  const Free& free_;
  int window_;
  Robust robust_;
};

using Initials = std::vector<Eigen::VectorXd>;

/// Relative change of the cost at which a descent ends: rough to come near, coarse where another
/// one follows. An exact fit has no use for the fine one, its cost falls until nothing is left of
/// it.
constexpr double kRough = 1e-2, kCoarse = 1e-5, kFine = 1e-8;

/// Losses to descend by, one after the other. Plain squares come first, they have the widest basin;
/// absolute values are approached from them.
std::vector<double> lossesOf(FitOptions::Objective objective) {
  if (objective == FitOptions::Objective::kLeastSquares) return {kInfinity};
  return {kInfinity, 1.0, 0.3, 0.1, 0.03, 0.01};
}

int threadCount(int wanted) {
  return wanted > 0 ? wanted : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

/// Calls `work(i)` for i = 0 … count - 1 from several threads.
template <class Work>
void inParallel(std::size_t count, int threads, const Work& work) {
  std::atomic<std::size_t> next{0};
  const auto take = [&] {
    for (std::size_t i = next++; i < count; i = next++) work(i);
  };
  std::vector<std::thread> others;
  const std::size_t wanted = std::min<std::size_t>(threadCount(threads), count);
  for (std::size_t i = 1; i < wanted; ++i) others.emplace_back(take);
  take();
  for (std::thread& thread : others) thread.join();
}

/// One window's residuals as a function of its initial state, for ceres::TinySolver.
class InitialCost {
 public:
  using Scalar = double;
  enum { NUM_RESIDUALS = Eigen::Dynamic, NUM_PARAMETERS = Eigen::Dynamic };

  InitialCost(const WindowCost& cost, int parameters) : cost_(cost), parameters_(parameters) {}
  int NumResiduals() const { return cost_.num_residuals(); }
  int NumParameters() const { return parameters_; }

  bool operator()(const double* initial, double* residuals, double* jacobian) const {
    const int rows = NumResiduals();
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> by_row(rows,
                                                                                  parameters_);
    double* blocks[] = {by_row.data()};
    if (!cost_.Evaluate(&initial, residuals, jacobian ? blocks : nullptr)) {
      // The solver takes a step back from what is not finite.
      std::fill_n(residuals, rows, kInfinity);
      return false;
    }
    if (jacobian) Eigen::Map<Eigen::MatrixXd>(jacobian, rows, parameters_) = by_row;
    return true;
  }

 private:
  const WindowCost& cost_;
  int parameters_;
};

/// The initial state of one window that suits the model best, sought from the given one.
void solveInitial(const SimulationError& problem, const Model& model, const Free& nothing,
                  const Robust& robust, int window, Eigen::VectorXd& initial) {
  const WindowCost cost(problem, model, nothing, window, robust);
  const InitialCost function(cost, problem.initialSize());
  ceres::TinySolver<InitialCost> solver;
  solver.options.function_tolerance = 1e-10 * function.NumResiduals();
  solver.Solve(function, &initial);
}

/// One solve; `scaled` and `initial` are start and result.
ceres::Solver::Summary solve(const SimulationError& problem, const Model& model, const Free& free,
                             const Robust& robust, double tolerance, int iterations, int threads,
                             std::vector<double>& scaled, Initials& initial) {
  ceres::Problem ceres_problem;
  for (std::size_t w = 0; w < problem.windows().size(); ++w) {
    auto* cost = new WindowCost(problem, model, free, static_cast<int>(w), robust);
    std::vector<double*> blocks = {initial[w].data()};
    if (!scaled.empty()) blocks.insert(blocks.begin(), scaled.data());
    ceres_problem.AddResidualBlock(cost, nullptr, blocks);
  }
  for (std::size_t i = 0; i < scaled.size(); ++i) {
    const int at = static_cast<int>(i);
    if (std::isfinite(free.lower[i]))
      ceres_problem.SetParameterLowerBound(scaled.data(), at, free.lower[i] / free.scale[i]);
    if (std::isfinite(free.upper[i]))
      ceres_problem.SetParameterUpperBound(scaled.data(), at, free.upper[i] / free.scale[i]);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = iterations;
  options.num_threads = threadCount(threads);
  // Steps are cut off at the bounds; to search along each would cost as much as the steps do.
  options.max_num_line_search_step_size_iterations = 0;
  options.function_tolerance = tolerance;
  options.parameter_tolerance = 1e-10;
  options.gradient_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &ceres_problem, &summary);
  return summary;
}

/// Where a descent ended.
struct Solution {
  std::vector<double> scaled;
  Initials initial;
  double delta = kInfinity;  ///< of the last loss
  double cost = kInfinity;
  int iterations = 0;
  bool usable = false, converged = false;
  std::string message;
};

Initials measuredInitials(const SimulationError& problem) {
  Initials initial;
  for (const Window& w : problem.windows()) {
    const RunData& run = problem.runs()[w.run];
    initial.emplace_back(problem.initialSize());
    initial.back().tail<3>() = run.nu.row(w.first);
    if (problem.initialSize() == 6) initial.back().head<3>() = run.eta.row(w.first);
  }
  return initial;
}

Free makeFree(const Model& model, const std::vector<std::string>& names) {
  Free free;
  free.base = model.coordinates();
  const auto infos = model.parameters();
  for (const std::string& name : names) {
    const int index = model.index(name);
    if (std::find(free.index.begin(), free.index.end(), index) != free.index.end())
      throw std::invalid_argument("parameter " + name + " is named twice");
    const ParameterInfo& info = infos[index];
    const bool reciprocal = info.coordinate == Coordinate::kReciprocal;
    const double scale = std::max(std::abs(model.coordinates()[index]), info.scale(model.body));
    free.index.push_back(index);
    free.scale.push_back(scale > 0 ? scale : 1.0);
    free.reciprocal.push_back(reciprocal);
    free.lower.push_back(reciprocal ? info.toCoordinate(info.upper) : info.lower);
    free.upper.push_back(reciprocal ? info.toCoordinate(info.lower) : info.upper);
    // A bound that the value may not reach, as of a mass, still has to be a number to the solver.
    const bool infinite = reciprocal && free.lower.back() == 0 && !std::isinf(info.neutral);
    if (infinite || free.lower.back() == std::numeric_limits<double>::min())
      free.lower.back() = 1e-6 * free.scale.back();
  }
  const auto has = [&names](const char* name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  if (has("k") && has("I_z") && (has("m") || has("l")))
    throw std::invalid_argument(
        "m or l cannot be free together with k and I_z: velocities only tell k/m, k l/I_z and the "
        "dampings over m and I_z; weigh the craft and measure its lever");
  return free;
}

/// Derivatives of the cost by the scaled free parameters.
Eigen::VectorXd gradient(const SimulationError& problem, const Model& model, const Free& free,
                         const Robust& robust, const Solution& at) {
  const auto n = static_cast<Eigen::Index>(free.index.size());
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(n);
  const std::vector<double> coordinates = free.coordinates(at.scaled.data());
  for (std::size_t w = 0; w < problem.windows().size(); ++w) {
    Eigen::VectorXd r;
    Eigen::MatrixXd J;
    if (!problem.residuals(model, coordinates, free.index, static_cast<int>(w), at.initial[w], r,
                           &J))
      continue;
    for (double& x : r) x = robust.score(x);
    sum += J.leftCols(n).transpose() * r;
  }
  return sum.cwiseProduct(Eigen::Map<const Eigen::VectorXd>(free.scale.data(), n));
}

std::string notFinite(const SimulationError& problem, int window) {
  const Window& w = problem.windows()[window];
  const RunData& run = problem.runs()[w.run];
  std::ostringstream out;
  out << "the model's motion is not finite in " << run.name << " from " << run.times[w.first]
      << " to " << run.times[w.last] << " s";
  return out.str();
}

/// Descends by one loss. The solver's steps shorten to nothing in front of a bound, whatever the
/// other parameters still have to go; so those that have come to a bound are held there while the
/// others go on, and are let go when the cost falls inwards (active set).
void descend(const SimulationError& problem, const Model& model, const Free& free,
             const Robust& robust, double tolerance, const FitOptions& options,
             Solution& solution) {
  const std::size_t n = free.index.size();
  std::vector<bool> held(n, false), let_go(n, false);
  for (bool first = true;; first = false) {
    Free moving;
    moving.base = free.coordinates(solution.scaled.data());
    std::vector<double> scaled;
    for (std::size_t i = 0; i < n; ++i) {
      if (held[i]) continue;
      moving.index.push_back(free.index[i]);
      moving.scale.push_back(free.scale[i]);
      moving.lower.push_back(free.lower[i]);
      moving.upper.push_back(free.upper[i]);
      scaled.push_back(solution.scaled[i]);
    }
    const auto summary = solve(problem, model, moving, robust, tolerance, options.max_iterations,
                               options.threads, scaled, solution.initial);
    solution.cost = summary.final_cost;
    solution.iterations += static_cast<int>(summary.iterations.size());
    solution.usable = summary.IsSolutionUsable() && std::isfinite(summary.final_cost);
    solution.converged = summary.termination_type == ceres::CONVERGENCE;
    solution.message = summary.message;
    if (!solution.usable) return;
    bool changed = false;
    for (std::size_t i = 0, j = 0; i < n; ++i) {
      if (held[i]) continue;
      solution.scaled[i] = scaled[j++];
      if (free.inward(i, solution.scaled[i]) != 0) changed = held[i] = true;
    }
    if (changed) continue;
    if (first) return;  // no bound was met
    const Eigen::VectorXd slope = gradient(problem, model, free, robust, solution);
    for (std::size_t i = 0; i < n; ++i) {
      if (!held[i] || let_go[i]) continue;
      if (slope(i) * free.inward(i, solution.scaled[i]) < -1e-6 * (1e-6 + solution.cost)) {
        held[i] = false;
        changed = let_go[i] = true;  // once: no going round in circles
      }
    }
    if (!changed) return;
  }
}

/// Descends from `scaled` by one loss after the other.
Solution descend(const SimulationError& problem, const Model& model, const Free& free,
                 const std::vector<double>& losses, const FitOptions& options,
                 std::vector<double> scaled, Initials initial, double coarse = kCoarse) {
  Solution solution;
  solution.scaled = std::move(scaled);
  solution.initial = std::move(initial);
  for (const double delta : losses) {
    solution.delta = delta;
    const bool last = delta == losses.back() && std::isfinite(delta);
    descend(problem, model, free, {delta}, last ? kFine : coarse, options, solution);
    if (!solution.usable) break;
  }
  return solution;
}

/// Windows cut into pieces of at most `length` seconds.
std::vector<Window> pieces(const SimulationError& problem, double length) {
  std::vector<Window> all;
  for (const Window& w : problem.windows()) {
    const RunData& run = problem.runs()[w.run];
    const auto found = cutWindows(run, w.run, run.times[w.first], run.times[w.last], length);
    all.insert(all.end(), found.begin(), found.end());
  }
  return all.empty() ? problem.windows() : all;
}

/// Half the sum of squares with the measured initial states. Throws std::runtime_error when a
/// window's simulation is not finite; the solver would say it on stderr, in its words.
double costOf(const SimulationError& problem, const Model& model, const Free& free,
              const std::vector<double>& scaled) {
  const Initials initial = measuredInitials(problem);
  const std::vector<double> coordinates = free.coordinates(scaled.data());
  double sum = 0;
  for (std::size_t w = 0; w < problem.windows().size(); ++w) {
    Eigen::VectorXd r;
    const int window = static_cast<int>(w);
    if (!problem.residuals(model, coordinates, free.index, window, initial[w], r, nullptr))
      throw std::runtime_error(notFinite(problem, window));
    sum += r.squaredNorm() / 2;
  }
  return sum;
}

/// Values nearer to the data than the given ones, where there are any: those that fit short pieces
/// of the windows. Over a short time a simulation depends little on what came before, and the cost
/// has hardly any minimum but one. Throws std::runtime_error when the given ones cannot be
/// simulated.
std::vector<double> approach(const SimulationError& whole, const SimulationError& brief,
                             const Model& model, const Free& free, const FitOptions& options,
                             const std::vector<double>& from) {
  const double far = costOf(whole, model, free, from);
  const Solution near =
      descend(brief, model, free, {kInfinity}, options, from, measuredInitials(brief), kRough);
  try {
    if (near.usable && costOf(whole, model, free, near.scaled) < far) return near.scaled;
  } catch (const std::runtime_error&) {
    // what suits short windows need not suit long ones
  }
  return from;
}

/// The model's own values, then as many others as asked for: positive ones up to ten times smaller
/// or larger, the others as far off as they are typically large.
std::vector<std::vector<double>> startsOf(const Free& free, int count) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<std::vector<double>> starts;
  for (int s = 0; s < count; ++s) {
    std::vector<double> scaled(free.index.size());
    for (std::size_t i = 0; i < scaled.size(); ++i) {
      const double given = free.base[free.index[i]] / free.scale[i];
      const double lower = free.lower[i] / free.scale[i], upper = free.upper[i] / free.scale[i];
      const double way = s == 0 ? 0 : uniform(random);
      scaled[i] = s == 0       ? given
                  : lower >= 0 ? std::max(given, 0.1) * std::pow(10, way)
                               : given + way;
      scaled[i] = std::min(std::max(scaled[i], lower), upper);
    }
    starts.push_back(scaled);
  }
  return starts;
}

/// Standard deviation that the median of absolute residuals stands for.
double deviationOf(std::vector<double> sizes) {
  const auto middle = sizes.begin() + sizes.size() / 2;
  std::nth_element(sizes.begin(), middle, sizes.end());
  return 1.4826 * *middle;
}

/// Normal equations of the free parameters and one window's initial state.
struct Normal {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;

  explicit Normal(int n) : A(Eigen::MatrixXd::Zero(n, n)), b(Eigen::VectorXd::Zero(n)) {}
  Normal& operator+=(const Normal& other) {
    A += other.A;
    b += other.b;
    return *this;
  }
  Normal& operator-=(const Normal& other) {
    A -= other.A;
    b -= other.b;
    return *this;
  }
  /// Without the initial state, the last `k` unknowns: whatever it is, it follows along.
  Normal reduced(Eigen::Index k) const {
    const Eigen::Index n = b.size() - k;
    const auto state = A.bottomRightCorner(k, k).completeOrthogonalDecomposition();
    Normal result(static_cast<int>(n));
    result.A =
        A.topLeftCorner(n, n) - A.topRightCorner(n, k) * state.solve(A.bottomLeftCorner(k, n));
    result.b = b.head(n) - A.topRightCorner(n, k) * state.solve(b.tail(k));
    return result;
  }
};

/// How well the free parameters are known, in scaled coordinates.
struct Uncertainty {
  Eigen::MatrixXd information, covariance;
  std::vector<bool> identified;  ///< false: the data say nothing, the variance is infinite
  int blocks = 0;
};

/// Jackknife over blocks of time, inside which residuals may be correlated: each block is left out
/// once, and one Newton step says where the estimate, the initial velocities with it, would go.
/// Unlike the sum of squared scores it is not fooled by residuals that the fit has made small
/// (MacKinnon and White 1985, HC3).
Uncertainty uncertainty(const SimulationError& problem, const Model& model, const Free& free,
                        const std::vector<double>& coordinates, const Initials& initial,
                        const Robust& robust, double block) {
  const int n = static_cast<int>(free.index.size());
  const Eigen::VectorXd scale = Eigen::Map<const Eigen::VectorXd>(free.scale.data(), n);
  const auto durationOf = [&problem](const Window& w) {
    const std::vector<double>& times = problem.runs()[w.run].times;
    return times[w.last] - times[w.first];
  };
  double total = 0;
  std::vector<Eigen::VectorXd> residuals(problem.windows().size());
  std::vector<Eigen::MatrixXd> jacobians(problem.windows().size());
  std::vector<double> sizes;
  for (std::size_t w = 0; w < problem.windows().size(); ++w) {
    if (!problem.residuals(model, coordinates, free.index, static_cast<int>(w), initial[w],
                           residuals[w], &jacobians[w])) {
      residuals[w].resize(0);
      continue;
    }
    total += durationOf(problem.windows()[w]);
    jacobians[w].leftCols(n) *= scale.asDiagonal();
    for (double r : residuals[w]) sizes.push_back(std::abs(r));
  }
  // In short data blocks are shorter: a covariance of n parameters needs several times n of them.
  block = std::min(block, total / (4 * n));
  const double width = std::max(robust.delta, sizes.empty() ? 0 : 0.3 * deviationOf(sizes));

  Normal whole(n);
  std::vector<Normal> changes;  // of the whole when a block is left out
  for (std::size_t w = 0; w < problem.windows().size(); ++w) {
    const Window& span = problem.windows()[w];
    const int samples = static_cast<int>(residuals[w].size()) / 3;
    if (samples == 0) continue;
    const int count =
        std::min(samples, std::max(1, static_cast<int>(std::lround(durationOf(span) / block))));
    Normal window(n + problem.initialSize());
    std::vector<Normal> parts(count, window);
    for (int b = 0; b < count; ++b) {
      const int begin = 3 * (samples * b / count), end = 3 * (samples * (b + 1) / count);
      for (int i = begin; i < end; ++i) {
        const Eigen::VectorXd row = jacobians[w].row(i);
        const double r = residuals[w](i);
        parts[b].A += robust.curvature(r, width) * row * row.transpose();
        parts[b].b += robust.score(r) * row;
      }
      window += parts[b];
    }
    const Normal reduced = window.reduced(problem.initialSize());
    whole += reduced;
    for (const Normal& part : parts) {
      Normal rest = window;
      rest -= part;
      changes.push_back(count > 1 ? rest.reduced(problem.initialSize()) : Normal(n));
      changes.back() -= reduced;
    }
  }

  Uncertainty result;
  result.information = whole.A;
  result.blocks = static_cast<int>(changes.size());
  result.identified.assign(n, true);
  constexpr double kNothing = 1e-14, kNoDirection = 1e-10, kTakesPart = 1e-6;
  const double largest = whole.A.diagonal().maxCoeff();
  Eigen::VectorXd unit(n);
  for (int i = 0; i < n; ++i) {
    result.identified[i] = whole.A(i, i) > kNothing * largest;
    unit(i) = result.identified[i] ? 1 / std::sqrt(whole.A(i, i)) : 0;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(unit.asDiagonal() * whole.A *
                                                             unit.asDiagonal());
  int first = 0;  // directions before it are not seen
  while (first < n && !(eigen.eigenvalues()(first) > kNoDirection * eigen.eigenvalues()(n - 1)))
    for (int i = 0, j = first++; i < n; ++i)
      if (std::pow(eigen.eigenvectors()(i, j), 2) > kTakesPart) result.identified[i] = false;
  const Eigen::MatrixXd seen = unit.asDiagonal() * eigen.eigenvectors().rightCols(n - first);
  result.covariance = Eigen::MatrixXd::Zero(n, n);
  if (first == n || result.blocks < 2) {
    result.identified.assign(n, false);
    return result;
  }
  Eigen::MatrixXd steps(n, result.blocks);
  for (int b = 0; b < result.blocks; ++b) {
    const Eigen::MatrixXd A = seen.transpose() * (whole.A + changes[b].A) * seen;
    const Eigen::VectorXd s = seen.transpose() * (whole.b + changes[b].b);
    steps.col(b) = seen * A.completeOrthogonalDecomposition().solve(s);
  }
  const Eigen::MatrixXd centred = steps.colwise() - steps.rowwise().mean();
  result.covariance = (result.blocks - 1.0) / result.blocks * centred * centred.transpose();
  return result;
}

}  // namespace

std::vector<Window> cutWindows(const RunData& run, int run_index, double from, double to,
                               double length, double max_gap) {
  if (!(length > 0)) throw std::invalid_argument("the length of windows must be positive");
  constexpr int kFewest = 6;  // samples that say something about an initial velocity
  std::vector<Window> windows;
  const auto add = [&](int first, int last) {
    const double duration = run.times[last] - run.times[first];
    if (last - first + 1 >= kFewest && duration > 0.5 * length)
      windows.push_back({run_index, first, last});
  };
  int first = -1;
  const int count = static_cast<int>(run.times.size());
  for (int i = 0; i < count; ++i) {
    if (run.times[i] < from || run.times[i] > to) continue;
    if (first >= 0 && run.times[i] - run.times[i - 1] > max_gap) {
      add(first, i - 1);
      first = i;
    } else if (first < 0) {
      first = i;
    } else if (run.times[i] - run.times[first] >= length - 1e-9) {
      add(first, i);
      first = i;
    }
    if (i + 1 == count || run.times[i + 1] > to) add(first, i);
  }
  return windows;
}

SimulationError::SimulationError(std::vector<RunData> runs, std::vector<Window> windows,
                                 Target target)
    : runs_(std::move(runs)), windows_(std::move(windows)), target_(target) {
  if (windows_.empty())
    throw std::invalid_argument("the runs are too short: there is no window to simulate");
  for (RunData& run : runs_) {
    if (run.poses.rows() == 0) run.poses = run.eta;
    const auto count = static_cast<Eigen::Index>(run.times.size());
    if (run.eta.rows() != count || run.nu.rows() != count || run.poses.rows() != count)
      throw std::invalid_argument(run.name + ": times, eta, nu and poses differ in length");
    if (!run.eta.allFinite() || !run.nu.allFinite() || !run.poses.allFinite())
      throw std::invalid_argument(run.name + ": a measurement is not finite");
    const Vector3<double> mean = run.nu.colwise().mean();
    const Vector3<double> sigma =
        (run.nu.rowwise() - mean.transpose()).array().square().colwise().mean().sqrt();
    if (!(sigma.minCoeff() > 0))
      throw std::invalid_argument(run.name + ": the craft does not move");
    sigma_.push_back(sigma);
    if (!(run.noise.minCoeff() > 0))
      throw std::invalid_argument(run.name + ": the noise of poses must be positive");
  }
  for (const Window& w : windows_) {
    if (w.run < 0 || w.run >= static_cast<int>(runs_.size()) || w.first < 0 || w.last <= w.first ||
        w.last >= static_cast<int>(runs_[w.run].times.size()))
      throw std::invalid_argument("a window lies outside its run");
  }
}

bool SimulationError::residuals(const Model& model, const std::vector<double>& coordinates,
                                const std::vector<int>& free, int window,
                                const Eigen::VectorXd& initial, Eigen::VectorXd& residuals,
                                Eigen::MatrixXd* jacobian) const {
  const Window& w = windows_[window];
  const RunData& run = runs_[w.run];
  const bool poses = target_ == Target::kPoses;
  const Vector3<double> weight = (poses ? run.noise : sigma_[w.run]).cwiseInverse();
  const Eigen::MatrixX3d& measurements = poses ? run.poses : run.nu;
  const int samples = w.last - w.first + 1;
  residuals.resize(3 * samples);
  const auto store = [&](int i, const Vector3<double>& simulated) {
    const Vector3<double> measured = measurements.row(w.first + i);
    residuals.segment<3>(3 * i) = (simulated - measured).cwiseProduct(weight);
  };
  if (!jacobian) {
    const Dynamics<double> dynamics(model, coordinates);
    simulateWindow<double>(
        dynamics, run, w, initial, poses,
        [&](int i, const Measurement<double>& m) { store(i, poses ? m.eta : m.nu); });
    return residuals.allFinite();
  }
  const int columns = static_cast<int>(free.size()) + initialSize();
  jacobian->resize(3 * samples, columns);
  for (int begin = 0; begin < columns; begin += kPass) {
    const int count = std::min(kPass, columns - begin);
    std::vector<Jet> theta(coordinates.begin(), coordinates.end());
    Eigen::Matrix<Jet, Eigen::Dynamic, 1> state = initial.cast<Jet>();
    for (int j = 0; j < count; ++j) {
      const int column = begin + j;
      Jet& seeded = column < static_cast<int>(free.size())
                        ? theta[free[column]]
                        : state(column - static_cast<int>(free.size()));
      seeded.v[j] = 1;
    }
    const Dynamics<Jet> dynamics(model, theta);
    simulateWindow<Jet>(dynamics, run, w, state, poses, [&](int i, const Measurement<Jet>& m) {
      const Vector3<Jet>& seen = poses ? m.eta : m.nu;
      store(i, {seen.x().a, seen.y().a, seen.z().a});
      for (int c = 0; c < 3; ++c)
        jacobian->block(3 * i + c, begin, 1, count) = weight(c) * seen(c).v.head(count).transpose();
    });
  }
  return residuals.allFinite() && jacobian->allFinite();
}

WindowSimulation SimulationError::simulate(const Model& model,
                                           FitOptions::Objective objective) const {
  Free nothing;
  nothing.base = model.coordinates();
  Initials initial = measuredInitials(*this);
  inParallel(windows_.size(), 0, [&](std::size_t w) {
    for (const double delta : lossesOf(objective))
      solveInitial(*this, model, nothing, {delta}, static_cast<int>(w), initial[w]);
  });
  return simulateFrom(model, initial);
}

WindowSimulation SimulationError::simulateFrom(const Model& model,
                                               const std::vector<Eigen::VectorXd>& initial) const {
  WindowSimulation result;
  const Dynamics<double> dynamics(model);
  for (std::size_t w = 0; w < windows_.size(); ++w) {
    const Window& window = windows_[w];
    const int samples = window.last - window.first + 1;
    Eigen::MatrixX3d eta(samples, 3), nu(samples, 3);
    simulateWindow<double>(dynamics, runs_[window.run], window, initial[w], true,
                           [&](int i, const Measurement<double>& m) {
                             eta.row(i) = m.eta;
                             nu.row(i) = m.nu;
                           });
    if (!eta.allFinite() || !nu.allFinite())
      throw std::runtime_error(notFinite(*this, static_cast<int>(w)));
    result.eta.push_back(std::move(eta));
    result.nu.push_back(std::move(nu));
  }
  return result;
}

double SimulationError::objective(const WindowSimulation& simulation) const {
  double sum = 0;
  Eigen::Index samples = 0;
  for (std::size_t w = 0; w < windows_.size(); ++w) {
    const Window& span = windows_[w];
    const Eigen::MatrixX3d error =
        simulation.nu[w] - runs_[span.run].nu.middleRows(span.first, simulation.nu[w].rows());
    sum += (error.cwiseAbs() * sigma_[span.run].cwiseInverse()).sum();
    samples += error.rows();
  }
  return sum / static_cast<double>(samples);
}

FitResult SimulationError::fit(const Model& model, const FitOptions& options) const {
  if (options.free.empty()) throw std::invalid_argument("no parameter is free");
  if (options.starts < 1) throw std::invalid_argument("a fit needs at least one start");
  const Free free = makeFree(model, options.free);
  const int n = static_cast<int>(free.index.size());
  FitResult result;
  result.model = model;
  Solution best;
  std::vector<double> costs;
  const SimulationError brief(runs_, pieces(*this, kBrief), target_);
  for (const std::vector<double>& from : startsOf(free, options.starts)) {
    Solution found;
    try {
      const std::vector<double> near = approach(*this, brief, model, free, options, from);
      found = descend(*this, model, free, lossesOf(options.objective), options, near,
                      measuredInitials(*this));
      if (!found.usable) throw std::runtime_error(found.message);
    } catch (const std::runtime_error& error) {
      if (!costs.empty()) continue;
      // The start values of the model itself have to work: they are what the user gave.
      throw std::runtime_error(std::string("the fit failed at its start values: ") + error.what());
    }
    if (costs.empty() || found.cost < best.cost) best = found;
    costs.push_back(found.cost);
  }
  result.starts = static_cast<int>(costs.size());
  result.starts_at_best = static_cast<int>(std::count_if(costs.begin(), costs.end(), [&](double c) {
    return c <= best.cost + 1e-4 * std::abs(best.cost) + 1e-12;
  }));
  if (options.objective == FitOptions::Objective::kLeastSquares) {
    std::vector<double> sizes;
    for (std::size_t w = 0; w < windows_.size(); ++w) {
      Eigen::VectorXd r;
      if (residuals(model, free.coordinates(best.scaled.data()), free.index, static_cast<int>(w),
                    best.initial[w], r, nullptr))
        for (double x : r) sizes.push_back(std::abs(x));
    }
    const double delta = sizes.empty() ? kInfinity : 2 * deviationOf(sizes);
    // An exact fit has no outliers.
    if (delta > 1e-9 && std::isfinite(delta)) {
      const Solution robust =
          descend(*this, model, free, {delta}, options, best.scaled, best.initial);
      if (robust.usable) {
        const int before = best.iterations;
        best = robust;
        best.iterations += before;
      }
    }
  }
  result.iterations = best.iterations;
  result.converged = best.converged;
  result.message = best.message;

  const std::vector<double> coordinates = free.coordinates(best.scaled.data());
  const auto infos = model.parameters();
  std::vector<double> values = model.values();
  for (int i = 0; i < n; ++i)
    values[free.index[i]] = infos[free.index[i]].fromCoordinate(coordinates[free.index[i]]);
  result.model.setValues(values);
  result.objective = objective(simulateFrom(result.model, best.initial));

  const Uncertainty u =
      uncertainty(*this, model, free, coordinates, best.initial, {best.delta}, options.block);
  const Eigen::VectorXd deviation = u.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  result.correlation = Eigen::MatrixXd::Identity(n, n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      if (i != j && deviation(i) * deviation(j) > 0)
        result.correlation(i, j) =
            free.sign(i) * free.sign(j) * u.covariance(i, j) / (deviation(i) * deviation(j));
  const Eigen::VectorXd eigen =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(u.information).eigenvalues();
  result.condition = eigen(0) > 0 ? eigen(n - 1) / eigen(0) : kInfinity;
  const boost::math::students_t t(std::max(1, u.blocks - n));
  const double quantile = boost::math::quantile(t, 0.975);
  for (int i = 0; i < n; ++i) {
    const ParameterInfo& info = infos[free.index[i]];
    const double at = coordinates[free.index[i]];
    const double spread = u.identified[i] ? deviation(i) * free.scale[i] : kInfinity;
    const double half = quantile * spread;
    double low = info.lower, high = info.upper;
    if (u.identified[i]) {
      low = info.fromCoordinate(std::max(at - half, free.lower[i]));
      high = info.fromCoordinate(std::min(at + half, free.upper[i]));
      if (low > high) std::swap(low, high);
    }
    const double value = values[free.index[i]];
    const double slope = info.coordinate == Coordinate::kReciprocal ? value * value : 1;
    const double margin = 1e-4 * free.scale[i];
    result.parameters.push_back(
        {info.name, info.unit, model.values()[free.index[i]], value, low, high, slope * spread,
         at - free.lower[i] < margin || free.upper[i] - at < margin, bool(u.identified[i])});
  }
  return result;
}

}  // namespace ground
