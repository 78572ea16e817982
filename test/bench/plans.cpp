// How good and how fast the plans of ModelPredictive are.
//
// plans warm [SECONDS]: closed loops with noise. Processor time of the decisions,
// their improvements, their costs above those of the plans improved further, the tracking error.
// plans deadline [MILLISECONDS] [COUNT] [HOGS]: decisions far from the reference that end in time,
// beside HOGS busy processes for each core, at real-time priority where the system grants it.
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "peer_plans/plan_cases.h"

namespace ground {
namespace {

using namespace plan_cases;

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

struct Decisions {
  std::vector<double> times;     ///< [s]
  std::vector<double> excesses;  ///< of costs, relative to the plan improved further
  double squares = 0;            ///< sum of squares of the tracking error [m^2]
  long improvements = 0;
};

/// Sets the problem of a controller's plan.
void setProblem(TrajectoryOptimizer& optimizer, const TrajectoryOptimizer& plan,
                const ReferenceTrajectory& reference, double since) {
  std::vector<ReferencePoint> points;
  for (int k = 1; k <= plan.steps(); ++k)
    points.push_back(reference.at(std::max(0.0, since + plan.step() * k)));
  optimizer.setProblem(since, plan.states().front(), {1, std::nullopt}, plan.missing(), points);
}

/// The cost of a plan above that of the plan improved until it gets no better, relative to the latter.
double excess(TrajectoryOptimizer& optimizer, const TrajectoryOptimizer& plan) {
  optimizer.newInputs() = plan.inputs();
  const double cost = optimizer.rollOut();
  int idle = 0;
  for (int i = 0; i < 200 && idle < 5; ++i) {
    const double before = optimizer.cost();
    idle = optimizer.improve() && before - optimizer.cost() > 1e-12 * before ? 0 : idle + 1;
  }
  return cost / optimizer.cost() - 1;
}

void fly(const Model& model, const ReferencePtr& reference, double seconds, Decisions& seen) {
  PredictiveControl control(model, {});
  const PredictiveParams params;
  const auto best = std::make_unique<TrajectoryOptimizer>(model, params.steps, params.horizon / params.steps);
  Flight flight(model, reference);
  for (int i = 0; i < seconds / kPeriod; ++i) {
    const double t = i * kPeriod;
    const Observation observation = flight.observe(t);
    const double before = processorTime();
    const Thrusters<double> chosen = control.decide(observation);
    const double took = processorTime() - before;
    if (t > 1) {
      setProblem(*best, control.plan(), *reference, t);
      seen.times.push_back(took);
      seen.excesses.push_back(excess(*best, control.plan()));
      seen.squares += std::pow(flight.error(t), 2);
      seen.improvements += control.improvements();
    }
    control.commanded(t, chosen, 1);
    flight.command(t, chosen);
  }
}

void warm(double seconds) {
  const Model model = craft();
  for (const auto& [name, reference] : references()) {
    Decisions seen;
    fly(model, reference, seconds, seen);
    const double count = static_cast<double>(seen.times.size());
    std::printf(
        "%-8s %.4f ms median, %.3f ms 99.9%%; %.2f improvements; cost above the least %.1g median, "
        "%.1g 99%%; error %.4f mm\n",
        name.c_str(), 1e3 * quantile(seen.times, 0.5), 1e3 * quantile(seen.times, 0.999),
        static_cast<double>(seen.improvements) / count, quantile(seen.excesses, 0.5),
        quantile(seen.excesses, 0.99), 1e3 * std::sqrt(seen.squares / count));
  }
}

/// Asks for real-time priority and locked memory; returns why they are not granted, or "".
std::string askForRealTime() {
  sched_param wanted{};
  wanted.sched_priority = 40;
  if (sched_setscheduler(0, SCHED_FIFO, &wanted) != 0 || mlockall(MCL_CURRENT | MCL_FUTURE) != 0)
    return std::strerror(errno);
  return "";
}

/// Busy processes that end with this object.
class Hogs {
 public:
  explicit Hogs(int count) {
    for (int i = 0; i < count; ++i) {
      const pid_t hog = fork();
      if (hog == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        const sched_param usual{};
        sched_setscheduler(0, SCHED_OTHER, &usual);
        for (volatile unsigned turns = 0;; turns = turns + 1) {
        }
      }
      if (hog > 0) all_.push_back(hog);
    }
  }
  ~Hogs() {
    for (const pid_t hog : all_) {
      kill(hog, SIGKILL);
      waitpid(hog, nullptr, 0);
    }
  }

 private:
  std::vector<pid_t> all_;
};

void keepDeadline(double milliseconds, int count, int hogs_per_core) {
  using Clock = std::chrono::steady_clock;
  const auto now = [] { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); };
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
  const Hogs hogs(hogs_per_core * static_cast<int>(std::thread::hardware_concurrency()));
  const std::string refused = askForRealTime();
  for (int i = 0; i < count; ++i) {
    // A controller waits for the next pose; the system stops real-time processes that never do.
    std::this_thread::sleep_for(std::chrono::microseconds(200));
    if (i % 10 == 0) {
      control.reset();
      state.eta << 3 * uniform(random), 3 * uniform(random), M_PI * uniform(random);
    }
    const double t = kPeriod * (i % 10), began = now();
    control.decide(
        {t, t, state, circle.get(), 0, {1.0, std::nullopt}, 0, poseMeasurement(state.eta, 3e-4, 5e-3)});
    times.push_back(now() - began);
    in_time += times.back() <= params.deadline;
  }
  std::printf("%s: ", refused.empty() ? "real-time priority" : refused.c_str());
  std::printf("%d of %d decisions in %g ms; %.3f ms median, %.3f ms 99.9%%, %.3f ms at most\n", in_time,
              count, milliseconds, 1e3 * quantile(times, 0.5), 1e3 * quantile(times, 0.999),
              1e3 * quantile(times, 1));
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (!words.empty() && words[0] == "warm") {
    ground::warm(words.size() > 1 ? std::stod(words[1]) : 60);
  } else if (!words.empty() && words[0] == "deadline") {
    ground::keepDeadline(words.size() > 1 ? std::stod(words[1]) : 2,
                         words.size() > 2 ? std::stoi(words[2]) : 100000,
                         words.size() > 3 ? std::stoi(words[3]) : 2);
  } else {
    std::puts("plans warm [SECONDS] | plans deadline [MILLISECONDS] [COUNT] [HOGS]");
    return 1;
  }
  return 0;
}
