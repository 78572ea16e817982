#include "ground/estimation/obedience_monitor.h"

#include <cmath>
#include <stdexcept>

#include "ground/model/effect_registry.h"
#include "ground/model/measurement.h"
#include "ground/model/typical.h"

namespace ground {
namespace {

constexpr double kInterval = 0.1;     // length of intervals; velocities change visibly [s]
constexpr double kMemory = 40;        // how long intervals are kept [s]
constexpr double kMinHalf = 0.5;      // smallest evidence of each half of a period
constexpr double kMaxGap = 0.25;      // longest gap between states within an interval [s]
constexpr double kPush = 0.03;        // white disturbance, relative to full thrust [1/sqrt(Hz)]
constexpr double kTrim = 0.05;        // constant disturbance, relative to full thrust
constexpr double kDrag = 0.5;         // relative error of the motion without thrust
constexpr double kFreedom = 4;        // degrees of freedom of Student's t
constexpr double kPlausible = -2;     // log-likelihood of an error of about two deviations
constexpr double kMinLift = 0.5;      // with less lift, the craft sits on the floor by command
constexpr std::size_t kMaxCommands = 4000;  // old commands are dropped beyond this number

/// Thrust relative to the commanded one, within which a model may be wrong.
constexpr std::array<double, 3> kShares = {0.5, 1, 2};
/// Additional delays of commands, by the network or an actuator's lag [s].
constexpr std::array<double, 3> kExtraDelays = {0, 0.1, 0.2};

double square(double x) { return x * x; }

/// Minus logarithm of Student's density in `dimension` dimensions, up to a constant.
double loss(double square_of_z, int dimension) {
  return 0.5 * (kFreedom + dimension) * std::log1p(square_of_z / kFreedom);
}

/// A hypothesis about a craft that does not follow its commands. The first one is no thrust.
struct Explanation {
  const char* text;    ///< for messages, after "it moves"
  bool swapped;        ///< left and right thruster are swapped
  double left, right;  ///< thrust of the thrusters relative to the commanded one
  bool lifted;         ///< whether the lift fan works
};
constexpr Explanation kExplanations[] = {
    {"as without thrust", false, 0, 0, true},
    {"as with a fifth of the model's thrust", false, 0.2, 0.2, true},
    {"as with five times the model's thrust", false, 5, 5, true},
    {"as if left and right were swapped", true, 1, 1, true},
    {"as if the left thruster were off", false, 0, 1, true},
    {"as if the right thruster were off", false, 1, 0, true},
    {"as if it sat on the floor, without lift", false, 1, 1, false}};

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
    const double found = loss(off.head<2>().squaredNorm() / velocity, 2) +
                         loss(square(off.z()) / yaw_rate, 1);
    return std::isfinite(found) ? -found : 0;
  }
};

ObedienceMonitor::ObedienceMonitor(const Model& model)
    : dynamics_(model),
      sitting_(sitting(model)),
      derivatives_(model),
      most_(2 * model.body.k * model.body.input_max / model.body.m),
      most_yaw_(model.body.k * model.body.input_max * model.body.l / model.body.I_z) {
  static_assert(std::size(kExplanations) == kCount);
  static_assert(kShares.size() * kExtraDelays.size() == kToldCount && kExtraDelays.size() == kDelayCount);
}

void ObedienceMonitor::reset() {
  told_ = {};
  others_ = {};
  started_ = false;
  intervals_.clear();
}

void ObedienceMonitor::command(double time, const Vector2<double>& thrusters, double lift) {
  if (told_[0].size() > 0 && time < told_[0].times.back()) return reset();
  forgetOldCommands(time);
  for (std::size_t i = 0; i < told_.size(); ++i)
    told_[i].add(time + kExtraDelays[i], thrusters.x(), thrusters.y(), lift);
  for (std::size_t i = 0; i < others_.size(); ++i) {
    const Explanation& e = kExplanations[i];
    const double left = e.swapped ? thrusters.y() : thrusters.x();
    const double right = e.swapped ? thrusters.x() : thrusters.y();
    others_[i].add(time, e.left * left, e.right * right, e.lifted ? lift : 0);
  }
}

void ObedienceMonitor::forgetOldCommands(double time) {
  if (told_[0].size() < kMaxCommands) return;
  const double oldest =
      time - kActuatorMemory - dynamics_.inputDelay() - kExtraDelays.back() - kMaxGap;
  std::size_t count = 0;
  while (count + 1 < told_[0].size() && told_[0].times[count + 1] < oldest) ++count;
  for (InputSequence& told : told_) told.drop(count);
  for (InputSequence& other : others_) other.drop(count);
}

