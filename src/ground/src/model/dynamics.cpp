#include "ground/model/dynamics.h"

#include <Eigen/LU>
#include <algorithm>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "stages.h"

namespace ground {
namespace {

template <typename T>
std::vector<T> constants(const std::vector<double>& values) {
  return std::vector<T>(values.begin(), values.end());
}

bool isZero(double x) { return x == 0; }
bool isZero(const Lanes& x) { return allOf(x == Lanes(0.0)); }
template <typename V, int N>
bool isZero(const Dual<V, N>& x) {
  return isZero(x.a) && x.isConstant();
}

/// Whether an effect with these coordinates changes nothing, nor any derivative. One without
/// parameters always acts.
template <typename T>
bool isNeutral(const EffectInfo& info, const T* coordinates) {
  const auto& all = info.parameters;
  return !all.empty() && std::all_of(all.begin(), all.end(), [&](const ParameterInfo& one) {
    return isZero(T(*coordinates++ - one.toCoordinate(one.neutral)));
  });
}

/// Whether a mass matrix, including its derivatives, is not of the form diag(m, m, I_z).
template <typename T>
bool couples(const Matrix3<T>& mass) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (i != j && !isZero(mass(i, j))) return true;
  return !isZero(T(mass(0, 0) - mass(1, 1)));
}

}  // namespace

template <typename T>
struct Dynamics<T>::Instant {
  T since;
  Vector3<T> nu_air;    ///< only set if there is wind
  Thrusters<T> thrust;  ///< only set if effects change it
  Point<T> point;

  Instant(const Dynamics& d, const T& t, const Vector3<T>& eta, const Rotation<T>& heading,
          const Vector3<T>& nu, const Drive& drive, const ValueOf<T>& lift, const T* states)
      : since(notBelowZero(t)),
        point{since,
              eta,
              nu,
              heading,
              d.has_air_ ? static_cast<const Vector3<T>&>(nu_air) : nu,
              drive.input,
              d.thrust_.empty() ? drive.thrust : static_cast<const Thrusters<T>&>(thrust),
              *d.layout_,
              lift,
              d.body_,
              d.mass_,
              states} {
    if (d.has_air_) {
      const Vector2<T> air = heading.toBody(d.air_);
      nu_air.x() = nu.x() - air.x();
      nu_air.y() = nu.y() - air.y();
      nu_air.z() = nu.z();
    }
    if (d.thrust_.empty()) return;
    thrust = drive.thrust;
    Thrusters<T> force = thrust;
    for (const Active& a : d.thrust_) a.effect->thrust(a.p, of(a, states), force);
    thrust = force;
  }
  /// The instant as one effect sees it.
  const Point<T>& of(const Active& a, const T* states) {
    point.states = states + a.state;
    return point;
  }
};

template <typename T>
template <typename H>
void Dynamics<T>::StateStages::move(const H& share, const H& to, T* end) {
  for (std::size_t i = 0; i < rates.size(); ++i) {
    end[i] += share * rates[i];
    at[i] = begin[i] + to * rates[i];
  }
}

template <typename T>
Dynamics<T>::Dynamics(const Model& model) : Dynamics(model, constants<T>(model.coordinates())) {}

template <typename T>
Dynamics<T>::Dynamics(const Model& model, const std::vector<T>& coordinates)
    : layout_(model.thrusters),
      coordinates_(coordinates),
      air_(Vector2<T>::Zero()),
      delay_(0.0),
      sways_(layout_->sways()) {
  if (static_cast<int>(coordinates_.size()) != model.parameterCount())
    throw std::invalid_argument("Dynamics: wrong number of coordinates");
  const T* p = coordinates_.data();
  for (T* value : {&body_.m, &body_.l, &body_.I_z, &body_.X_u, &body_.Y_v, &body_.N_r, &body_.k})
    *value = *p++;
  body_.I_z = 1.0 / body_.I_z;  // its coordinate
  body_.input_max = model.body.input_max;

  mass_ = Vector3<T>(body_.m, body_.m, body_.I_z).asDiagonal();
  for (const Model::Entry& entry : model.effects) {
    add(entry, p);
    p += entry.effect->info().parameters.size();
  }
  mass_inverse_ = mass_.inverse();
  couples_ = couples(mass_);
  has_hooks_ = has_air_ || sways_ || !thrust_.empty() || !wrench_.empty() || !rates_.empty();
  stages_ = {initial_, initial_, std::vector<T>(initial_.size(), T(0.0))};
  over_mass_ = {1.0 / body_.m, 1.0 / body_.m, 1.0 / body_.I_z};
  damping_ = {body_.X_u / body_.m, body_.Y_v / body_.m, body_.N_r / body_.I_z};
  lever_ = body_.l / body_.I_z;
  surge_gain_ = body_.k / body_.m;
  yaw_gain_ = body_.k * lever_;
}

