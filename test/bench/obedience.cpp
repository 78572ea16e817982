// How soon a craft that hears nothing is noticed by its motion, and how often one that hears is
// blamed: ObedienceMonitor over simulated runs, of crafts that are other than the model.
//   obedience [SEEDS [DRIVE]]    a table, of the drives whose name contains DRIVE; exit status 1 when a craft that hears was blamed
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <future>
#include <random>
#include <string>
#include <vector>

#include "ground/estimation/obedience_monitor.h"
#include "ground/estimation/velocity_estimator.h"
#include "ground/model/model_file.h"
#include "ground/simulation/experiment.h"

namespace ground {
namespace {

constexpr double kDuration = 60;  // of a run [s]
constexpr double kTimeout = 1.0;  // the sender's obedience_timeout [s]

struct Drive {
  std::string name;
  std::string controller, reference;
};
struct Craft {
  std::string name;
  std::function<void(Model&, std::mt19937&)> make;  ///< of the ground's model, for one seed
};
struct Verdict {
  double blamed = -1;  ///< when [s]; never: -1
  double most = -1e9;  ///< evidence over the monitor's duration
  double error = 0;    ///< from the reference when blamed [m]
};

Verdict judge(const Model& model, const ExperimentLog& log, bool tracks) {
  ObedienceMonitor monitor(model);
  const auto estimator = makeKalmanEstimator({});
  Verdict verdict;
  std::size_t next = 0, reference = 0;
  for (const MocapFrame& frame : log.frames) {
    for (; next < log.commands.size() && log.commands[next].time <= frame.delivered; ++next) {
      const ExperimentLog::Command& c = log.commands[next];
      monitor.command(c.time, model.body.input_max * Vector2<double>(c.left, c.right), c.lift);
    }
    const StateEstimate& e = estimator->update(frame.captured, frame.eta);
    if (!e.valid || !e.used) continue;
    monitor.measure(frame.captured, {e.eta, e.nu}, e.nu_covariance.diagonal());
    for (double span : {kTimeout, 2 * kTimeout, 4 * kTimeout})
      verdict.most = std::max(verdict.most, monitor.evidence(span));
    while (reference + 1 < log.references.size() &&
           log.references[reference + 1].time <= frame.captured)
      ++reference;
    if (!monitor.disobeys(kTimeout)) continue;
    verdict.blamed = frame.delivered;
    if (tracks && !log.references.empty())
      verdict.error = (frame.eta.head<2>() - log.references[reference].point.p).norm();
    break;
  }
  return verdict;
}

/// Hears all, or nothing from some instant on (0: from the start).
Verdict run(const Model& model, const Drive& drive, const Craft& craft, unsigned long seed,
            double deaf_from) {
  std::mt19937 random(static_cast<unsigned>(seed));
  Model truth = model;
  craft.make(truth, random);
  TrackingParams tracking;
  tracking.controller.kind = drive.controller;
  tracking.controller.prbs_seed = seed;
  tracking.controller.prbs.duration = kDuration;
  tracking.reference.kind = drive.reference;
  tracking.reference.size = 1.5;
  tracking.reference.rate_of_turn = 0.4;
  tracking.duration = deaf_from < kDuration ? deaf_from + 4 : kDuration;
  ExperimentParams params;
  params.seed = seed;
  params.deaf_from = deaf_from;
  try {
    return judge(model, trackReference(truth, model, tracking, params),
                 drive.controller != "OpenLoopPRBS");
  } catch (const std::runtime_error& error) {
    std::fprintf(stderr, "%s, %s: %s\n", drive.name.c_str(), craft.name.c_str(), error.what());
    return {};
  }
}

void scale(Model& model, const std::string& which, double by) {
  Body<double>& b = model.body;
  if (which == "k") b.k *= by;
  if (which == "I_z") b.I_z *= by;
  if (which == "damping") {
    b.X_u *= by;
    b.Y_v *= by;
    b.N_r *= by;
  }
}

const std::vector<Drive> kDrives = {{"PRBS", "OpenLoopPRBS", "circle"},
                                    {"circle, predictive", "ModelPredictive", "circle"},
                                    {"rhodonea, predictive", "ModelPredictive", "rhodonea"},
                                    {"line, predictive", "ModelPredictive", "line"},
                                    {"circle, backstepping", "TrajectoryTracking", "circle"}};

std::vector<Craft> crafts() {
  const auto random = [](double spread) {
    return [spread](Model& m, std::mt19937& r) {
      std::uniform_real_distribution<double> factor(1 - spread, 1 + spread);
      for (const char* name : {"k", "I_z", "damping"}) scale(m, name, factor(r));
    };
  };
  const auto scaled = [](const char* name, double by) {
    return [=](Model& m, std::mt19937&) { scale(m, name, by); };
  };
  return {{"as the model", random(0)},      {"30% other", random(0.3)},
          {"half the thrust", scaled("k", 0.5)}, {"twice the thrust", scaled("k", 2)},
          {"four times the damping", scaled("damping", 4)},
          {"a quarter of the damping", scaled("damping", 0.25)}};
}

int main(int count, char** arguments) {
  const Model model = loadModel(std::string(GROUND_WORKSPACE) + "/cfg/hovercraft/tiny_whoover.yaml");
  const int seeds = count > 1 ? std::atoi(arguments[1]) : 200;
  int wrong = 0;
  std::printf("%-22s %-26s %7s %9s  %s\n", "drive", "craft", "blamed", "evidence",
              "seconds until noticed (median, worst), error [m], missed");
  for (const Drive& drive : kDrives) {
    if (count > 2 && drive.name.find(arguments[2]) == std::string::npos) continue;
    for (const Craft& craft : crafts()) {
      std::vector<std::future<std::pair<Verdict, Verdict>>> runs;
      std::vector<double> times, errors;
      int blamed = 0, missed = 0;
      double most = -1e9;
      for (int first = 0; first < seeds; first += 2) {
        runs.clear();
        for (int seed = first; seed < std::min(first + 2, seeds); ++seed)
          runs.push_back(std::async(std::launch::async, [&, seed] {
            const auto s = static_cast<unsigned long>(seed + 1);
            const double deaf_from = 8 + 0.37 * (seed % 20);
            Verdict deaf = run(model, drive, craft, s, deaf_from);
            if (deaf.blamed >= 0) deaf.blamed -= deaf_from;
            return std::make_pair(run(model, drive, craft, s, 1e9), deaf);
          }));
        for (auto& each : runs) {
          const auto [hears, deaf] = each.get();
          blamed += hears.blamed >= 0;
          most = std::max(most, hears.most);
          if (deaf.blamed < 0) {
            ++missed;
          } else {
            times.push_back(deaf.blamed);
            errors.push_back(deaf.error);
          }
        }
      }
      wrong += blamed;
      std::sort(times.begin(), times.end());
      std::sort(errors.begin(), errors.end());
      if (times.empty()) times = errors = {NAN};
      std::printf("%-22s %-26s %3d/%3d %9.1f  %.2f %.2f  %.2f %.2f  %d\n", drive.name.c_str(),
                  craft.name.c_str(), blamed, seeds, most, times[times.size() / 2], times.back(),
                  errors[errors.size() / 2], errors.back(), missed);
      std::fflush(stdout);
    }
  }
  return wrong > 0;
}

}  // namespace
}  // namespace ground

int main(int count, char** arguments) { return ground::main(count, arguments); }
