#include "ground/identification/simulation_error.h"

#include <ceres/ceres.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <thread>

namespace ground {
namespace {

constexpr int kPass = 8;  // derivatives that a Jet carries
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

template <typename T, class Visit>
void simulateWindow(const Dynamics<T>& dynamics, const RunData& run, const Window& window,
                    const Vector3<T>& initial_nu, Visit visit) {
  const double start = run.times[window.first];
  const Vector3<double> eta = run.eta.row(window.first);
  Simulation<T> simulation(dynamics, run.inputs, stateMeasuredAt(dynamics, eta, initial_nu), start);
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

 private:
  double factor(double r) const {
    return std::isinf(delta) ? 1 : std::sqrt(2 / (1 + std::sqrt(1 + r * r / (delta * delta))));
  }
};

/// Scaling between solver variables of order one and coordinates of the model.
struct Free {
  std::vector<int> index;
  std::vector<double> scale, lower, upper;  ///< bounds in coordinates
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
    mutable_parameter_block_sizes()->push_back(3);
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const int count = static_cast<int>(free_.index.size());
    const int velocity_block = count > 0 ? 1 : 0;
    std::vector<double> coordinates = model_.coordinates();
    for (int i = 0; i < count; ++i) coordinates[free_.index[i]] = parameters[0][i] * free_.scale[i];
    const Eigen::Map<const Vector3<double>> nu(parameters[velocity_block]);
    Eigen::VectorXd r;
    Eigen::MatrixXd J;
    if (!problem_.residuals(model_, coordinates, free_.index, window_, nu, r,
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
    if (jacobians[velocity_block])
      Eigen::Map<RowMajor>(jacobians[velocity_block], r.size(), 3) = J.rightCols(3);
    return true;
  }

 private:
  const SimulationError& problem_;
  const Model& model_;
  const Free& free_;
  int window_;
  Robust robust_;
};

using Velocities = std::vector<Vector3<double>>;

int threadCount(int wanted) {
  return wanted > 0 ? wanted : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

/// One solve; `scaled` and `initial` are start and result.
ceres::Solver::Summary solve(const SimulationError& problem, const Model& model, const Free& free,
                             const Robust& robust, int iterations, int threads,
                             std::vector<double>& scaled, Velocities& initial) {
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
  options.function_tolerance = 1e-12;
  options.parameter_tolerance = 1e-10;
  options.gradient_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &ceres_problem, &summary);
  return summary;
}

Velocities measuredVelocities(const SimulationError& problem) {
  Velocities initial;
  for (const Window& w : problem.windows())
    initial.push_back(problem.runs()[w.run].nu.row(w.first));
  return initial;
}

Free makeFree(const Model& model, const std::vector<std::string>& names) {
  Free free;
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
    free.lower.push_back(reciprocal ? info.toCoordinate(info.upper) : info.lower);
    free.upper.push_back(reciprocal ? info.toCoordinate(info.lower) : info.upper);
    // A bound that the value may not reach, as of a mass, still has to be a number to the solver.
    if (free.lower.back() == std::numeric_limits<double>::min())
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

double medianOf(std::vector<double> values) {
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Information and covariance of the free parameters, the initial velocities projected out; the
/// middle of the sandwich sums over blocks of time, inside which residuals may be correlated.
struct Uncertainty {
  Eigen::MatrixXd information, covariance;  ///< in scaled coordinates
  int blocks = 0;
};

Uncertainty uncertainty(const SimulationError& problem, const Model& model, const Free& free,
                        const std::vector<double>& coordinates, const Velocities& initial,
                        const Robust& robust, double block) {
  const int n = static_cast<int>(free.index.size());
  Uncertainty result;
  result.information = Eigen::MatrixXd::Zero(n, n);
  Eigen::MatrixXd meat = Eigen::MatrixXd::Zero(n, n);
  const Eigen::VectorXd scale = Eigen::Map<const Eigen::VectorXd>(free.scale.data(), n);
  const auto durationOf = [&problem](const Window& w) {
    const std::vector<double>& times = problem.runs()[w.run].times;
    return times[w.last] - times[w.first];
  };
  double total = 0;
  for (const Window& w : problem.windows()) total += durationOf(w);
  // In short data blocks are shorter: a covariance of n parameters needs several times n of them.
  block = std::min(block, total / (4 * n));
  for (std::size_t w = 0; w < problem.windows().size(); ++w) {
    Eigen::VectorXd r;
    Eigen::MatrixXd J;
    const int window = static_cast<int>(w);
    if (!problem.residuals(model, coordinates, free.index, window, initial[w], r, &J)) continue;
    for (Eigen::Index i = 0; i < r.size(); ++i) {
      J.row(i) *= robust.derivative(r(i));
      r(i) = robust(r(i));
    }
    const Eigen::MatrixXd velocity = J.rightCols(3);
    Eigen::MatrixXd theta = J.leftCols(n) * scale.asDiagonal();
    theta -= velocity * velocity.colPivHouseholderQr().solve(theta);
    result.information += theta.transpose() * theta;

    const Window& span = problem.windows()[w];
    const int samples = span.last - span.first + 1;
    const int blocks = std::max(1, static_cast<int>(std::lround(durationOf(span) / block)));
    for (int b = 0; b < blocks; ++b) {
      const int begin = samples * b / blocks, end = samples * (b + 1) / blocks;
      const Eigen::VectorXd score = theta.middleRows(3 * begin, 3 * (end - begin)).transpose() *
                                    r.segment(3 * begin, 3 * (end - begin));
      meat += score * score.transpose();
      ++result.blocks;
    }
  }
  const Eigen::MatrixXd inverse =
      result.information.completeOrthogonalDecomposition().pseudoInverse();
  const double correction = result.blocks / std::max(1.0, double(result.blocks - n));
  result.covariance = correction * inverse * meat * inverse;
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

SimulationError::SimulationError(std::vector<RunData> runs, std::vector<Window> windows)
    : runs_(std::move(runs)), windows_(std::move(windows)) {
  if (windows_.empty())
    throw std::invalid_argument("the runs are too short: there is no window to simulate");
  for (const RunData& run : runs_) {
    const auto count = static_cast<Eigen::Index>(run.times.size());
    if (run.eta.rows() != count || run.nu.rows() != count)
      throw std::invalid_argument(run.name + ": times, eta and nu differ in length");
    if (!run.eta.allFinite() || !run.nu.allFinite())
      throw std::invalid_argument(run.name + ": a measurement is not finite");
    const Vector3<double> mean = run.nu.colwise().mean();
    const Vector3<double> sigma =
        (run.nu.rowwise() - mean.transpose()).array().square().colwise().mean().sqrt();
    if (!(sigma.minCoeff() > 0))
      throw std::invalid_argument(run.name + ": the craft does not move");
    sigma_.push_back(sigma);
  }
  for (const Window& w : windows_) {
    if (w.run < 0 || w.run >= static_cast<int>(runs_.size()) || w.first < 0 || w.last <= w.first ||
        w.last >= static_cast<int>(runs_[w.run].times.size()))
      throw std::invalid_argument("a window lies outside its run");
  }
}

bool SimulationError::residuals(const Model& model, const std::vector<double>& coordinates,
                                const std::vector<int>& free, int window,
                                const Vector3<double>& initial_nu, Eigen::VectorXd& residuals,
                                Eigen::MatrixXd* jacobian) const {
  const Window& w = windows_[window];
  const RunData& run = runs_[w.run];
  const Vector3<double> weight = sigma_[w.run].cwiseInverse();
  const int samples = w.last - w.first + 1;
  residuals.resize(3 * samples);
  const auto store = [&](int i, const Vector3<double>& nu) {
    const Vector3<double> measured = run.nu.row(w.first + i);
    residuals.segment<3>(3 * i) = (nu - measured).cwiseProduct(weight);
  };
  if (!jacobian) {
    const Dynamics<double> dynamics(model, coordinates);
    simulateWindow<double>(dynamics, run, w, initial_nu,
                           [&](int i, const Measurement<double>& m) { store(i, m.nu); });
    return residuals.allFinite();
  }
  const int columns = static_cast<int>(free.size()) + 3;
  jacobian->resize(3 * samples, columns);
  for (int begin = 0; begin < columns; begin += kPass) {
    const int count = std::min(kPass, columns - begin);
    std::vector<Jet> theta(coordinates.begin(), coordinates.end());
    Vector3<Jet> nu = initial_nu.cast<Jet>();
    for (int j = 0; j < count; ++j) {
      const int column = begin + j;
      Jet& seeded = column < static_cast<int>(free.size())
                        ? theta[free[column]]
                        : nu(column - static_cast<int>(free.size()));
      seeded.v[j] = 1;
    }
    const Dynamics<Jet> dynamics(model, theta);
    simulateWindow<Jet>(dynamics, run, w, nu, [&](int i, const Measurement<Jet>& m) {
      store(i, {m.nu.x().a, m.nu.y().a, m.nu.z().a});
      for (int c = 0; c < 3; ++c)
        jacobian->block(3 * i + c, begin, 1, count) = weight(c) * m.nu(c).v.head(count).transpose();
    });
  }
  return residuals.allFinite() && jacobian->allFinite();
}

WindowSimulation SimulationError::simulate(const Model& model) const {
  Velocities initial = measuredVelocities(*this);
  std::vector<double> none;
  const auto summary = solve(*this, model, Free(), Robust(), 50, 0, none, initial);
  if (!summary.IsSolutionUsable())
    throw std::runtime_error("the model cannot be simulated over these runs: " + summary.message);
  const Dynamics<double> dynamics(model);
  WindowSimulation result;
  for (std::size_t w = 0; w < windows_.size(); ++w) {
    const int samples = windows_[w].last - windows_[w].first + 1;
    Eigen::MatrixX3d eta(samples, 3), nu(samples, 3);
    simulateWindow<double>(dynamics, runs_[windows_[w].run], windows_[w], initial[w],
                           [&](int i, const Measurement<double>& m) {
                             eta.row(i) = m.eta;
                             nu.row(i) = m.nu;
                           });
    result.eta.push_back(eta);
    result.nu.push_back(nu);
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
  const Free free = makeFree(model, options.free);
  const int n = static_cast<int>(free.index.size());
  FitResult result;
  result.model = model;
  result.objective_before = objective(simulate(model));

  std::vector<double> scaled(n);
  for (int i = 0; i < n; ++i) scaled[i] = model.coordinates()[free.index[i]] / free.scale[i];
  Velocities initial = measuredVelocities(*this);
  const auto coordinatesNow = [&] {
    std::vector<double> coordinates = model.coordinates();
    for (int i = 0; i < n; ++i) coordinates[free.index[i]] = scaled[i] * free.scale[i];
    return coordinates;
  };
  // Plain squares come first, they have the widest basin; then the loss that was asked for.
  std::vector<double> deltas = {kInfinity};
  const bool thesis = options.objective == FitOptions::Objective::kThesis;
  if (thesis) deltas.insert(deltas.end(), {1.0, 0.3, 0.1, 0.03, 0.01});
  Robust robust;
  for (std::size_t stage = 0; stage < deltas.size() + (thesis ? 0 : 1); ++stage) {
    if (stage < deltas.size()) {
      robust.delta = deltas[stage];
    } else {
      std::vector<double> sizes;
      for (std::size_t w = 0; w < windows_.size(); ++w) {
        Eigen::VectorXd r;
        if (!residuals(model, coordinatesNow(), free.index, static_cast<int>(w), initial[w], r,
                       nullptr))
          continue;
        for (double x : r) sizes.push_back(std::abs(x));
      }
      // Twice the standard deviation that the median of absolute residuals stands for.
      robust.delta = sizes.empty() ? kInfinity : 2 * 1.4826 * medianOf(sizes);
      if (!(robust.delta > 1e-9)) break;  // an exact fit has no outliers
    }
    const auto summary =
        solve(*this, model, free, robust, options.max_iterations, options.threads, scaled, initial);
    if (!summary.IsSolutionUsable())
      throw std::runtime_error("the fit failed at its start values: " + summary.message);
    result.iterations += static_cast<int>(summary.iterations.size());
    result.converged = summary.termination_type == ceres::CONVERGENCE;
    result.message = summary.message;
  }

  const std::vector<double> coordinates = coordinatesNow();
  const auto infos = model.parameters();
  std::vector<double> values = model.values();
  for (int i = 0; i < n; ++i)
    values[free.index[i]] = infos[free.index[i]].fromCoordinate(coordinates[free.index[i]]);
  result.model.setValues(values);
  result.objective_after = objective(simulate(result.model));

  const Uncertainty u =
      uncertainty(*this, model, free, coordinates, initial, robust, options.block);
  const Eigen::VectorXd deviation = u.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  result.correlation = Eigen::MatrixXd::Identity(n, n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      if (i != j && deviation(i) * deviation(j) > 0)
        result.correlation(i, j) = u.covariance(i, j) / (deviation(i) * deviation(j));
  const Eigen::VectorXd eigen =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(u.information).eigenvalues();
  result.condition = eigen(0) > 0 ? eigen(n - 1) / eigen(0) : kInfinity;
  const boost::math::students_t t(std::max(1, u.blocks - n));
  const double quantile = boost::math::quantile(t, 0.975);
  for (int i = 0; i < n; ++i) {
    const ParameterInfo& info = infos[free.index[i]];
    const double at = coordinates[free.index[i]];
    const double half = quantile * deviation(i) * free.scale[i];
    double low = info.fromCoordinate(std::max(at - half, free.lower[i]));
    double high = info.fromCoordinate(std::min(at + half, free.upper[i]));
    if (low > high) std::swap(low, high);
    const double margin = 1e-4 * free.scale[i];
    result.parameters.push_back({info.name, info.unit, model.values()[free.index[i]],
                                 values[free.index[i]], low, high,
                                 at - free.lower[i] < margin || free.upper[i] - at < margin});
  }
  return result;
}

}  // namespace ground