/// Adds an effect whose parameters begin at `p`. One that changes nothing keeps its place among the
/// states, but is never computed: a score test has a model with all effects that may be missing, and
/// differentiates by the parameters of a few effects at a time.
template <typename T>
void Dynamics<T>::add(const Model::Entry& entry, const T* p) {
  const int state = stateCount();
  const EffectInfo& info = entry.effect->info();
  initial_.insert(initial_.end(), info.initial.begin(), info.initial.end());
  initial_.resize(static_cast<std::size_t>(state + info.stateCount(layout_->size())), T(0.0));
  if (isNeutral(info, p)) return;
  instances_.push_back(entry.effect->forThread());
  const Effect& effect = *instances_.back();
  const EffectHooks<T>& hooks = effect;
  const unsigned has = effect.hooks();
  const Active active{&hooks, p, state};
  if (has & Effect::kDelay) hooks.delay(p, delay_);
  if (has & Effect::kAir) hooks.air(p, air_);
  if (has & Effect::kInertia) hooks.inertia(p, body_, mass_);
  if (has & Effect::kActuate) actuators_.push_back(active);
  if (has & Effect::kRates) rates_.push_back(active);
  if (has & Effect::kThrust) thrust_.push_back(active);
  if (has & Effect::kWrench) wrench_.push_back(active);
  if (has & Effect::kMeasure) measure_.push_back(active);
  uses_pose_ = uses_pose_ || (has & Effect::kPose);
  has_air_ = has_air_ || (has & Effect::kAir);
}

template <typename T>
void Dynamics<T>::requireThrusters(int count) const {
  if (count != layout_->size())
    throw std::invalid_argument("the model has " + std::to_string(layout_->size()) +
                                " thrusters (" + layout_->names() + ") but the inputs are for " +
                                std::to_string(count));
}

template <typename T>
StepInputs<T> Dynamics<T>::actuate(const Thrusters<T>& command, const ValueOf<T>& lift, const T& h,
                                   T* states) const {
  StepInputs<T> inputs{{command, command, command}, lift, actuators_.empty(), states};
  for (const Active& a : actuators_) a.effect->actuate(a.p, h, states + a.state, inputs);
  return inputs;
}

template <typename T>
Settling Dynamics<T>::settling() const {
  Settling settling;
  if (hasMemory()) settling.memory = kActuatorMemory;
  if (!rates_.empty()) settling.step = kSettlingStep;
  return settling;
}

template <typename T>
void Dynamics<T>::settle(const T& t, const RigidState<T>& state, const Thrusters<T>& command,
                         const ValueOf<T>& lift, const T& h, T* states) const {
  const StepInputs<T> inputs = actuate(command, lift, h, states);
  if (rates_.empty()) return;
  const Rotation<T> heading(state.eta.z());
  const T zero(0.0), half = 0.5 * h, third = h * (1.0 / 3), sixth = h * (1.0 / 6);
  const auto take = [&](int node, const T& after, const T& share, const T& to, const T* at) {
    const Drive now(*this, inputs.thrusters[static_cast<std::size_t>(node)]);
    Instant instant(*this, t + after, state.eta, heading, state.nu, now, lift, at);
    rates(instant, at, stages_.rates.data());
    stages_.move(share, to, states);
  };
  std::copy(states, states + initial_.size(), stages_.begin.begin());
  take(0, zero, sixth, half, stages_.begin.data());
  take(1, half, third, half, stages_.at.data());
  take(1, half, third, h, stages_.at.data());
  take(2, h, sixth, zero, stages_.at.data());
}

template <typename T>
template <typename I>
GROUND_INLINE void Dynamics<T>::Drive::set(const Dynamics& d, const Thrusters<I>& inputs,
                                           const Thrusters<I>& force) {
  const Vector3<I> total = d.layout_->total(force);
  surge = d.surge_gain_ * total(0);
  yaw = d.yaw_gain_ * total(2);
  if (d.sways_) sway = d.surge_gain_ * total(1);
  if (!d.has_hooks_ && !d.couples_) return;
  input.set(inputs, [](const I& one) { return T(one); });
  thrust.set(force, [&](const I& one) { return T(d.body_.k * one); });
}

template <typename T>
template <typename I>
void Dynamics<T>::Drive::setListed(const Dynamics& d, const Thrusters<I>& inputs) {
  set(d, inputs, d.layout_->forces(inputs));
}

template <typename T>
template <typename I>
GROUND_INLINE Dynamics<T>::Drive::Drive(const Dynamics& d, const Thrusters<I>& inputs) {
  d.layout_->isPair() ? set(d, inputs, inputs) : setListed(d, inputs);
}

