#include "ground/safety/obedience_monitor.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "ground/model/capability.h"
#include "ground/model/effect_registry.h"
#include "ground/model/measurement.h"
#include "ground/model/typical.h"

namespace ground {
namespace {

constexpr double kInterval = 0.1;  // length of intervals; velocities change visibly [s]
constexpr double kMemory = 40;     // how long intervals are kept [s]
constexpr double kMinHalf = 0.5;   // smallest evidence of each half of a period
constexpr double kMaxGap = 0.25;   // longest gap between states within an interval [s]
constexpr double kPush = 0.03;     // white disturbance, relative to full thrust [1/sqrt(Hz)]
constexpr double kTrim = 0.05;     // constant disturbance, relative to full thrust
constexpr double kDrag = 0.5;      // relative error of the motion without thrust
constexpr double kFreedom = 4;     // degrees of freedom of Student's t
constexpr double kEvidence = 4;    // smallest logarithm of the likelihood ratio that is reported
constexpr double kPlausible = -2;  // log-likelihood of an error of about two deviations
constexpr double kMinLift = 0.5;   // with less lift, the craft sits on the floor by command

/// Thrust relative to the commanded one, within which a model may be wrong.
constexpr std::array<double, 3> kShares = {0.5, 1, 2};
/// Additional delays of commands, by the network or an actuator's lag [s].
constexpr std::array<double, 3> kExtraDelays = {0, 0.1, 0.2};

double square(double x) { return x * x; }

/// Minus logarithm of Student's density in `dimension` dimensions, up to a constant.
double loss(double square_of_z, int dimension) {
  return 0.5 * (kFreedom + dimension) * std::log1p(square_of_z / kFreedom);
}

/// The model with friction of the skirt, so that without lift full thrust hardly moves the craft.
Model sitting(Model model) {
  if (!model.hasEffect("skirt_friction")) {
    model.addEffect(makeEffect("skirt_friction"));
    model.setValue("skirt_friction.f0", typical::force(model.body));
    model.setValue("skirt_friction.n0", typical::moment(model.body));
  }
  return model;
}

/// Velocity over the floor, world_ned [m/s], and yaw rate [rad/s].
Vector3<double> overFloor(const RigidState<double>& state) {
  Vector3<double> moving;
  moving << bodyToWorld<double>(state.eta.z(), state.nu.head<2>()), state.nu.z();
  return moving;
}

}  // namespace

/// Variances of the difference between predicted and measured velocities.
struct ObedienceMonitor::Spread {
  double velocity, yaw_rate;

