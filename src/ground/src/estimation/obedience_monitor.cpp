#include "ground/estimation/obedience_monitor.h"

#include <cmath>
#include <stdexcept>

#include "ground/model/effect_registry.h"
#include "ground/model/measurement.h"
#include "ground/model/typical.h"

namespace ground {
namespace {

constexpr double kInterval = 0.1;     // over which velocities change visibly [s]
constexpr double kMemory = 40;        // of evidence [s]
constexpr double kLeastHalf = 0.5;    // evidence of each half of the time
constexpr double kMostGap = 0.25;     // without a state; beyond, an interval says nothing [s]
constexpr double kPush = 0.03;        // white disturbance, of full thrust [1/sqrt(Hz)]
constexpr double kTrim = 0.05;        // constant disturbance, of full thrust
constexpr double kDrag = 0.5;         // share of the motion without thrust that may be wrong
constexpr double kFreedom = 4;        // of Student's t
constexpr double kPlausible = -2;     // likelihood of what is less than two deviations off
constexpr double kLeastLift = 0.5;    // below, a craft sits as it is told
constexpr std::size_t kMany = 4000;   // commands, before old ones are forgotten

/// Of the commanded thrust, within which a model may be wrong.
constexpr std::array<double, 3> kShares = {0.5, 1, 2};
/// By which commands may act later than the model says: by the network, or an actuator's lag [s].
constexpr std::array<double, 3> kLate = {0, 0.1, 0.2};

double square(double x) { return x * x; }

/// Minus logarithm of Student's density in `dimension` dimensions, but for a constant.
double loss(double square_of_z, int dimension) {
  return 0.5 * (kFreedom + dimension) * std::log1p(square_of_z / kFreedom);
}

/// What a craft may do instead of what it is told: what to say, and what its thrusters get. The
/// first one is that they get nothing.
struct Explanation {
  const char* text;
  bool swapped;
  double left, right;  ///< shares that arrive
  bool lifted;
};
constexpr Explanation kExplanations[] = {
    {"as without thrust", false, 0, 0, true},
    {"as with a fifth of the model's thrust", false, 0.2, 0.2, true},
    {"as with five times the model's thrust", false, 5, 5, true},
    {"as if left and right were swapped", true, 1, 1, true},
    {"as if the left thruster were off", false, 0, 1, true},
    {"as if the right thruster were off", false, 1, 0, true},
    {"as if it sat on the floor, without lift", false, 1, 1, false}};

/// A model whose craft sits down without lift: full thrust hardly moves it then.
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

/// Variances of what is predicted and measured.
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
  static_assert(kShares.size() * kLate.size() == kToldCount && kLate.size() == kLateCount);
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
    told_[i].add(time + kLate[i], thrusters.x(), thrusters.y(), lift);
  for (std::size_t i = 0; i < others_.size(); ++i) {
    const Explanation& e = kExplanations[i];
    const double left = e.swapped ? thrusters.y() : thrusters.x();
    const double right = e.swapped ? thrusters.x() : thrusters.y();
    others_[i].add(time, e.left * left, e.right * right, e.lifted ? lift : 0);
  }
}

void ObedienceMonitor::forgetOldCommands(double time) {
  if (told_[0].size() < kMany) return;
  const double oldest =
      time - kActuatorMemory - dynamics_.inputDelay() - kLate.back() - kMostGap;
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
  if (started_ && elapsed <= kMostGap && lifted()) intervals_.push_back(compare(now));
  started_ = true;
  start_ = now;
  while (!intervals_.empty() && intervals_.front().end <= time - kMemory)
    intervals_.pop_front();
}

/// The state of the craft's centre, where the mocap sees another point or heading.
RigidState<double> ObedienceMonitor::centre(const RigidState<double>& seen) const {
  try {
    return stateSeenAs(derivatives_, {seen.eta, seen.nu});
  } catch (const std::runtime_error&) {
    return seen;
  }
}

bool ObedienceMonitor::lifted() const {
  return told_[0].size() > 0 && told_[0].lift.back() >= kLeastLift;
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

/// For each other explanation, of the last `duration` seconds.
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
    // A trim is the same in all intervals: what fits a little better in each is no evidence, except
    // for thrust that is missing altogether.
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
    if (all.maxCoeff(&best) < kEvidence || recent(best) < kLeastHalf ||
        all(best) - recent(best) < kLeastHalf)
      continue;
    return "it moves " + likely(span, best);
  }
  return "";
}

/// The explanations that are not much worse than the best one. Those intervals of the last `duration`
/// seconds decide in which the craft clearly did not do as it was told: before, it did, which speaks
/// against all of them. Without such an interval it is `best`.
std::string ObedienceMonitor::likely(double duration, Eigen::Index best) const {
  Evidence others = Evidence::Zero();
  for (const Interval& i : intervals_)
    if (i.end > start_.time - duration && i.told.maxCoeff() < kPlausible) others += i.others;
  if ((others == 0).all()) return kExplanations[best].text;
  std::string said;
  for (Eigen::Index i = 0; i < others.size(); ++i)
    if (others(i) > others.maxCoeff() - kEvidence)
      said += (said.empty() ? "" : ", or ") + std::string(kExplanations[i].text);
  return said;
}

}  // namespace ground