template <typename T>
void Dynamics<T>::rates(Instant& instant, const T* states, T* rates) const {
  for (const Active& a : rates_) a.effect->rates(a.p, instant.of(a, states), rates + a.state);
}

template <typename T>
Vector3<T> Dynamics<T>::effects(const T& t, const Vector3<T>& eta, const Rotation<T>& heading,
                                const Vector3<T>& nu, const Drive& drive, const ValueOf<T>& lift,
                                const T* states, T* rates) const {
  Instant instant(*this, t, eta, heading, nu, drive, lift, states);
  if (rates) this->rates(instant, states, rates);
  const Vector3<T>& nu_air = instant.point.nu_air;
  const Thrusters<T>& thrust = instant.point.thrust;
  Vector3<T> wrench(T(0.0), T(0.0), T(0.0));
  for (const Active& a : wrench_) a.effect->wrench(a.p, instant.of(a, states), wrench);
  if (couples_) {
    const T &u = nu.x(), &v = nu.y(), &r = nu.z();
    const Vector2<T> p = mass_.template topRows<2>() * nu;  // linear momentum, body
    // -C(nu) nu in Kirchhoff's form, which holds for every mass matrix (Fossen 1994, 2.4), and
    // -D nu
    const Vector3<T> total = layout_->total(thrust);
    wrench.x() += total.x() + r * p.y() - body_.X_u * nu_air.x();
    wrench.y() -= r * p.x() + body_.Y_v * nu_air.y();
    if (sways_) wrench.y() += total.y();
    wrench.z() += body_.l * total.z() + v * p.x() - u * p.y() - body_.N_r * r;
    return mass_inverse_ * wrench;
  }
  Vector3<T> acceleration;
  for (int i = 0; i < 3; ++i) acceleration(i) = over_mass_(i) * wrench(i);
  if (has_air_)
    for (int i = 0; i < 2; ++i) acceleration(i) += damping_(i) * (nu(i) - nu_air(i));
  if (!thrust_.empty()) {
    Thrusters<T> more = thrust;
    for (int i = 0; i < more.size(); ++i) more(i) -= drive.thrust(i);
    const Vector3<T> total = layout_->total(more);
    acceleration.x() += over_mass_.x() * total.x();
    if (sways_) acceleration.y() += over_mass_.y() * total.y();
    acceleration.z() += lever_ * total.z();
  }
  if (sways_) acceleration.y() += drive.sway;
  return acceleration;
}

template <typename T>
RigidState<T> Dynamics<T>::derivative(const T& t, const RigidState<T>& state,
                                      const Thrusters<T>& input, const ValueOf<T>& lift,
                                      const T* states) const {
  const Rotation<T> heading(state.eta.z());
  const T &u = state.nu.x(), &v = state.nu.y(), &r = state.nu.z();
  const Vector2<T> over_floor = heading.toWorld({u, v});
  const Drive now(*this, input);
  Vector3<T> nu_dot(T(0.0), T(0.0), T(0.0));
  if (has_hooks_ || couples_)
    nu_dot = effects(t, state.eta, heading, state.nu, now, lift,
                     states ? states : initial_.data(), nullptr);
  if (!couples_) {
    nu_dot.x() += r * v + now.surge - damping_.x() * u;
    nu_dot.y() -= r * u + damping_.y() * v;
    nu_dot.z() += now.yaw - damping_.z() * r;
  }
  return {{over_floor.x(), over_floor.y(), r}, nu_dot};
}

template <typename T>
template <bool kPose, typename H>
void Dynamics<T>::step(T& t, RigidState<T>& state, const StepInputs<T>& inputs, const H& h,
                       int count, Rotation<ValueOf<T>>* heading) const {
  const Drive start(*this, inputs.thrusters[0]);
  if (inputs.held) {
    run<kPose, H>(t, state, {&start, &start, &start}, inputs.lift, inputs.states, h, count,
                  heading);
    return;
  }
  const Drive middle(*this, inputs.thrusters[1]), end(*this, inputs.thrusters[2]);
  run<kPose, H>(t, state, {&start, &middle, &end}, inputs.lift, inputs.states, h, count, heading);
}

template <typename T>
template <bool kPose, typename H>
void Dynamics<T>::hold(T& t, RigidState<T>& state, const Thrusters<ValueOf<T>>& command,
                       const ValueOf<T>& lift, const H& h, int count,
                       Rotation<ValueOf<T>>* heading) const {
  const Drive held(*this, command);
  run<kPose, H>(t, state, {&held, &held, &held}, lift, nullptr, h, count, heading);
}

