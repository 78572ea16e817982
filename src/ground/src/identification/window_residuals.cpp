#include "window_residuals.h"

#include <algorithm>
#include <array>
#include <stdexcept>

#include "checks.h"
#include "simulation_error_data.h"

namespace ground::detail {
namespace {

constexpr int kPass = Jet::kDirections;  // derivatives per pass
constexpr int kMaxInitial = 6;           // largest size of an initial state

/// True state whose measured pose is the given one; nu is the true velocity. A fixed-point
/// iteration that converges in two rounds, because the position offset depends on the heading but
/// not vice versa.
template <typename T>
RigidState<T> stateMeasuredAt(const Dynamics<T>& dynamics, const Vector3<T>& measured,
                              const Vector3<T>& nu) {
  RigidState<T> state{measured, nu};
  for (int i = 0; i < 2; ++i) {
    const Vector3<T> seen = dynamics.measure(state).eta;
    for (int c = 0; c < 3; ++c) state.eta(c) += measured(c) - seen(c);
  }
  return state;
}

/// The state at a window's start: the measured pose and an initial velocity, or an initial pose and
/// velocity.
template <typename T>
RigidState<T> stateAtStart(const Dynamics<T>& dynamics, const Vector3<T>& measured,
                           const std::array<T, kMaxInitial>& initial, int size) {
  if (size == 3)
    return stateMeasuredAt<T>(dynamics, measured, {initial[0], initial[1], initial[2]});
  return {{initial[0], initial[1], initial[2]}, {initial[3], initial[4], initial[5]}};
}

/// Parameters and initial state of a simulation, with derivatives by some of them.
template <typename T>
struct Variables {
  std::vector<T> coordinates;
  std::array<T, kMaxInitial> initial;

