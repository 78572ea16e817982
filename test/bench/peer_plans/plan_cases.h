// The problems on which plans are measured: decisions in flight, and starts far from a reference.
#pragma once

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "ground/control/predictive_control.h"
#include "ground/control/reference_trajectory.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"

namespace ground {
namespace plan_cases {

constexpr double kPeriod = 0.02;  // time between decisions [s]

/// Processor time of this thread [s].
inline double processorTime() {
  timespec time;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

inline Model craft() {
  return loadModel(std::string(GROUND_WORKSPACE) + "/cfg/hovercraft/tiny_whoover_4_1.yaml");
}

/// The references of `make bench-tracking`.
inline std::vector<std::pair<std::string, ReferencePtr>> references() {
  return {{"circle", makeCircle({0, 0}, 2, 0.63)},
          {"rhodonea", makeRhodonea({0, 0}, 2, 1.5, 0.3)},
          {"sinusoid", makeSinusoid({0, 0}, 0.5, 1, 0.6)},
          {"line", makeLine({0, 0}, {2.5, 2.5}, 0.5, false)}};
}

/// A simulated craft that starts at rest on a reference, measured with noise.
class Flight {
 public:
  Flight(const Model& model, ReferencePtr reference)
      : reference_(std::move(reference)),
        dynamics_(model),
        simulation_(dynamics_, inputs_, startOn(*reference_), 0) {}

  /// The measurement at t [s], for a controller.
  Observation observe(double t) {
    simulation_.advance(t);
    RigidState<double> measured = simulation_.state();
    for (int j = 0; j < 3; ++j) {
      measured.eta(j) += (j == 2 ? 1e-3 : 3e-4) * normal_(random_);
      measured.nu(j) += (j == 2 ? 2e-2 : 5e-3) * normal_(random_);
    }
    return {t,        t,
            measured, reference_.get(),
            0,        {1.0, std::nullopt},
            0,        poseMeasurement(measured.eta, 3e-4, 5e-3)};
  }
  void command(double t, const Thrusters<double>& chosen) { inputs_.add(t, chosen, 1); }
  /// Distance from the reference [m].
  double error(double t) const { return (simulation_.state().eta.head<2>() - reference_->at(t).p).norm(); }

 private:
  static RigidState<double> startOn(const ReferenceTrajectory& reference) {
    RigidState<double> start;
    const ReferencePoint first = reference.at(0);
    start.eta << first.p, std::atan2(first.p_dot.y(), first.p_dot.x());
    return start;
  }

  ReferencePtr reference_;
  std::mt19937 random_{1};
  std::normal_distribution<double> normal_;
  Dynamics<double> dynamics_;
  InputSequence inputs_;
  Simulation<double> simulation_;
};

/// A start near a reference (0.5 m, 1 rad) or far from it (3 m, any heading).
struct ColdStart {
  ReferencePtr reference;
  bool is_near;
  double since;  ///< time of the reference [s]
  RigidState<double> state;

  Observation observation() const {
    return {since, since,
            state, reference.get(),
            0,     {1.0, std::nullopt},
            0,     poseMeasurement(state.eta, 3e-4, 5e-3)};
  }
};

/// Number i of the starts: by turns near and far, on each of the references.
inline ColdStart coldStart(unsigned i) {
  std::mt19937 random(i);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto all = references();
  ColdStart start{all[(i / 2) % all.size()].second, i % 2 == 0, 10 * (1 + uniform(random)), {}};
  const ReferencePoint at = start.reference->at(start.since);
  const double far = start.is_near ? 0.5 : 3, turned = start.is_near ? 1 : M_PI,
               fast = start.is_near ? 0.3 : 1;
  start.state.eta << at.p.x() + far * uniform(random), at.p.y() + far * uniform(random),
      std::atan2(at.p_dot.y(), at.p_dot.x()) + turned * uniform(random);
  start.state.nu << fast * (0.5 + 0.5 * uniform(random)), 0.3 * fast * uniform(random),
      2 * fast * uniform(random);
  return start;
}

/// Least cost of the plans from `starts` random inputs for the optimizer's problem, each improved
/// until nothing changes.
inline double bestOfMany(TrajectoryOptimizer& plan, int starts, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  double best = std::numeric_limits<double>::infinity();
  for (int start = 0; start < starts; ++start) {
    Thrusters<double> held = Thrusters<double>::zero(2);
    const int pieces = 1 + start % 8;
    for (int k = 0; k < plan.steps(); ++k) {
      if (k % ((plan.steps() + pieces - 1) / pieces) == 0)
        for (int side = 0; side < 2; ++side) held(side) = uniform(random);
      plan.newInputs()[static_cast<std::size_t>(k)] = held;
    }
    plan.rollOut();
    int idle = 0;
    for (int i = 0; i < 200 && idle < 12; ++i) {
      const double before = plan.cost();
      idle = plan.improve() && before - plan.cost() > 1e-9 * before ? 0 : idle + 1;
    }
    best = std::min(best, plan.cost());
  }
  return best;
}

}  // namespace plan_cases
}  // namespace ground
