// Tests ObedienceMonitor on simulated runs of crafts that differ from the model: how soon it
// detects a fault, which fault it names, and how often it blames a sound craft.
//   obedience [SEEDS [DRIVE]]    prints a table of the drives whose name contains DRIVE;
//                                exit status 1 if a sound craft was blamed
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

constexpr double kDuration = 60;  // length of a run [s]
constexpr double kTimeout = 1.0;  // the sender's obedience_timeout [s]

struct Drive {
  std::string name;
  std::string controller, reference;
};
struct Craft {
  std::string name;
  std::function<void(Model&, std::mt19937&)> make;  ///< changes the known model into the craft
};
struct Verdict {
  double blamed = -1;  ///< time of the first blame [s]; -1: never
  std::string reason;
  double most = -1e9;  ///< largest evidence
  double error = 0;    ///< distance from the reference when blamed [m]
};

Verdict judge(const Model& model, const ExperimentLog& log, bool tracks) {
  ObedienceMonitor monitor(model);
  const auto estimator = makeKalmanEstimator({});
  Verdict verdict;
  std::size_t next = 0, reference = 0;
  for (const MocapFrame& frame : log.frames) {
    for (; next < log.commands.size() && log.commands[next].time <= frame.delivered; ++next) {
      const ExperimentLog::Command& c = log.commands[next];
      monitor.command(c.time, model.body.input_max * asVector(c.thrusters), c.lift);
    }
    const StateEstimate& e = estimator->update(frame.captured, frame.eta);
    if (!e.valid || !e.used) continue;
    monitor.measure(frame.captured, {e.eta, e.nu}, e.nu_covariance.diagonal());
    for (double span : {kTimeout, 2 * kTimeout, 4 * kTimeout})
      verdict.most = std::max(verdict.most, monitor.evidence(span));
    while (reference + 1 < log.references.size() &&
           log.references[reference + 1].time <= frame.captured)
      ++reference;
    verdict.reason = monitor.disobedience(kTimeout);
    if (verdict.reason.empty()) continue;
    verdict.blamed = frame.delivered;
    if (tracks && !log.references.empty())
      verdict.error = (frame.eta.head<2>() - log.references[reference].point.p).norm();
    break;
  }
  return verdict;
}

/// Verdict on one simulated run with a fault from `fault_from` on [s]; no fault if after the end.
Verdict run(const Model& model, const Drive& drive, const Craft& craft, unsigned long seed,
            CraftFault fault, double fault_from) {
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
  tracking.duration = fault_from < kDuration ? fault_from + 4 : kDuration;
  ExperimentParams params;
  params.seed = seed;
  params.fault = fault;
  params.fault_from = fault_from;
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

struct Failing {
  std::string name;
  CraftFault fault;
  std::string named;  ///< words that the reason must contain
};
const std::vector<Failing> kFaults = {{"hears nothing", CraftFault::kDeaf, "without"},
                                      {"swapped", CraftFault::kSwapped, "swapped"},
                                      {"left off", CraftFault::kLeftOff, "left thruster"},
                                      {"right off", CraftFault::kRightOff, "right thruster"},
                                      {"no lift", CraftFault::kNoLift, "without lift"}};

/// Verdicts of all seeds, computed two at a time.
std::vector<Verdict> verdicts(int seeds, const std::function<Verdict(int)>& judge) {
  std::vector<Verdict> found;
  for (int first = 0; first < seeds; first += 2) {
    std::vector<std::future<Verdict>> runs;
    for (int seed = first; seed < std::min(first + 2, seeds); ++seed)
      runs.push_back(std::async(std::launch::async, judge, seed));
    for (auto& each : runs) found.push_back(each.get());
  }
  return found;
}

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return NAN;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1) + 0.5)];
}

/// Prints the verdicts on sound crafts; returns the number of blamed ones.
int judgeSound(const Model& model, const Drive& drive, const Craft& craft, int seeds) {
  int blamed = 0;
  double most = -1e9;
  for (const Verdict& verdict : verdicts(seeds, [&](int seed) {
         return run(model, drive, craft, static_cast<unsigned long>(seed + 1), CraftFault::kDeaf,
                    1e9);
       })) {
    blamed += verdict.blamed >= 0;
    most = std::max(most, verdict.most);
    if (verdict.blamed >= 0)
      std::printf("  blamed at %.1f s: %s\n", verdict.blamed, verdict.reason.c_str());
  }
  std::printf("%-22s %-26s %-14s blamed %3d/%3d, most evidence %.1f\n", drive.name.c_str(),
              craft.name.c_str(), "sound", blamed, seeds, most);
  return blamed;
}

void judgeFaulty(const Model& model, const Drive& drive, const Craft& craft, int seeds,
                 const Failing& failing) {
  std::vector<double> times, errors;
  int right = 0, wrong = 0;
  for (const Verdict& verdict : verdicts(seeds, [&](int seed) {
         const double from = 8 + 0.37 * (seed % 20);
         Verdict found = run(model, drive, craft, static_cast<unsigned long>(seed + 1),
                             failing.fault, from);
         if (found.blamed >= 0) found.blamed -= from;
         return found;
       })) {
    if (verdict.blamed < 0) continue;
    times.push_back(verdict.blamed);
    errors.push_back(verdict.error);
    const bool named = verdict.reason.find(failing.named) != std::string::npos;
    (named ? right : wrong) += 1;
    if (!named) std::printf("  %s, but: %s\n", failing.name.c_str(), verdict.reason.c_str());
  }
  std::printf("%-22s %-26s %-14s right %3d, other %3d, missed %3d of %3d; after %.2f s (%.2f s), "
              "error %.2f m (%.2f m)\n",
              drive.name.c_str(), craft.name.c_str(), failing.name.c_str(), right, wrong,
              seeds - right - wrong, seeds, quantile(times, 0.5), quantile(times, 1),
              quantile(errors, 0.5), quantile(errors, 1));
}

int main(int count, char** arguments) {
  const Model model = loadModel(std::string(GROUND_WORKSPACE) + "/cfg/hovercraft/tiny_whoover.yaml");
  const int seeds = count > 1 ? std::atoi(arguments[1]) : 200;
  int blamed = 0;
  std::puts("drive, craft, fault: verdicts; delay and error, median (worst)");
  for (const Drive& drive : kDrives) {
    if (count > 2 && drive.name.find(arguments[2]) == std::string::npos) continue;
    for (const Craft& craft : crafts()) {
      blamed += judgeSound(model, drive, craft, seeds);
      for (const Failing& failing : kFaults) judgeFaulty(model, drive, craft, seeds, failing);
      std::fflush(stdout);
    }
  }
  return blamed > 0;
}

}  // namespace
}  // namespace ground

int main(int count, char** arguments) { return ground::main(count, arguments); }
