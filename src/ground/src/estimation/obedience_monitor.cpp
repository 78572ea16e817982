#include "ground/estimation/obedience_monitor.h"

#include <cmath>

namespace ground {
namespace {

constexpr double kInterval = 0.1;     // over which velocities change visibly [s]
constexpr double kMemory = 40;        // of evidence [s]
constexpr double kLeastHalf = 0.5;    // evidence of each half of the time
constexpr double kMostGap = 0.25;     // without a state; beyond, an interval says nothing [s]
constexpr double kShare = 0.5;        // of the commanded thrust that a wrong model may leave
constexpr double kPush = 0.03;        // white disturbance, of full thrust [1/sqrt(Hz)]
constexpr double kTrim = 0.05;        // constant disturbance, of full thrust
constexpr double kDrag = 0.5;         // share of the motion without thrust that may be wrong
constexpr double kFreedom = 4;        // of Student's t
constexpr std::size_t kMany = 4000;   // commands, before old ones are forgotten

double square(double x) { return x * x; }

/// Minus logarithm of Student's density, but for a constant.
double loss(double z) { return 0.5 * (kFreedom + 1) * std::log1p(z * z / kFreedom); }

/// Evidence that a velocity changed by `seen` without thrust, against a share of `told`.
double evidenceOf(double seen, double told, double sigma) {
  return loss((seen - kShare * told) / sigma) - loss(seen / sigma);
}

Vector2<double> overFloor(const RigidState<double>& state) {
  return bodyToWorld<double>(state.eta.z(), state.nu.head<2>());
}

}  // namespace

ObedienceMonitor::ObedienceMonitor(const Model& model)
    : dynamics_(model),
      most_(2 * model.body.k * model.body.input_max / model.body.m),
      most_yaw_(model.body.k * model.body.input_max * model.body.l / model.body.I_z) {}

void ObedienceMonitor::reset() {
  inputs_ = without_ = InputSequence();
  started_ = false;
  intervals_.clear();
}

void ObedienceMonitor::command(double time, const Vector2<double>& thrusters, double lift) {
  if (inputs_.size() > 0 && time < inputs_.times.back()) return reset();
  forgetOldCommands(time);
  inputs_.add(time, thrusters.x(), thrusters.y(), lift);
  without_.add(time, 0, 0, lift);
}

void ObedienceMonitor::forgetOldCommands(double time) {
  if (inputs_.size() < kMany) return;
  const double oldest = time - kActuatorMemory - dynamics_.inputDelay() - kMostGap;
  std::size_t count = 0;
  while (count + 1 < inputs_.size() && inputs_.times[count + 1] < oldest) ++count;
  inputs_.drop(count);
  without_.drop(count);
}

void ObedienceMonitor::measure(double time, const RigidState<double>& state,
                               const Vector3<double>& nu_variance) {
  const Sample now{time, state, nu_variance};
  const double elapsed = time - start_.time;
  if (started_ && elapsed < kInterval) return;
  if (started_ && elapsed <= kMostGap) intervals_.push_back({time, compare(now)});
  started_ = true;
  start_ = now;
  while (!intervals_.empty() && intervals_.front().end <= time - kMemory)
    intervals_.pop_front();
}

RigidState<double> ObedienceMonitor::predict(const InputSequence& inputs, double time) const {
  Simulation<double> simulation(dynamics_, inputs, start_.state, start_.time);
  simulation.advance(time);
  return simulation.state();
}

double ObedienceMonitor::compare(const Sample& now) const {
  const double dt = now.time - start_.time;
  const RigidState<double> told = predict(inputs_, now.time), free = predict(without_, now.time);
  const auto variance = [&](double most, double drag, double noise) {
    return square(kPush * most) * dt + square(kTrim * most * dt) + square(kDrag * drag) + noise;
  };
  const Vector2<double> coasting = overFloor(free);
  const Vector2<double> thrust = overFloor(told) - coasting;
  const double drag = (coasting - overFloor(start_.state)).norm();
  const double noise =
      (start_.nu_variance + now.nu_variance).head<2>().maxCoeff();
  double evidence = 0;
  if (thrust.norm() > 1e-9) {
    const double seen = (overFloor(now.state) - coasting).dot(thrust.normalized());
    evidence += evidenceOf(seen, thrust.norm(), std::sqrt(variance(most_, drag, noise)));
  }
  const double yaw_drag = free.nu.z() - start_.state.nu.z();
  const double yaw_noise = start_.nu_variance.z() + now.nu_variance.z();
  evidence += evidenceOf(now.state.nu.z() - free.nu.z(), told.nu.z() - free.nu.z(),
                         std::sqrt(variance(most_yaw_, yaw_drag, yaw_noise)));
  return std::isfinite(evidence) ? evidence : 0;
}

double ObedienceMonitor::evidence(double duration) const {
  double sum = 0;
  for (const Interval& i : intervals_)
    if (i.end > start_.time - duration) sum += i.evidence;
  return sum;
}

bool ObedienceMonitor::disobeys(double duration) const {
  for (double span : {duration, 2 * duration, 4 * duration}) {
    const double all = evidence(span), recent = evidence(span / 2);
    if (all >= kEvidence && recent >= kLeastHalf && all - recent >= kLeastHalf) return true;
  }
  return false;
}

}  // namespace ground