  double logLikelihood(const Vector3<double>& seen, const Vector3<double>& predicted) const {
    const Vector3<double> off = seen - predicted;
    const double found =
        loss(off.head<2>().squaredNorm() / velocity, 2) + loss(square(off.z()) / yaw_rate, 1);
    return std::isfinite(found) ? -found : 0;
  }
};

ObedienceMonitor::ObedienceMonitor(const Model& model)
    : dynamics_(model),
      sitting_(sitting(model)),
      derivatives_(model),
      most_(capability(model).accelerations(model.body.m, model.body.I_z)) {
  static_assert(kShares.size() * kExtraDelays.size() == kFollowingCount &&
                kExtraDelays.size() == kDelayCount);
  addExplanations();
  reset();
}

void ObedienceMonitor::addExplanations() {
  const ThrusterLayout& layout = dynamics_.layout();
  const Thrusters<double> all = Thrusters<double>::filled(layout.size(), 1);
  explanations_ = {{"as without thrust", Thrusters<double>::zero(layout.size())},
                   {"as with a fifth of the model's thrust", all, 0.2},
                   {"as with five times the model's thrust", all, 5}};
  if (layout.size() == 2 && !layout.steers())
    explanations_.push_back(
        {"as if " + layout[0].name + " and " + layout[1].name + " were swapped", all, 1, true});
  for (int i = 0; i < layout.size() && layout.size() > 1; ++i) {
    Thrusters<double> shares = all;
    shares(i) = 0;
    explanations_.push_back({"as if the " + layout[i].name + " thruster were off", shares});
  }
  explanations_.push_back({"as if it sat on the floor, without lift", all, 1, false, false});
}

void ObedienceMonitor::reset() {
  InputSequence none(dynamics_.layout().size());
  none.battery = battery_;
  none.drive = drive_;
  delayed_.fill(none);
  others_.assign(explanations_.size(), none);
  started_ = false;
  intervals_.clear();
}

void ObedienceMonitor::setDrive(const DriveClock& drive) {
  drive_ = drive;
  for (InputSequence& commands : delayed_) commands.drive = drive;
  for (InputSequence& other : others_) other.drive = drive;
}

void ObedienceMonitor::command(double time, const Thrusters<double>& thrusters, double lift) {
  if (delayed_[0].size() > 0 && time < delayed_[0].times.back()) reset();
  const double oldest = time - kActuatorMemory - dynamics_.inputDelay() - kExtraDelays.back() - kMaxGap;
  for (InputSequence& commands : delayed_) commands.dropBefore(oldest);
  for (InputSequence& other : others_) other.dropBefore(oldest);
  for (std::size_t i = 0; i < delayed_.size(); ++i) delayed_[i].add(time + kExtraDelays[i], thrusters, lift);
  for (std::size_t i = 0; i < others_.size(); ++i) {
    const Explanation& e = explanations_[i];
    Thrusters<double> inputs = Thrusters<double>::zero(thrusters.size());
    for (int j = 0; j < inputs.size(); ++j) inputs(j) = e.shares(j) * thrusters(e.swapped ? 1 - j : j);
    others_[i].add(time, inputs, e.lifted ? lift : 0);
  }
}

void ObedienceMonitor::voltage(double volts) {
  battery_ = {{0.0}, {volts}};
  for (InputSequence& commands : delayed_) commands.battery = battery_;
  for (InputSequence& other : others_) other.battery = battery_;
}

void ObedienceMonitor::measure(double time, const RigidState<double>& state,
                               const Vector3<double>& nu_variance) {
  Sample now{time, centre(state), nu_variance};
  const double elapsed = time - start_.time;
  if (started_ && elapsed < kInterval) return;
  if (started_ && elapsed <= kMaxGap && lifted()) intervals_.push_back(compare(now));
  started_ = true;
  start_ = now;
  while (!intervals_.empty() && intervals_.front().end <= time - kMemory) intervals_.pop_front();
}

/// The state of the craft's centre, given that of the tracked point.
RigidState<double> ObedienceMonitor::centre(const RigidState<double>& seen) const {
  try {
    return stateSeenAs(derivatives_, {seen.eta, seen.nu});
  } catch (const std::runtime_error&) {
    return seen;
  }
}

bool ObedienceMonitor::lifted() const {
  return delayed_[0].size() > 0 && delayed_[0].lift.back() >= kMinLift;
}

Vector3<double> ObedienceMonitor::predict(const Dynamics<double>& dynamics, const InputSequence& inputs,
                                          double time) const {
  Simulation<double> simulation(dynamics, inputs, start_.state, start_.time);
  simulation.advance(time);
  return overFloor(simulation.state());
}

/// Corrects `now` by the prediction of a craft that follows its commands, because a hypothesis that the craft
/// slows down would otherwise profit from a noisy velocity at the start: a Kalman filter of the velocities.
/// grown: variances of the prediction [m^2/s^2], [rad^2/s^2].
void ObedienceMonitor::correct(Sample& now, const Vector3<double>& predicted, const Vector3<double>& grown) {
  const Vector3<double> gain = grown.cwiseQuotient(grown + now.nu_variance);
  const Vector3<double> off = overFloor(now.state) - predicted;
  const double mean = 0.5 * (gain.x() + gain.y());  // u and v; the same for x and y of the world frame
  const Vector3<double> velocity = predicted + Vector3<double>(mean, mean, gain.z()).cwiseProduct(off);
  now.state.nu << worldToBody<double>(now.state.eta.z(), velocity.head<2>()), velocity.z();
  now.nu_variance = now.nu_variance.cwiseProduct(gain);
}

ObedienceMonitor::Interval ObedienceMonitor::compare(Sample& now) const {
  const double dt = now.time - start_.time;
  std::array<Vector3<double>, std::size_t{kMaxCount}> others;
  for (std::size_t i = 0; i < others_.size(); ++i) {
    const Explanation& e = explanations_[i];
    others[i] = predict(e.lifted ? dynamics_ : sitting_, others_[i], now.time);
    others[i] = others[0] + e.strength * (others[i] - others[0]);
  }
  const Vector3<double>& free = others[0];
  const Vector3<double> dragged = free - overFloor(start_.state), seen = overFloor(now.state);
  const auto variance = [&](double most, double drag) {
    return square(kPush * most) * dt + square(kTrim * most * dt) + square(kDrag * drag);
  };
  Vector3<double> grown = start_.nu_variance;
  grown.head<2>().array() += variance(most_.x(), dragged.head<2>().norm());
  grown.z() += variance(most_.y(), dragged.z());
  const Vector3<double> all = grown + now.nu_variance;
  const Spread spread{all.head<2>().maxCoeff(), all.z()};
  Interval interval{now.time, {}, noEvidence()};
  Eigen::Index following = 0, nearest = 0;
  std::array<Vector3<double>, std::size_t{kFollowingCount}> predicted;
  for (const InputSequence& inputs : delayed_) {
    const Vector3<double> thrust = predict(dynamics_, inputs, now.time) - free;
    for (double share : kShares) {
      predicted[static_cast<std::size_t>(following)] = free + share * thrust;
      interval.following(following) =
          spread.logLikelihood(seen, predicted[static_cast<std::size_t>(following)]);
      ++following;
    }
  }
  for (std::size_t i = 0; i < others_.size(); ++i)
    interval.others(static_cast<Eigen::Index>(i)) = spread.logLikelihood(seen, others[i]);
  interval.following.maxCoeff(&nearest);
  correct(now, predicted[static_cast<std::size_t>(nearest)], grown);
  return interval;
}

/// Evidence of the last `duration` seconds for each other hypothesis.
ObedienceMonitor::Evidence ObedienceMonitor::evidenceOfOthers(double duration) const {
  const auto recent = [&](const Interval& i) { return i.end > start_.time - duration; };
  Following following = Following::Zero();
  for (const Interval& i : intervals_)
    if (recent(i)) following += i.following;
  Eigen::Index best = 0;
  following.maxCoeff(&best);
  Evidence evidence = noEvidence();
  for (const Interval& i : intervals_) {
    if (!recent(i)) continue;
    Evidence better = i.others - i.following(best);
    // A trim is the same in all intervals, so a slightly better fit in each of them is no evidence,
    // except for the hypothesis of no thrust.
    if (i.following(best) > kPlausible)
      better.tail(better.size() - 1) = better.tail(better.size() - 1).min(0);
    evidence += better;
  }
  return evidence;
}

std::string ObedienceMonitor::disobedience(double duration) {
  for (double span : {duration, 2 * duration, 4 * duration}) {
    const Evidence all = evidenceOfOthers(span), recent = evidenceOfOthers(span / 2);
    Eigen::Index best = 0;
    if (all.maxCoeff(&best) < kEvidence || recent(best) < kMinHalf || all(best) - recent(best) < kMinHalf)
      continue;
    std::string text;
    for (const Explanation* one : likely(span, best))
      text += (text.empty() ? "it moves " : ", or ") + one->text;
    return text;
  }
  return "";
}

/// The hypotheses that are not much worse than the best one. Uses only those intervals of
/// the last `duration` seconds in which the craft clearly did not follow its commands, because
/// earlier obedience is evidence against all of them. Without such an interval, only `best`.
std::vector<const ObedienceMonitor::Explanation*> ObedienceMonitor::likely(double duration,
                                                                           Eigen::Index best) const {
  Evidence others = noEvidence();
  for (const Interval& i : intervals_)
    if (i.end > start_.time - duration && i.following.maxCoeff() < kPlausible) others += i.others;
  if ((others == 0).all()) return {&explanations_[static_cast<std::size_t>(best)]};
  std::vector<const Explanation*> found;
  for (Eigen::Index i = 0; i < others.size(); ++i)
    if (others(i) > others.maxCoeff() - kEvidence)
      found.push_back(&explanations_[static_cast<std::size_t>(i)]);
  return found;
}

}  // namespace ground
