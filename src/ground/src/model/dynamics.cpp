#include "ground/model/dynamics.h"

#include <Eigen/LU>
#include <stdexcept>
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

/// Whether a mass matrix, its derivatives included, is other than that of a body whose centre of
/// mass is its origin and that is equally heavy both ways.
template <typename T>
bool couples(const Matrix3<T>& mass) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (i != j && !isZero(mass(i, j))) return true;
  return !isZero(T(mass(0, 0) - mass(1, 1)));
}

}  // namespace

template <typename T>
Dynamics<T>::Dynamics(const Model& model) : Dynamics(model, constants<T>(model.coordinates())) {}

template <typename T>
Dynamics<T>::Dynamics(const Model& model, const std::vector<T>& coordinates)
    : coordinates_(coordinates), air_(Vector2<T>::Zero()), delay_(0.0) {
  if (static_cast<int>(coordinates_.size()) != model.parameterCount())
    throw std::invalid_argument("Dynamics: wrong number of coordinates");
  const T* p = coordinates_.data();
  for (T* value : {&body_.m, &body_.l, &body_.I_z, &body_.X_u, &body_.Y_v, &body_.N_r, &body_.k})
    *value = *p++;
  body_.I_z = 1.0 / body_.I_z;  // its coordinate
  body_.input_max = model.body.input_max;

  mass_ = Vector3<T>(body_.m, body_.m, body_.I_z).asDiagonal();
  for (const Model::Entry& entry : model.effects) {
    instances_.push_back(entry.effect->forThread());
    const Effect& effect = *instances_.back();
    const EffectHooks<T>& hooks = effect;
    const unsigned has = effect.hooks();
    const Active active{&hooks, p, state_count_};
    if (has & Effect::kDelay) hooks.delay(p, delay_);
    if (has & Effect::kAir) hooks.air(p, air_);
    if (has & Effect::kInertia) hooks.inertia(p, body_, mass_);
    if (has & Effect::kActuate) actuators_.push_back(active);
    if (has & Effect::kThrust) thrust_.push_back(active);
    if (has & Effect::kWrench) wrench_.push_back(active);
    if (has & Effect::kMeasure) measure_.push_back(active);
    uses_pose_ = uses_pose_ || (has & Effect::kPose);
    has_air_ = has_air_ || (has & Effect::kAir);
    state_count_ += effect.info().states;
    p += effect.info().parameters.size();
  }
  mass_inverse_ = mass_.inverse();
  couples_ = couples(mass_);
  has_hooks_ = has_air_ || !thrust_.empty() || !wrench_.empty();
  over_mass_ = {1.0 / body_.m, 1.0 / body_.m, 1.0 / body_.I_z};
  damping_ = {body_.X_u / body_.m, body_.Y_v / body_.m, body_.N_r / body_.I_z};
  lever_ = body_.l / body_.I_z;
  surge_gain_ = body_.k / body_.m;
  yaw_gain_ = body_.k * lever_;
}

template <typename T>
StepInputs<T> Dynamics<T>::actuate(const Vector2<T>& command, const ValueOf<T>& lift, const T& h,
                                   T* states) const {
  StepInputs<T> inputs{{command, command, command}, lift, actuators_.empty()};
  for (const Active& a : actuators_) a.effect->actuate(a.p, h, states + a.state, inputs);
  return inputs;
}

template <typename T>
template <typename I>
typename Dynamics<T>::Drive Dynamics<T>::drive(const Vector2<I>& input) const {
  Drive drive;
  drive.surge = surge_gain_ * (input(0) + input(1));
  drive.yaw = yaw_gain_ * (input(0) - input(1));
  if (has_hooks_ || couples_) {
    drive.input = {T(input(0)), T(input(1))};
    drive.thrust = {body_.k * input(0), body_.k * input(1)};
  }
  return drive;
}

template <typename T>
Vector3<T> Dynamics<T>::effects(const T& t, const Vector3<T>& eta, const Rotation<T>& heading,
                                const Vector3<T>& nu, const Drive& drive,
                                const ValueOf<T>& lift) const {
  Vector3<T> nu_air = nu;
  if (has_air_) {
    const Vector2<T> air = heading.toBody(air_);
    nu_air.x() -= air.x();
    nu_air.y() -= air.y();
  }
  Vector2<T> thrust = drive.thrust;
  const T since = notBelowZero(t);
  const Point<T> point{since, eta, nu, heading, nu_air, drive.input, thrust, lift, body_, mass_};
  if (!thrust_.empty()) {
    Vector2<T> force = thrust;
    for (const Active& a : thrust_) a.effect->thrust(a.p, point, force);
    thrust = force;
  }
  Vector3<T> wrench(T(0.0), T(0.0), T(0.0));
  for (const Active& a : wrench_) a.effect->wrench(a.p, point, wrench);
  if (couples_) {
    const T &u = nu.x(), &v = nu.y(), &r = nu.z();
    const Vector2<T> p = mass_.template topRows<2>() * nu;  // linear momentum, body
    // -C(nu) nu in Kirchhoff's form, which holds for every mass matrix (Fossen 1994, 2.4), and
    // -D nu
    wrench.x() += thrust(0) + thrust(1) + r * p.y() - body_.X_u * nu_air.x();
    wrench.y() -= r * p.x() + body_.Y_v * nu_air.y();
    wrench.z() += body_.l * (thrust(0) - thrust(1)) + v * p.x() - u * p.y() - body_.N_r * r;
    return mass_inverse_ * wrench;
  }
  Vector3<T> acceleration;
  for (int i = 0; i < 3; ++i) acceleration(i) = over_mass_(i) * wrench(i);
  if (has_air_)
    for (int i = 0; i < 2; ++i) acceleration(i) += damping_(i) * (nu(i) - nu_air(i));
  if (!thrust_.empty()) {
    const T left = thrust(0) - drive.thrust(0), right = thrust(1) - drive.thrust(1);
    acceleration.x() += over_mass_.x() * (left + right);
    acceleration.z() += lever_ * (left - right);
  }
  return acceleration;
}

