#include "ground/model/dynamics.h"

#include <Eigen/LU>
#include <algorithm>
#include <optional>
#include <stdexcept>
#include <string>

#include "ground/model/capability.h"

namespace ground {
namespace {

template <typename T>
std::vector<T> constants(const std::vector<double>& values) {
  return std::vector<T>(values.begin(), values.end());
}

template <typename T>
bool isZero(const T& x) {
  return valueOf(x) == 0 && isConstant(x);
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

/// Where an effect on the inputs acts among others: what acts at once, such as a dead band, comes before what
/// takes time.
template <class Actuators>
auto placeOf(const EffectInfo& info, const ThrusterLayout& layout, Actuators& actuators) {
  return info.stateCount(layout.size()) == 0 ? actuators.begin() : actuators.end();
}

/// Whether a mass matrix, including its derivatives, is not of the form diag(m, m, I_z).
template <typename T>
bool couples(const Matrix3<T>& mass) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (i != j && !isZero(mass(i, j))) return true;
  return !isZero(T(mass(0, 0) - mass(1, 1)));
}

template <typename T>
Matrix3<T> inverseOf(const Matrix3<T>& mass) {
  return mass.inverse();
}
/// Short where the matrix is diagonal, as it is without effects.
Matrix3<Symbol> inverseOf(const Matrix3<Symbol>& mass) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (i != j && !isZero(mass(i, j))) return mass.inverse();
  return mass.diagonal().cwiseInverse().asDiagonal();
}

}  // namespace

template <typename T>
struct Dynamics<T>::Instant {
  T since;
  Vector3<T> nu_air;    ///< only set if there is wind
  Thrusters<T> thrust;  ///< only set if effects change it
  Point<T> point;

