// How good and how fast the plans of ModelPredictive are.
//
// plans warm [SECONDS] [EFFECT=VALUE...]: closed loops with noise. Processor time of the decisions,
// their improvements, the excess of their costs over those of a twin with 50 iterations, and the
// tracking error.
// plans cold [COUNT]: first decisions far from the reference. How many plans are as good as the
// best that any start reached, after one decision and after more decisions on the same problem.
// plans deadline [MILLISECONDS] [COUNT]: decisions far from the reference that end in time.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "ground/control/predictive_control.h"
#include "ground/control/reference_trajectory.h"
#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"

namespace ground {
namespace {

constexpr double kPeriod = 0.02;  // [s]

double processorTime() {
  timespec time;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

Model craft() {
  return loadModel(std::string(GROUND_WORKSPACE) + "/cfg/hovercraft/tiny_whoover_4_1.yaml");
}

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

/// The references of `make bench-tracking`.
std::vector<std::pair<std::string, ReferencePtr>> references() {
  return {{"circle", makeCircle({0, 0}, 2, 0.63)},
          {"rhodonea", makeRhodonea({0, 0}, 2, 1.5, 0.3)},
          {"sinusoid", makeSinusoid({0, 0}, 0.5, 1, 0.6)},
          {"line", makeLine({0, 0}, {2.5, 2.5}, 0.5, false)}};
}

struct Decisions {
  std::vector<double> times;           ///< [s]
  double costs = 0, least_costs = 0;   ///< sums: of the plans, and of those of the twin
  double squares = 0;                  ///< sum of squares of the tracking error [m^2]
  long improvements = 0;
};

void fly(const Model& model, const ReferencePtr& reference, double seconds, Decisions& seen) {
  PredictiveControl control(model, {});
  PredictiveParams thorough;
  thorough.iterations = 50;
  PredictiveControl twin(model, thorough);
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const Dynamics<double> dynamics(model);
  InputSequence inputs;
  RigidState<double> start;
  start.eta.head<2>() = reference->at(0).p;
  start.eta.z() = std::atan2(reference->at(0).p_dot.y(), reference->at(0).p_dot.x());
  Simulation<double> simulation(dynamics, inputs, start, 0);
  for (int i = 0; i < seconds / kPeriod; ++i) {
    const double t = i * kPeriod;
    simulation.advance(t);
    RigidState<double> measured = simulation.state();
    for (int j = 0; j < 3; ++j) {
      measured.eta(j) += (j == 2 ? 1e-3 : 3e-4) * normal(random);
      measured.nu(j) += (j == 2 ? 2e-2 : 5e-3) * normal(random);
    }
    const Observation observation{t, t, measured, reference.get(), 0, 1.0, 0};
    const double before = processorTime();
    const Thrusters<double> chosen = control.decide(observation);
    const double took = processorTime() - before;
    twin.decide(observation);
    if (t > 1) {
      seen.times.push_back(took);
      seen.costs += control.plan().cost();
      seen.least_costs += twin.plan().cost();
      seen.squares += (simulation.state().eta.head<2>() - reference->at(t).p).squaredNorm();
      seen.improvements += control.improvements();
    }
    control.commanded(t, chosen, 1);
    twin.commanded(t, chosen, 1);
    inputs.add(t, chosen, 1);
  }
}

void warm(double seconds, const std::vector<std::string>& effects) {
  Model model = craft();
  for (const std::string& effect : effects) {
    const auto equals = effect.find('=');
    model.addEffect(makeEffect(effect.substr(0, equals)));
    model.effects.back().values.assign(model.effects.back().values.size(),
                                       std::stod(effect.substr(equals + 1)));
  }
  for (const auto& [name, reference] : references()) {
    Decisions seen;
    fly(model, reference, seconds, seen);
    const double count = static_cast<double>(seen.times.size());
    std::printf(
        "%-8s %.4f ms median, %.3f ms 99.9%%; %.2f improvements; costs %.3g above the least; "
        "error %.4f mm\n",
        name.c_str(), 1e3 * quantile(seen.times, 0.5), 1e3 * quantile(seen.times, 0.999),
        static_cast<double>(seen.improvements) / count, seen.costs / seen.least_costs - 1,
        1e3 * std::sqrt(seen.squares / count));
  }
}

/// Least cost of the plans from `starts` random inputs.
double bestOfMany(TrajectoryOptimizer& plan, int starts, std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  double best = INFINITY;
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

void cold(int count) {
  const Model model = craft();
  const PredictiveParams params;
  const double step = params.horizon / params.steps;
  const std::unique_ptr<TrajectoryOptimizer> many =
      TrajectoryOptimizer::make(model, params.steps, step);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto all = references();
  constexpr std::array<int, 4> kDecisions = {1, 5, 20, 50};
  struct {
    std::array<int, kDecisions.size()> exact{}, good{};
    int problems = 0;
  } found[2];
  std::vector<double> times;
  for (int i = 0; i < count; ++i) {
    const bool mild = i % 2 == 0;
    auto& set = found[mild ? 0 : 1];
    const ReferencePtr& reference = all[static_cast<std::size_t>(i / 2) % all.size()].second;
    const double since = 10 * (1 + uniform(random));
    const ReferencePoint at = reference->at(since);
    RigidState<double> start;
    const double far = mild ? 0.5 : 3, turned = mild ? 1 : M_PI, fast = mild ? 0.3 : 1;
    start.eta << at.p.x() + far * uniform(random), at.p.y() + far * uniform(random),
        std::atan2(at.p_dot.y(), at.p_dot.x()) + turned * uniform(random);
    start.nu << fast * (0.5 + 0.5 * uniform(random)), 0.3 * fast * uniform(random),
        2 * fast * uniform(random);
    PredictiveControl control(model, params);
    const Observation seen{since, since, start, reference.get(), 0, 1.0, 0};
    std::array<double, kDecisions.size()> costs{};
    int decisions = 0;
    for (std::size_t j = 0; j < kDecisions.size(); ++j) {
      for (; decisions < kDecisions[j]; ++decisions) {
        const double before = processorTime();
        control.decide(seen);
        if (decisions == 0) times.push_back(processorTime() - before);
      }
      costs[j] = control.plan().cost();
    }
    TrajectoryOptimizer::State state = TrajectoryOptimizer::State::Zero();
    state.head<3>() = start.eta;
    state.segment<3>(3) = start.nu;
    std::vector<ReferencePoint> points;
    for (int k = 1; k <= params.steps; ++k) points.push_back(reference->at(since + step * k));
    many->setProblem(since, state, 1, Vector3<double>::Zero(), points);
    const double best = std::min(bestOfMany(*many, 60, random), costs.back());
    ++set.problems;
    for (std::size_t j = 0; j < kDecisions.size(); ++j) {
      set.exact[j] += costs[j] < (1 + 1e-4) * best;
      set.good[j] += costs[j] < 1.01 * best;
    }
  }
  for (const auto& set : found)
    for (std::size_t j = 0; j < kDecisions.size(); ++j)
      std::printf("%s starts, %2d decisions: within 1%% of the best %5.1f%%, within 1e-4 %5.1f%%\n",
                  &set == found ? "near" : "far ", kDecisions[j],
                  100.0 * set.good[j] / set.problems, 100.0 * set.exact[j] / set.problems);
  std::printf("first decision: %.3f ms median, %.3f ms 99%%\n", 1e3 * quantile(times, 0.5),
              1e3 * quantile(times, 0.99));
}

void keepDeadline(double milliseconds, int count) {
  using Clock = std::chrono::steady_clock;
  const auto now = [] {
    return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
  };
  PredictiveParams params;
  params.deadline = 1e-3 * milliseconds;
  PredictiveControl control(craft(), params);
  control.setClock(now);
  const ReferencePtr circle = makeCircle({0, 0}, 2, 0.63);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  RigidState<double> state;
  std::vector<double> times;
  int in_time = 0;
  for (int i = 0; i < count; ++i) {
    if (i % 10 == 0) {
      control.reset();
      state.eta << 3 * uniform(random), 3 * uniform(random), M_PI * uniform(random);
    }
    const double t = kPeriod * (i % 10), began = now();
    control.decide({t, t, state, circle.get(), 0, 1.0, 0});
    times.push_back(now() - began);
    in_time += times.back() <= params.deadline;
  }
  std::printf("%d of %d decisions in %g ms; %.3f ms median, %.3f ms 99.9%%, %.3f ms at most\n",
              in_time, count, milliseconds, 1e3 * quantile(times, 0.5),
              1e3 * quantile(times, 0.999), 1e3 * quantile(times, 1));
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (!words.empty() && words[0] == "cold") {
    ground::cold(words.size() > 1 ? std::stoi(words[1]) : 240);
  } else if (!words.empty() && words[0] == "warm") {
    const std::vector<std::string> effects(words.begin() + std::min(2, argc - 1), words.end());
    ground::warm(words.size() > 1 ? std::stod(words[1]) : 60, effects);
  } else if (!words.empty() && words[0] == "deadline") {
    ground::keepDeadline(words.size() > 1 ? std::stod(words[1]) : 2,
                         words.size() > 2 ? std::stoi(words[2]) : 100000);
  } else {
    std::puts(
        "plans warm [SECONDS] [EFFECT=VALUE...] | plans cold [COUNT] | "
        "plans deadline [MILLISECONDS] [COUNT]");
    return 1;
  }
  return 0;
}