/// One stage of a Runge-Kutta step, `after` seconds from the beginning of the step.
template <typename T>
template <bool kFirst, bool kLast, bool kPose, typename H>
GROUND_INLINE void Dynamics<T>::take(Stages<T, kPose, H>& stages, const T& t, const H& after,
                                     const H& share, const H& to, const Drive& drive,
                                     const ValueOf<T>& lift, T* states, bool remembers) const {
  if (kPose) stages.template turn<kFirst>(uses_pose_);
  if (!has_hooks_ && !couples_) {
    stages.template move<kFirst, kLast, true, false>(share, to, drive.surge, drive.yaw, stages.nu);
    return;
  }
  const Vector3<T>& nu = kFirst ? stages.nu : stages.at_nu;
  const Vector3<T>& eta = kFirst || !kPose ? stages.eta : stages.at_eta;
  const T* now = states ? states : initial_.data();
  if (remembers) now = kFirst ? stages_.begin.data() : stages_.at.data();
  T* const rates = remembers ? stages_.rates.data() : nullptr;
  const Vector3<T> more = effects(t + after, eta, stages.heading, nu, drive, lift, now, rates);
  if (remembers) stages_.move(share, to, states);
  if (couples_)
    stages.template move<kFirst, kLast, false, true>(share, to, drive.surge, drive.yaw, more);
  else
    stages.template move<kFirst, kLast, true, true>(share, to, drive.surge, drive.yaw, more);
}

template <typename T>
template <bool kPose, typename H>
void Dynamics<T>::run(T& t, RigidState<T>& state, const std::array<const Drive*, 3>& drives,
                      const ValueOf<T>& lift, T* states, const H& h, int count,
                      Rotation<ValueOf<T>>* heading) const {
  const bool remembers = states && !rates_.empty();
  const H half = h * 0.5, third = h * (1.0 / 3), sixth = h * (1.0 / 6);
  Stages<T, kPose, H> stages{damping_, directions_, state, heading};
  const auto take = [&](auto first, auto last, const H& after, const H& share, const H& to,
                        const Drive& drive) __attribute__((always_inline)) {
    this->template take<decltype(first)::value, decltype(last)::value>(
        stages, t, after, share, to, drive, lift, states, remembers);
  };
  for (int i = 0; i < count; ++i) {
    stages.begin(uses_pose_);
    if (remembers) std::copy(states, states + initial_.size(), stages_.begin.begin());
    take(std::true_type(), std::false_type(), H(0.0), sixth, half, *drives[0]);
    take(std::false_type(), std::false_type(), half, third, half, *drives[1]);
    take(std::false_type(), std::false_type(), half, third, h, *drives[1]);
    take(std::false_type(), std::true_type(), h, sixth, h, *drives[2]);
    stages.end();
    t += h;
  }
  if constexpr (!std::is_reference_v<decltype(stages.next)>) state = stages.next;
}

template <typename T>
Measurement<T> Dynamics<T>::measure(const RigidState<T>& state) const {
  Measurement<T> measurement{state.eta, state.nu};
  for (const Active& a : measure_) a.effect->measure(a.p, state.eta, measurement);
  return measurement;
}

template class Dynamics<double>;
template class Dynamics<Jet>;
template class Dynamics<Lanes>;
template class Dynamics<LanesJet>;

#define GROUND_INSTANTIATE_STEP(T, H)                                                           \
  template void Dynamics<T>::step<true, H>(T&, RigidState<T>&, const StepInputs<T>&, const H&,  \
                                           int, Rotation<ValueOf<T>>*) const;                   \
  template void Dynamics<T>::step<false, H>(T&, RigidState<T>&, const StepInputs<T>&, const H&, \
                                            int, Rotation<ValueOf<T>>*) const;                  \
  template void Dynamics<T>::hold<true, H>(T&, RigidState<T>&, const Thrusters<ValueOf<T>>&,    \
                                           const ValueOf<T>&, const H&, int,                    \
                                           Rotation<ValueOf<T>>*) const;                        \
  template void Dynamics<T>::hold<false, H>(T&, RigidState<T>&, const Thrusters<ValueOf<T>>&,   \
                                            const ValueOf<T>&, const H&, int,                   \
                                            Rotation<ValueOf<T>>*) const;
GROUND_INSTANTIATE_STEP(double, double)
GROUND_INSTANTIATE_STEP(Jet, Jet)
GROUND_INSTANTIATE_STEP(Jet, double)
GROUND_INSTANTIATE_STEP(Lanes, Lanes)
GROUND_INSTANTIATE_STEP(LanesJet, LanesJet)
GROUND_INSTANTIATE_STEP(LanesJet, Lanes)
#undef GROUND_INSTANTIATE_STEP

}  // namespace ground