  explicit Variables(const std::vector<double>& values)
      : coordinates(values.begin(), values.end()) {
    initial.fill(T(0.0));
  }
  /// Makes the columns [begin, end) variables; columns are the free parameters, then the initial
  /// state.
  void seed(const std::vector<int>& free, int begin, int end) {
    const int count = static_cast<int>(free.size());
    for (int column = begin; column < end; ++column)
      (column < count ? coordinates[free[column]] : initial[column - count]).v[column - begin] =
          1.0;
  }
};

/// Faster than Eigen's allFinite(), which tests one number at a time.
bool allFinite(const Derivatives& rows) {
  Vec8 sum = {};
  for (Eigen::Index i = 0; i < rows.size(); i += 8) {
    sum += 0.0 * registers::load<Vec8>(rows.data() + i);  // NaN if a number is not finite
  }
  return registers::allOf(sum == Vec8{});
}

}  // namespace

Evaluation::Evaluation(const SimulationError& error, const Model& model,
                       const std::vector<double>& coordinates, const std::vector<int>& free,
                       bool derivatives)
    : error_(error),
      model_(model),
      coordinates_(coordinates),
      free_(free),
      columns_(derivatives ? static_cast<int>(free.size()) + error.initialSize() : 0) {}

WindowPlans::Groups Evaluation::groups() const {
  // All passes must agree on whether the delay varies.
  Variables<Jet> point(coordinates_);
  for (const int parameter : free_) point.coordinates[parameter].v[0] = 1.0;
  const Dynamics<Jet> dynamics(model_, point.coordinates);
  const Jet& delay = dynamics.inputDelay();
  return error_.plans_->get(error_.runs(), error_.windows_, error_.data_->measured,
                            error_.data_->weight, delay.a, !delay.isConstant(),
                            dynamics.settling());
}

/// Calls simulate(dynamics, point, begin, end) for each pass of derivatives, or once without
/// derivatives.
template <typename V, typename D, class Simulate>
void Evaluation::inPasses(const Simulate& simulate) const {
  if (columns_ == 0) {
    Variables<V> point(coordinates_);
    Dynamics<V> dynamics(model_, point.coordinates);
    simulate(dynamics, point, 0, 0);
  }
  for (int begin = 0; begin < columns_; begin += kPass) {
    const int end = std::min(columns_, begin + kPass);
    Variables<D> point(coordinates_);
    point.seed(free_, begin, end);
    Dynamics<D> dynamics(model_, point.coordinates);
    simulate(dynamics, point, begin, end);
  }
}

void Evaluation::one(int window, const Eigen::VectorXd& initial, WindowResiduals& result) const {
  const Window& span = error_.windows_[window];
  const RunData& run = error_.runs()[span.run];
  const Rows3& measured = error_.data_->measured[span.run];
  const Vector3<double>& weight = error_.data_->weight[span.run];
  const Motion motion = motionOf(run);
  const bool poses = error_.target_ == Target::kPoses;
  const int samples = span.last - span.first + 1, size = error_.initialSize();
  result.window = window;
  result.residuals.resize(3 * samples);
  result.derivatives.resize(columns_ > 0 ? 3 * samples : 0, (columns_ + kPass - 1) / kPass * kPass);
  inPasses<double, Jet>([&](const auto& dynamics, auto& point, int begin, int) {
    using T = std::decay_t<decltype(point.initial[0])>;
    for (int i = 0; i < size; ++i) valueIn(point.initial[i]) = initial(i);
    const Vector3<T> start = run.eta.row(span.first).template cast<T>();
    Simulation<T> simulation(dynamics, run.inputs,
                             stateAtStart(dynamics, start, point.initial, size),
                             run.times[span.first], kDefaultStep, &motion);
    if (!poses && !dynamics.usesPose()) simulation.forgetPose();
    for (int i = 0; i < samples; ++i) {
      simulation.advance(run.times[span.first + i]);
      const Measurement<T> now = simulation.measure();
      const Vector3<T>& seen = poses ? now.eta : now.nu;
      for (int c = 0; c < 3; ++c) {
        result.residuals(3 * i + c) = (valueOf(seen(c)) - measured(span.first + i, c)) * weight(c);
        if constexpr (!std::is_same_v<T, double>) {
          const Lanes row = Lanes::of(seen(c).v.x) * Lanes(weight(c));
          registers::store(row.x, &result.derivatives(3 * i + c, begin));
        }
      }
    }
  });
  result.finite = result.residuals.allFinite() && allFinite(result.derivatives);
}

void Evaluation::together(const WindowPlans::Group& group,
                          const std::vector<Eigen::VectorXd>& initial, LaneRows& result) const {
  const bool poses = error_.target_ == Target::kPoses;
  const int lanes = static_cast<int>(group.windows.size()), size = error_.initialSize();
  result.prepare(3 * group.plan.visits(), columns_);
  inPasses<Lanes, LanesJet>([&](auto& dynamics, auto& point, int begin, int end) {
    using T = std::decay_t<decltype(point.initial[0])>;
    Vector3<T> start(T(0.0), T(0.0), T(0.0));
    for (int lane = 0; lane < lanes; ++lane) {
      const Window& span = error_.windows_[group.windows[lane]];
      for (int c = 0; c < 3; ++c)
        valueIn(start(c))[lane] = error_.runs()[span.run].eta(span.first, c);
      for (int i = 0; i < size; ++i)
        valueIn(point.initial[i])[lane] = initial[group.windows[lane]](i);
    }
    dynamics.useDirections(end - begin);
    const int directions = end - begin;
    group.plan.run<T>(
        dynamics, stateAtStart(dynamics, start, point.initial, size), poses || dynamics.usesPose(),
        [&](int visit, const Vector3<T>& eta, const Vector3<T>& nu) {
          const Vector3<T>& seen = poses ? eta : nu;
          for (int c = 0; c < 3; ++c) {
            const int row = 3 * visit + c;
            const Lanes& weight = group.weight[visit][c];
            result.residuals[row] = (valueOf(seen(c)) - group.measured[visit][c]) * weight;
            if constexpr (!std::is_same_v<T, Lanes>) {
              Lanes* derivatives = &result.derivatives[row * result.stride + begin];
              for (int d = 0; d < directions; ++d) derivatives[d] = seen(c).v[d] * weight;
            }
          }
        });
  });
}

WindowResiduals residualsOf(const SimulationError& problem, const Model& model,
                            const std::vector<double>& coordinates, const std::vector<int>& free,
                            int window, const Eigen::VectorXd& initial, bool derivatives) {
  WindowResiduals result;
  Evaluation(problem, model, coordinates, free, derivatives).one(window, initial, result);
  return result;
}

WindowSimulation simulateFrom(const SimulationError& problem, const Model& model,
                              const Initials& initial) {
  WindowSimulation result;
  const Dynamics<double> dynamics(model);
  for (std::size_t w = 0; w < problem.windows().size(); ++w) {
    const Window& window = problem.windows()[w];
    const RunData& run = problem.runs()[window.run];
    const Motion measured = motionOf(run);
    const int samples = window.last - window.first + 1;
    Eigen::MatrixX3d eta(samples, 3), nu(samples, 3);
    std::array<double, kMaxInitial> from{};
    std::copy(initial[w].begin(), initial[w].end(), from.begin());
    const Vector3<double> start = run.eta.row(window.first);
    Simulation<double> simulation(dynamics, run.inputs,
                                  stateAtStart(dynamics, start, from, problem.initialSize()),
                                  run.times[window.first], kDefaultStep, &measured);
    for (int i = 0; i < samples; ++i) {
      simulation.advance(run.times[window.first + i]);
      const Measurement<double> seen = simulation.measure();
      eta.row(i) = seen.eta;
      nu.row(i) = seen.nu;
    }
    if (!eta.allFinite() || !nu.allFinite())
      throw std::runtime_error(notFinite(run, window));
    result.eta.push_back(std::move(eta));
    result.nu.push_back(std::move(nu));
  }
  return result;
}

}  // namespace ground::detail
