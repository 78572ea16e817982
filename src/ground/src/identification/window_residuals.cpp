// Simulations of windows against their measurements, one by one and side by side.
#include <algorithm>
#include <array>
#include <cstring>
#include <stdexcept>

#include "descent.h"
#include "ground/identification/simulation_error.h"
#include "parallel.h"
#include "whitening.h"
#include "window_plans.h"

namespace ground {
namespace {

constexpr int kPass = Jet::kDirections;  // derivatives that are taken at once
constexpr int kMostInitial = 6;
/// Lanes that have to be filled to be faster than one simulation after the other.
constexpr std::size_t kFewestLanes = 4;

/// True state whose measured pose is the given one; nu is the true velocity. A fixed point, reached
/// in two rounds: offsets of heading and position do not feed back on each other.
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

/// The state at a window's start: from an initial velocity at the measured pose, or from an initial
/// pose and velocity.
template <typename T>
RigidState<T> stateAtStart(const Dynamics<T>& dynamics, const Vector3<T>& measured,
                           const std::array<T, kMostInitial>& initial, int size) {
  if (size == 3)
    return stateMeasuredAt<T>(dynamics, measured, {initial[0], initial[1], initial[2]});
  return {{initial[0], initial[1], initial[2]}, {initial[3], initial[4], initial[5]}};
}

/// Where a simulation is taken: parameters and initial state, with derivatives by some of them.
template <typename T>
struct Variables {
  std::vector<T> coordinates;
  std::array<T, kMostInitial> initial;

  explicit Variables(const std::vector<double>& values)
      : coordinates(values.begin(), values.end()) {
    initial.fill(T(0.0));
  }
  /// Takes derivatives by the columns [begin, end): free parameters, then the initial state.
  void seed(const std::vector<int>& free, int begin, int end) {
    const int count = static_cast<int>(free.size());
    for (int column = begin; column < end; ++column)
      (column < count ? coordinates[free[column]] : initial[column - count]).v[column - begin] =
          1.0;
  }
};

/// One window's measurements, and what the simulation's distance from them is multiplied by.
struct Measured {
  const RunData* run;
  const Window* window;
  const Rows3* of;  ///< poses or velocities of the run
  bool poses;
  Vector3<double> weight;