template <typename T>
RigidState<T> Dynamics<T>::derivative(const T& t, const RigidState<T>& state,
                                      const Vector2<T>& input, const ValueOf<T>& lift) const {
  const Rotation<T> heading(state.eta.z());
  const T &u = state.nu.x(), &v = state.nu.y(), &r = state.nu.z();
  const Vector2<T> over_floor = heading.toWorld({u, v});
  const Drive now = drive(input);
  Vector3<T> nu_dot(T(0.0), T(0.0), T(0.0));
  if (has_hooks_ || couples_) nu_dot = effects(t, state.eta, heading, state.nu, now, lift);
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
                       int count) const {
  const Drive start = drive(inputs.thrusters[0]);
  if (inputs.held) {
    run<kPose, H>(t, state, {&start, &start, &start}, inputs.lift, h, count);
    return;
  }
  const Drive middle = drive(inputs.thrusters[1]), end = drive(inputs.thrusters[2]);
  run<kPose, H>(t, state, {&start, &middle, &end}, inputs.lift, h, count);
}

template <typename T>
template <bool kPose, typename H>
void Dynamics<T>::hold(T& t, RigidState<T>& state, const Vector2<ValueOf<T>>& command,
                       const ValueOf<T>& lift, const H& h, int count) const {
  const Drive held = drive(command);
  run<kPose, H>(t, state, {&held, &held, &held}, lift, h, count);
}

template <typename T>
template <bool kPose, typename H>
void Dynamics<T>::run(T& t, RigidState<T>& state, const std::array<const Drive*, 3>& drives,
                      const ValueOf<T>& lift, const H& h, int count) const {
  const H half = h * 0.5, third = h * (1.0 / 3), sixth = h * (1.0 / 6);
  Stages<T, kPose, H> stages{damping_, directions_, state};
  const auto take = [&](auto first, auto last, const H& after, const H& share, const H& to,
                        const Drive& drive) __attribute__((always_inline)) {
    constexpr bool kFirst = decltype(first)::value, kLast = decltype(last)::value;
    if (kPose) stages.template turn<kFirst>(uses_pose_);
    if (!has_hooks_ && !couples_) {
      stages.template move<kFirst, kLast, true, false>(share, to, drive.surge, drive.yaw, state.nu);
      return;
    }
    const Vector3<T>& nu = kFirst ? stages.nu : stages.at_nu;
    const Vector3<T>& eta = kFirst || !kPose ? stages.eta : stages.at_eta;
    const Vector3<T> more = effects(t + after, eta, stages.heading, nu, drive, lift);
    if (couples_)
      stages.template move<kFirst, kLast, false, true>(share, to, drive.surge, drive.yaw, more);
    else
      stages.template move<kFirst, kLast, true, true>(share, to, drive.surge, drive.yaw, more);
  };
  for (int i = 0; i < count; ++i) {
    stages.begin(uses_pose_);
    take(std::true_type(), std::false_type(), H(0.0), sixth, half, *drives[0]);
    take(std::false_type(), std::false_type(), half, third, half, *drives[1]);
    take(std::false_type(), std::false_type(), half, third, h, *drives[1]);
    take(std::false_type(), std::true_type(), h, sixth, h, *drives[2]);
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
                                           int) const;                                          \
  template void Dynamics<T>::step<false, H>(T&, RigidState<T>&, const StepInputs<T>&, const H&, \
                                            int) const;                                         \
  template void Dynamics<T>::hold<true, H>(T&, RigidState<T>&, const Vector2<ValueOf<T>>&,      \
                                           const ValueOf<T>&, const H&, int) const;             \
  template void Dynamics<T>::hold<false, H>(T&, RigidState<T>&, const Vector2<ValueOf<T>>&,     \
                                            const ValueOf<T>&, const H&, int) const;
GROUND_INSTANTIATE_STEP(double, double)
GROUND_INSTANTIATE_STEP(Jet, Jet)
GROUND_INSTANTIATE_STEP(Jet, double)
GROUND_INSTANTIATE_STEP(Lanes, Lanes)
GROUND_INSTANTIATE_STEP(LanesJet, LanesJet)
GROUND_INSTANTIATE_STEP(LanesJet, Lanes)
#undef GROUND_INSTANTIATE_STEP

}  // namespace ground