  Instant(const Dynamics& d, const T& t, const Vector3<T>& eta, const Rotation<T>& heading,
          const Vector3<T>& nu, const Drive& drive, const Conditions<T>& given, const T* states)
      : since(notBelowZero(t)),
        point{since,
              eta,
              nu,
              heading,
              d.has_air_ ? static_cast<const Vector3<T>&>(nu_air) : nu,
              drive.input,
              d.thrust_.empty() ? drive.thrust : static_cast<const Thrusters<T>&>(thrust),
              *d.layout_,
              given.lift,
              given.volts,
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
Dynamics<T>::Dynamics(const Model& model, const Payload& payload)
    : Dynamics(model, constants<T>(model.coordinates()), payload) {}

template <typename T>
Dynamics<T>::Dynamics(const Model& model, const std::vector<T>& coordinates, const Payload& payload)
    : layout_(model.thrusters),
      steering_(steeringOf<T>(*layout_)),
      coordinates_(coordinates),
      air_(Vector2<T>::Zero()),
      delay_(0.0),
      time_scale_(timeScale(model)) {
  if (static_cast<int>(coordinates_.size()) != model.parameterCount())
    throw std::invalid_argument("Dynamics: wrong number of coordinates");
  const T* p = coordinates_.data();
  for (T* value : {&body_.m, &body_.l, &body_.I_z, &body_.X_u, &body_.Y_v, &body_.N_r, &body_.k})
    *value = *p++;
  body_.I_z = 1.0 / body_.I_z;  // its coordinate
  body_.input_max = model.body.input_max;
  body_.hull_length = model.body.hull_length;
  body_.volts = model.body.volts;

  mass_ = Vector3<T>(body_.m, body_.m, body_.I_z).asDiagonal();
  for (const Model::Entry& entry : model.effects) {
    add(entry, p);
    p += entry.effect->info().parameters.size();
  }
  if (!payload.empty()) load(payload);
  mass_inverse_ = inverseOf(mass_);
  is_alone_ = !couples(mass_) && !has_air_ && !layout_->sways() && !layout_->steers() && thrust_.empty() &&
              wrench_.empty() && rates_.empty();
  stages_ = {initial_, initial_, std::vector<T>(initial_.size(), T(0.0))};
  damping_ = {body_.X_u / body_.m, body_.Y_v / body_.m, body_.N_r / body_.I_z};
  surge_gain_ = body_.k / body_.m;
  yaw_gain_ = body_.k * body_.l / body_.I_z;
}

/// Adds an effect whose parameters begin at `p`. One that changes nothing keeps its place among the
/// states, but is never computed: a score test has a model with all effects that may be missing, and
/// differentiates by the parameters of a few effects at a time.
template <typename T>
void Dynamics<T>::add(const Model::Entry& entry, const T* p) {
  const int state = stateCount();
  const EffectInfo& info = entry.effect->info();
  for (const double value : info.initial) initial_.emplace_back(value);
  initial_.resize(static_cast<std::size_t>(state + info.stateCount(layout_->size())), T(0.0));
  if (isNeutral(info, p)) return;
  instances_.push_back(entry.effect);
  const Effect& effect = *instances_.back();
  const EffectHooks<T>& hooks = effect;
  const unsigned has = effect.hooks();
  const Active active{&hooks, p, state};
  if (has & Effect::kDelay) hooks.delay(p, delay_);
  if (has & Effect::kAir) hooks.air(p, air_);
  if (has & (layout_->steers() ? Effect::kSteer : 0U)) hooks.steer(p, steering_);
  if (has & Effect::kInertia) hooks.inertia(p, body_, mass_);
  if (has & Effect::kActuate) actuators_.insert(placeOf(info, *layout_, actuators_), active);
  if (has & Effect::kRates) rates_.push_back(active);
  if (has & Effect::kThrust) thrust_.push_back(active);
  if (has & Effect::kWrench) wrench_.push_back(active);
  if (has & Effect::kMeasure) measure_.push_back(active);
  uses_pose_ = uses_pose_ || (has & Effect::kPose);
  has_air_ = has_air_ || (has & Effect::kAir);
}

/// Adds a load that is fixed to the craft (Fossen 1994, 2.4).
template <typename T>
void Dynamics<T>::load(const Payload& payload) {
  const double x = payload.mass * payload.place.x(), y = payload.mass * payload.place.y();
  mass_(0, 0) += payload.mass;
  mass_(1, 1) += payload.mass;
  mass_(2, 2) += payload.inertia + x * payload.place.x() + y * payload.place.y();
  if (x != 0 || y != 0) {
    mass_(0, 2) -= y;
    mass_(2, 0) -= y;
    mass_(1, 2) += x;
    mass_(2, 1) += x;
  }
  body_.m += payload.mass;
  body_.I_z += payload.inertia;
}

template <typename T>
void Dynamics<T>::requireThrusters(int count) const {
  if (count != layout_->size())
    throw std::invalid_argument("the model has " + std::to_string(layout_->size()) + " thrusters (" +
                                layout_->names() + ") but the inputs are for " + std::to_string(count));
}

template <typename T>
StepInputs<T> Dynamics<T>::actuate(const Thrusters<T>& command, const Conditions<T>& given, const T& h,
                                   T* states) const {
  StepInputs<T> inputs{{command}, given, actuators_.empty(), states, layout_.get(), body_.input_max};
  if (!inputs.held) inputs.thrusters[1] = inputs.thrusters[2] = command;
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
double Dynamics<T>::longestStep() const {
  constexpr double kDamped = 0.25;  // of the shortest time constant: an error of 1e-5 in a step
  if (hasMemory()) return kDefaultStep;
  double step = kDefaultStep * time_scale_;
  for (const T& rate : damping_) step = std::min(step, kDamped / std::abs(valueOf(rate)));
  return std::max(step, kDefaultStep);
}

template <typename T>
void Dynamics<T>::settle(const T& t, const RigidState<T>& state, const Thrusters<T>& command,
                         const Conditions<T>& given, const T& h, T* states) const {
  const StepInputs<T> inputs = actuate(command, given, h, states);
  if (rates_.empty()) return;
  const Rotation<T> heading(state.eta.z());
  const T zero(0.0), half = 0.5 * h, third = h * (1.0 / 3), sixth = h * (1.0 / 6);
  const auto take = [&](int node, const T& after, const T& share, const T& to, const T* at) {
    const Drive now(*this, inputs.thrusters[inputs.held ? 0 : static_cast<std::size_t>(node)]);
    Instant instant(*this, t + after, state.eta, heading, state.nu, now, given, at);
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
Dynamics<T>::Drive::Drive(const Dynamics& d, const Thrusters<T>& inputs)
    : input(inputs), thrust(d.layout_->forces(inputs)), angles(*d.layout_, d.steering_, inputs) {
  thrust *= d.body_.k;
}

template <typename T>
void Dynamics<T>::rates(Instant& instant, const T* states, T* rates) const {
  for (const Active& a : rates_) a.effect->rates(a.p, instant.of(a, states), rates + a.state);
}

template <typename T>
void Dynamics<T>::derive(const T& t, const RigidState<T>& state, const Drive& drive,
                         const Conditions<T>& given, const T* states, T* rates, bool pose,
                         RigidState<T>& dot) const {
  const T &u = state.nu.x(), &v = state.nu.y(), &r = state.nu.z();
  Rotation<T> heading;
  if (pose) {  // (2.3)
    heading = Rotation<T>(state.eta.z());
    dot.eta << heading.toWorld({u, v}), r;
  }
  Instant instant(*this, t, state.eta, heading, state.nu, drive, given, states);
  if (rates) this->rates(instant, states, rates);
  // (2.4): thrust, -C(nu) nu in Kirchhoff's form, which holds for every mass matrix (Fossen 1994, 2.4), and
  // -D nu
  const Vector3<T>& nu_air = instant.point.nu_air;
  const Vector3<T> total = layout_->total(instant.point.thrust);
  const Vector2<T> p = mass_.template topRows<2>() * state.nu;  // linear momentum, body
  Vector3<T> wrench(total.x() + r * p.y() - body_.X_u * nu_air.x(),
                    total.y() - r * p.x() - body_.Y_v * nu_air.y(),
                    body_.l * total.z() + v * p.x() - u * p.y() - body_.N_r * r);
  if (layout_->steers())
    addSteering(*layout_, steering_, drive.angles, instant.point.thrust, nu_air, body_.l, wrench);
  for (const Active& a : wrench_) a.effect->wrench(a.p, instant.of(a, states), wrench);
  dot.nu = mass_inverse_ * wrench;
}

template <typename T>
RigidState<T> Dynamics<T>::derivative(const T& t, const RigidState<T>& state, const Thrusters<T>& input,
                                      const Conditions<T>& given, const T* states, T* rates) const {
  RigidState<T> dot;
  derive(t, state, Drive(*this, input), given, states ? states : initial_.data(), rates, true, dot);
  return dot;
}

/// Steps of the velocities by (2.4) alone, under a constant force. Most fits integrate nothing else: small
/// enough for the registers, it is three times as quick as a step of any model.
template <typename T>
template <typename H>
void Dynamics<T>::stepVelocities(Vector3<T>& nu, const Thrusters<T>& input, const H& h, int count) const {
  const H half = h * 0.5, third = h * (1.0 / 3), sixth = h * (1.0 / 6);
  const Vector3<T> total = layout_->totalAt(input);
  const T X = damping_.x(), Y = damping_.y(), N = damping_.z();
  const T surge = surge_gain_ * total(0), yaw = yaw_gain_ * total(2);
  T u = nu.x(), v = nu.y(), r = nu.z();
  for (int i = 0; i < count; ++i) {
    T at_u = u, at_v = v, at_r = r, next_u = u, next_v = v, next_r = r;
    const auto stage = [&](const H& share, const H& to) __attribute__((always_inline)) {
      const T du = surge + at_r * at_v - X * at_u, dv = -(at_r * at_u + Y * at_v), dr = yaw - N * at_r;
      next_u += share * du;
      next_v += share * dv;
      next_r += share * dr;
      at_u = u + to * du;
      at_v = v + to * dv;
      at_r = r + to * dr;
    };
    stage(sixth, half);
    stage(third, half);
    stage(third, h);
    stage(sixth, H(0.0));
    u = next_u;
    v = next_v;
    r = next_r;
  }
  nu << u, v, r;
}

template <typename T>
template <typename H>
void Dynamics<T>::step(T& t, RigidState<T>& state, const StepInputs<T>& inputs, const H& h, int count,
                       bool pose) const {
  if (!pose && is_alone_ && inputs.held) {
    t += h * static_cast<double>(count);
    return stepVelocities(state.nu, inputs.thrusters[0], h, count);
  }
  const bool remembers = inputs.states && !rates_.empty();
  const T* const held = inputs.states ? inputs.states : initial_.data();
  std::optional<Drive> later[2];
  const Drive start(*this, inputs.thrusters[0]);
  const Drive& middle = inputs.held ? start : later[0].emplace(*this, inputs.thrusters[1]);
  const Drive& end = inputs.held ? start : later[1].emplace(*this, inputs.thrusters[2]);
  const H zero(0.0), half = h * 0.5, third = h * (1.0 / 3), sixth = h * (1.0 / 6);
  RigidState<T> k;
  for (int i = 0; i < count; ++i) {
    RigidState<T> at = state, next = state;
    // k = f(t + after, at), next += share k, at = state + to k
    const auto stage = [&](const Drive& drive, const H& after, const H& share, const H& to) {
      derive(t + after, at, drive, inputs.given, remembers ? stages_.at.data() : held,
             remembers ? stages_.rates.data() : nullptr, pose, k);
      if (remembers) stages_.move(share, to, inputs.states);
      for (int j = 0; j < 3; ++j) {
        next.nu(j) += share * k.nu(j);
        at.nu(j) = state.nu(j) + to * k.nu(j);
        if (!pose) continue;
        next.eta(j) += share * k.eta(j);
        at.eta(j) = state.eta(j) + to * k.eta(j);
      }
    };
    if (remembers) {
      std::copy_n(inputs.states, initial_.size(), stages_.begin.begin());
      stages_.at = stages_.begin;
    }
    stage(start, zero, sixth, half);
    stage(middle, half, third, half);
    stage(middle, half, third, h);
    stage(end, h, sixth, zero);
    state = next;
    t += h;
  }
}

template <typename T>
Measurement<T> Dynamics<T>::measure(const RigidState<T>& state) const {
  Measurement<T> measurement{state.eta, state.nu};
  for (const Active& a : measure_) a.effect->measure(a.p, state.eta, measurement);
  return measurement;
}

template class Dynamics<double>;
template class Dynamics<Jet>;
template class Dynamics<Symbol>;

template void Dynamics<double>::step(double&, RigidState<double>&, const StepInputs<double>&, const double&,
                                     int, bool) const;
template void Dynamics<Jet>::step(Jet&, RigidState<Jet>&, const StepInputs<Jet>&, const double&, int,
                                  bool) const;
template void Dynamics<Jet>::step(Jet&, RigidState<Jet>&, const StepInputs<Jet>&, const Jet&, int,
                                  bool) const;

}  // namespace ground