  void prepare(int columns, WindowResiduals& result) const {
    const int rows = 3 * (window->last - window->first + 1);
    result.residuals.resize(rows);
    result.derivatives.resize(columns > 0 ? rows : 0, (columns + kPass - 1) / kPass * kPass);
  }
  void store(int sample, int c, double simulated, WindowResiduals& result) const {
    result.residuals(3 * sample + c) = (simulated - (*of)(window->first + sample, c)) * weight(c);
  }
  template <typename T>
  const Vector3<T>& seen(const Measurement<T>& measurement) const {
    return poses ? measurement.eta : measurement.nu;
  }
  Vector3<double> start() const { return run->eta.row(window->first); }
};

/// Eigen's own looks at one number at a time.
bool allFinite(const Derivatives& rows) {
  Vec8 sum = {};
  for (Eigen::Index i = 0; i < rows.size(); i += 8) {
    Vec8 part;
    std::memcpy(&part, rows.data() + i, sizeof part);
    sum += 0.0 * part;  // not a number, if one is not
  }
  for (int i = 0; i < 8; ++i)
    if (sum[i] != 0) return false;
  return true;
}

/// Simulates one window and keeps its residuals and the derivatives of one pass.
template <typename T>
void simulateOne(const Dynamics<T>& dynamics, const Measured& measured, const Variables<T>& point,
                 int initial_size, int begin, WindowResiduals& result) {
  const RunData& run = *measured.run;
  const Vector3<T> start = measured.start().template cast<T>();
  Simulation<T> simulation(dynamics, run.inputs,
                           stateAtStart(dynamics, start, point.initial, initial_size),
                           run.times[measured.window->first]);
  if (!measured.poses && !dynamics.usesPose()) simulation.forgetPose();
  const int samples = measured.window->last - measured.window->first + 1;
  for (int i = 0; i < samples; ++i) {
    simulation.advance(run.times[measured.window->first + i]);
    const Measurement<T> now = simulation.measure();
    const Vector3<T>& seen = measured.seen(now);
    for (int c = 0; c < 3; ++c) {
      measured.store(i, c, valueOf(seen(c)), result);
      if constexpr (!std::is_same_v<T, double>) {
        const Vec8 row = measured.weight(c) * seen(c).v.x;
        std::memcpy(&result.derivatives(3 * i + c, begin), &row, sizeof row);
      }
    }
  }
}

/// The same of as many windows as a plan has lanes.
template <typename T>
void simulateLanes(const Dynamics<T>& dynamics, const LanePlan& plan,
                   const std::vector<Measured>& measured, const Variables<T>& point,
                   int initial_size, int begin, int end, GroupResiduals& results) {
  Vector3<T> start(T(0.0), T(0.0), T(0.0));
  for (std::size_t lane = 0; lane < measured.size(); ++lane)
    for (int c = 0; c < 3; ++c)
      valueIn(start(c))[static_cast<int>(lane)] = measured[lane].start()(c);
  const bool pose = measured[0].poses || dynamics.usesPose();
  plan.run<T>(dynamics, stateAtStart(dynamics, start, point.initial, initial_size), pose,
              [&](const LanePlan::Sample* samples, int count, const Measurement<T>& now) {
                const Vector3<T>& seen = measured[0].seen(now);
                for (int c = 0; c < 3; ++c) {
                  Vec8 rows[kPass];  // of derivatives, one a lane
                  if constexpr (!std::is_same_v<T, Lanes>) {
                    for (int d = 0; d < kPass; ++d)
                      rows[d] = d < end - begin ? seen(c).v[d].x : Vec8{};
                    transpose(rows);
                  }
                  for (int i = 0; i < count; ++i) {
                    const auto [lane, index] = samples[i];
                    WindowResiduals& result = results[lane];
                    measured[lane].store(index, c, valueOf(seen(c))[lane], result);
                    if constexpr (std::is_same_v<T, Lanes>) continue;
                    const Vec8 row = measured[lane].weight(c) * rows[lane];
                    std::memcpy(&result.derivatives(3 * index + c, begin), &row, sizeof row);
                  }
                }
              });
}

}  // namespace

/// All windows at one point.
class SimulationError::Evaluation {
 public:
  Evaluation(const SimulationError& error, const Model& model,
             const std::vector<double>& coordinates, const std::vector<int>& free, bool derivatives)
      : error_(error),
        model_(model),
        coordinates_(coordinates),
        free_(free),
        columns_(derivatives ? static_cast<int>(free.size()) + error.initialSize() : 0) {}

  void one(int window, const Eigen::VectorXd& initial, WindowResiduals& result) const {
    const Measured measured = at(window);
    measured.prepare(columns_, result);
    inPasses<double, Jet>([&](auto& dynamics, auto& point, int begin, int) {
      for (int i = 0; i < error_.initialSize(); ++i) valueIn(point.initial[i]) = initial(i);
      simulateOne(dynamics, measured, point, error_.initialSize(), begin, result);
    });
    finish(window, result);
  }

  void together(const WindowPlans::Group& group, const std::vector<Eigen::VectorXd>& initial,
                GroupResiduals& results) const {
    std::vector<Measured> measured;
    for (std::size_t lane = 0; lane < group.windows.size(); ++lane) {
      measured.push_back(at(group.windows[lane]));
      measured.back().prepare(columns_, results[lane]);
    }
    inPasses<Lanes, LanesJet>([&](auto& dynamics, auto& point, int begin, int end) {
      for (int i = 0; i < error_.initialSize(); ++i) {
        Lanes& values = valueIn(point.initial[i]);
        for (std::size_t lane = 0; lane < group.windows.size(); ++lane)
          values[static_cast<int>(lane)] = initial[group.windows[lane]](i);
      }
      dynamics.useDirections(end - begin);
      simulateLanes(dynamics, group.plan, measured, point, error_.initialSize(), begin, end,
                    results);
    });
    for (std::size_t lane = 0; lane < group.windows.size(); ++lane)
      finish(group.windows[lane], results[lane]);
  }