void ObedienceMonitor::measure(double time, const RigidState<double>& state,
                               const Vector3<double>& nu_variance) {
  const Sample now{time, centre(state), nu_variance};
  const double elapsed = time - start_.time;
  if (started_ && elapsed < kInterval) return;
  if (started_ && elapsed <= kMaxGap && lifted()) intervals_.push_back(compare(now));
  started_ = true;
  start_ = now;
  while (!intervals_.empty() && intervals_.front().end <= time - kMemory)
    intervals_.pop_front();
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
  return told_[0].size() > 0 && told_[0].lift.back() >= kMinLift;
}

Vector3<double> ObedienceMonitor::predict(const Dynamics<double>& dynamics,
                                          const InputSequence& inputs, double time) const {
  Simulation<double> simulation(dynamics, inputs, start_.state, start_.time);
  simulation.advance(time);
  return overFloor(simulation.state());
}

ObedienceMonitor::Interval ObedienceMonitor::compare(const Sample& now) const {
  const double dt = now.time - start_.time;
  std::array<Vector3<double>, std::size_t{kCount}> others;
  for (std::size_t i = 0; i < others_.size(); ++i)
    others[i] = predict(kExplanations[i].lifted ? dynamics_ : sitting_, others_[i], now.time);
  const Vector3<double>& free = others[0];
  const Vector3<double> dragged = free - overFloor(start_.state), seen = overFloor(now.state);
  const auto variance = [&](double most, double drag, double noise) {
    return square(kPush * most) * dt + square(kTrim * most * dt) + square(kDrag * drag) + noise;
  };
  const Vector3<double> noise = start_.nu_variance + now.nu_variance;
  const Spread spread{variance(most_, dragged.head<2>().norm(), noise.head<2>().maxCoeff()),
                      variance(most_yaw_, dragged.z(), noise.z())};
  Interval interval{now.time, {}, {}};
  Eigen::Index told = 0;
  for (const InputSequence& inputs : told_) {
    const Vector3<double> thrust = predict(dynamics_, inputs, now.time) - free;
    for (double share : kShares)
      interval.told(told++) = spread.logLikelihood(seen, free + share * thrust);
  }
  for (std::size_t i = 0; i < others_.size(); ++i)
    interval.others(static_cast<Eigen::Index>(i)) = spread.logLikelihood(seen, others[i]);
  return interval;
}

/// Evidence of the last `duration` seconds for each other hypothesis.
ObedienceMonitor::Evidence ObedienceMonitor::evidenceOfOthers(double duration) const {
  const auto recent = [&](const Interval& i) { return i.end > start_.time - duration; };
  Told told = Told::Zero();
  for (const Interval& i : intervals_)
    if (recent(i)) told += i.told;
  Eigen::Index best = 0;
  told.maxCoeff(&best);
  Evidence evidence = Evidence::Zero();
  for (const Interval& i : intervals_) {
    if (!recent(i)) continue;
    Evidence better = i.others - i.told(best);
    // A trim is the same in all intervals, so a slightly better fit in each of them is no evidence,
    // except for the hypothesis of no thrust.
    if (i.told(best) > kPlausible) better.tail<kCount - 1>() = better.tail<kCount - 1>().min(0);
    evidence += better;
  }
  return evidence;
}

double ObedienceMonitor::evidence(double duration) const {
  return evidenceOfOthers(duration).maxCoeff();
}

std::string ObedienceMonitor::disobedience(double duration) const {
  for (double span : {duration, 2 * duration, 4 * duration}) {
    const Evidence all = evidenceOfOthers(span), recent = evidenceOfOthers(span / 2);
    Eigen::Index best = 0;
    if (all.maxCoeff(&best) < kEvidence || recent(best) < kMinHalf ||
        all(best) - recent(best) < kMinHalf)
      continue;
    return "it moves " + likely(span, best);
  }
  return "";
}

/// Texts of the hypotheses that are not much worse than the best one. Uses only those intervals of
/// the last `duration` seconds in which the craft clearly did not follow its commands, because
/// earlier obedience is evidence against all of them. Without such an interval, the text of `best`.
std::string ObedienceMonitor::likely(double duration, Eigen::Index best) const {
  Evidence others = Evidence::Zero();
  for (const Interval& i : intervals_)
    if (i.end > start_.time - duration && i.told.maxCoeff() < kPlausible) others += i.others;
  if ((others == 0).all()) return kExplanations[best].text;
  std::string text;
  for (Eigen::Index i = 0; i < others.size(); ++i)
    if (others(i) > others.maxCoeff() - kEvidence)
      text += (text.empty() ? "" : ", or ") + std::string(kExplanations[i].text);
  return text;
}

}  // namespace ground
