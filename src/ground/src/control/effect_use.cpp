#include "ground/control/effect_use.h"

#include <cmath>
#include <cstdio>

#include "ground/model/pushed_step.h"

namespace ground {
namespace {

constexpr double kMaxHeadingOffset = 0.05;  // [rad]
constexpr double kMaxMarkerOffset = 0.01;   // [m]
constexpr double kMaxDelay = 0.02;          // [s]

/// Names of the effects that are not neutral and have one of these hooks (a set of Effect::Hook).
std::vector<std::string> active(const Model& model, unsigned hooks = ~0u) {
  std::vector<std::string> names;
  for (const Model::Entry& entry : model.effects)
    if (!entry.isNeutral() && (entry.effect->hooks() & hooks)) names.push_back(entry.effect->info().name);
  return names;
}

std::string list(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

}  // namespace

std::string EffectUse::remark() const {
  std::string text;
  if (!used.empty()) text = "uses " + list(used);
  if (!unused.empty()) text += (text.empty() ? "" : "; ") + ("does not use " + list(unused));
  return text;
}

EffectUse wholeModelUse(const Model& model) {
  EffectUse use{active(model), {}, ""};
  if (model.stateCount() > kMaxStates)
    use.refusal = "the effects of this model have " + std::to_string(model.stateCount()) +
                  " states, and the controller follows " + std::to_string(kMaxStates) +
                  " at most: remove effects with states from its model";
  return use;
}

EffectUse bodyOnlyUse(const Model& model) {
  EffectUse use{{}, active(model), ""};
  const auto refuse = [&](unsigned hook, const char* what, double value, double bound, const char* unit) {
    if (std::abs(value) <= bound || !use.refusal.empty()) return;
    char text[160];
    std::snprintf(text, sizeof text, " (%s by %.3g %s, and more than %g %s steers it wrong)", what,
                  std::abs(value), unit, bound, unit);
    use.refusal = "TrajectoryTracking cannot drive by this model, because it does not use " +
                  list(active(model, hook)) + text + ": use ModelPredictive";
  };
  const Dynamics<double> dynamics(model);
  const Measurement<double> seen = dynamics.measure(RigidState<double>());
  refuse(Effect::kMeasure, "the measured heading is off", wrapAngle(seen.eta.z()), kMaxHeadingOffset, "rad");
  refuse(Effect::kMeasure, "the tracked point is off", seen.eta.head<2>().norm(), kMaxMarkerOffset, "m");
  refuse(Effect::kDelay, "commands are late", dynamics.inputDelay(), kMaxDelay, "s");
  return use;
}

}  // namespace ground