  WindowPlans::Groups groups() const {
    // Whether the delay varies must not differ from pass to pass.
    Variables<Jet> point(coordinates_);
    for (const int parameter : free_) point.coordinates[parameter].v[0] = 1.0;
    const Jet delay = Dynamics<Jet>(model_, point.coordinates).inputDelay();
    return error_.plans_->get(error_.runs(), error_.windows_, delay.a, !delay.isConstant());
  }

 private:
  Measured at(int window) const {
    const Window& w = error_.windows_[window];
    const bool poses = error_.target_ == Target::kPoses;
    const Vector3<double> weight =
        poses ? Vector3<double>(1, 1, 1) : Vector3<double>(error_.sigma(w.run).cwiseInverse());
    return {&error_.runs()[w.run], &w, &error_.data_->measured[w.run], poses, weight};
  }

  /// Calls simulate(dynamics, point, begin, end) for each pass of derivatives, or once without.
  template <typename V, typename D, class Simulate>
  void inPasses(const Simulate& simulate) const {
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

  void finish(int window, WindowResiduals& result) const {
    result.window = window;
    if (error_.target_ == Target::kPoses) {
      error_.whitening_[window].apply(result.residuals);
      if (columns_ > 0) error_.whitening_[window].apply(result.derivatives);
    }
    result.finite = result.residuals.allFinite() && allFinite(result.derivatives);
  }

  const SimulationError& error_;
  const Model& model_;
  const std::vector<double>& coordinates_;
  const std::vector<int>& free_;
  int columns_;
};

WindowResiduals SimulationError::residuals(const Model& model,
                                           const std::vector<double>& coordinates,
                                           const std::vector<int>& free, int window,
                                           const Eigen::VectorXd& initial, bool derivatives) const {
  WindowResiduals result;
  Evaluation(*this, model, coordinates, free, derivatives).one(window, initial, result);
  return result;
}

void SimulationError::residuals(const Model& model, const std::vector<double>& coordinates,
                                const std::vector<int>& free,
                                const std::vector<Eigen::VectorXd>& initial, bool derivatives,
                                int threads,
                                const std::function<void(const WindowResiduals&)>& visit) const {
  const Evaluation evaluation(*this, model, coordinates, free, derivatives);
  const WindowPlans::Groups groups = evaluation.groups();
  inParallel(groups->size(), threads, [&](std::size_t g) {
    std::unique_ptr<GroupResiduals> results = plans_->borrow();
    const WindowPlans::Group& group = (*groups)[g];
    const std::size_t count = group.windows.size();
    if (count >= kFewestLanes) {
      evaluation.together(group, initial, *results);
      for (std::size_t lane = 0; lane < count; ++lane) visit((*results)[lane]);
    } else {
      for (const int window : group.windows) {
        evaluation.one(window, initial[window], results->front());
        visit(results->front());
      }
    }
    plans_->giveBack(std::move(results));
  });
}

WindowSimulation SimulationError::simulateFrom(const Model& model,
                                               const std::vector<Eigen::VectorXd>& initial) const {
  WindowSimulation result;
  const Dynamics<double> dynamics(model);
  for (std::size_t w = 0; w < windows_.size(); ++w) {
    const Window& window = windows_[w];
    const RunData& run = runs()[window.run];
    const int samples = window.last - window.first + 1;
    Eigen::MatrixX3d eta(samples, 3), nu(samples, 3);
    std::array<double, kMostInitial> from{};
    std::copy(initial[w].begin(), initial[w].end(), from.begin());
    const Vector3<double> start = run.eta.row(window.first);
    Simulation<double> simulation(dynamics, run.inputs,
                                  stateAtStart(dynamics, start, from, initialSize()),
                                  run.times[window.first]);
    for (int i = 0; i < samples; ++i) {
      simulation.advance(run.times[window.first + i]);
      const Measurement<double> seen = simulation.measure();
      eta.row(i) = seen.eta;
      nu.row(i) = seen.nu;
    }
    if (!eta.allFinite() || !nu.allFinite())
      throw std::runtime_error(notFinite(*this, static_cast<int>(w)));
    result.eta.push_back(std::move(eta));
    result.nu.push_back(std::move(nu));
  }
  return result;
}

}  // namespace ground
