#include "ground/model/dynamics.h"

#include <Eigen/LU>
#include <stdexcept>

namespace ground {
namespace {

template <typename T>
std::vector<T> constants(const std::vector<double>& values) {
  return std::vector<T>(values.begin(), values.end());
}

bool same(double a, double b) { return a == b; }
bool same(const Jet& a, const Jet& b) { return a.a == b.a && a.v == b.v; }

/// Whether a mass matrix, its derivatives included, is other than that of a body whose centre of
/// mass is its origin and that is equally heavy both ways.
template <typename T>
bool couples(const Matrix3<T>& mass) {
  const T zero(0.0);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (i != j && !same(mass(i, j), zero)) return true;
  return !same(mass(0, 0), mass(1, 1));
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
  over_mass_ = {1.0 / body_.m, 1.0 / body_.m, 1.0 / body_.I_z};
  damping_ = {body_.X_u / body_.m, body_.Y_v / body_.m, body_.N_r / body_.I_z};
  lever_ = body_.l / body_.I_z;
}

template <typename T>
StepInputs<T> Dynamics<T>::actuate(const Vector2<T>& command, double lift, const T& h,
                                   T* states) const {
  StepInputs<T> inputs{{command, command, command}, lift, actuators_.empty()};
  for (const Active& a : actuators_) a.effect->actuate(a.p, h, states + a.state, inputs);
  return inputs;
}

template <typename T>
Vector2<T> Dynamics<T>::drive(const Vector2<T>& thrust) const {
  return {over_mass_.x() * (thrust(0) + thrust(1)), lever_ * (thrust(0) - thrust(1))};
}

template <typename T>
Vector3<T> Dynamics<T>::accelerationBy(const Vector2<T>& drive, const Vector3<T>& nu,
                                       const Vector3<T>& nu_air) const {
  const T &u = nu.x(), &v = nu.y(), &r = nu.z();
  return {drive(0) + r * v - damping_.x() * nu_air.x(), -r * u - damping_.y() * nu_air.y(),
          drive(1) - damping_.z() * r};
}

template <typename T>
Vector3<T> Dynamics<T>::acceleration(const T& t, const Vector3<T>& eta, const Rotation<T>& heading,
                                     const Vector3<T>& nu, const Vector2<T>& input,
                                     double lift) const {
  Point<T> point{t, eta, nu, heading, nu, input, body_.k * input, lift, &body_, &mass_};
  if (has_air_) point.nu_air.template head<2>() -= heading.toBody(air_);
  Vector2<T> thrust = point.thrust;
  for (const Active& a : thrust_) a.effect->thrust(a.p, point, thrust);
  point.thrust = thrust;
  Vector3<T> wrench = Vector3<T>::Zero();
  for (const Active& a : wrench_) a.effect->wrench(a.p, point, wrench);
  if (!couples_)
    return accelerationBy(drive(thrust), nu, point.nu_air) + over_mass_.cwiseProduct(wrench);

  const T &u = nu.x(), &v = nu.y(), &r = nu.z();
  const Vector2<T> p = mass_.template topRows<2>() * nu;  // linear momentum, body
  // -C(nu) nu in Kirchhoff's form, which holds for every mass matrix (Fossen 1994, 2.4), and -D nu
  wrench += Vector3<T>(thrust(0) + thrust(1) + r * p.y() - body_.X_u * point.nu_air.x(),
                       -r * p.x() - body_.Y_v * point.nu_air.y(),
                       body_.l * (thrust(0) - thrust(1)) + v * p.x() - u * p.y() - body_.N_r * r);
  return mass_inverse_ * wrench;
}

template <typename T>
Vector3<T> Dynamics<T>::drift(const Rotation<T>& heading, const Vector3<T>& nu) const {
  const Vector2<T> over_floor = heading.toWorld({nu.x(), nu.y()});
  return {over_floor.x(), over_floor.y(), nu.z()};
}

template <typename T>
RigidState<T> Dynamics<T>::derivative(const T& t, const RigidState<T>& state,
                                      const Vector2<T>& input, double lift) const {
  const Rotation<T> heading(state.eta.z());
  return {drift(heading, state.nu), acceleration(t, state.eta, heading, state.nu, input, lift)};
}

template <typename T>
template <bool kPose, typename H>
RigidState<T> Dynamics<T>::step(const T& t, const RigidState<T>& state, const StepInputs<T>& inputs,
                                const H& h) const {
  const bool nominal = inputs.held && isNominal();
  const Vector2<T> constant = nominal ? drive(body_.k * inputs.thrusters[0]) : Vector2<T>();
  RigidState<T> at = state, next = state;
  // A pose that stays turns nothing.
  Rotation<T> heading = kPose || !uses_pose_ ? Rotation<T>() : Rotation<T>(state.eta.z());
  // One stage: its share of the step is added up, and the next stage's state is made of its rates.
  const auto stage = [&](const H& after, const H& share, const H& to, const Vector2<T>& input) {
    if (kPose) heading = Rotation<T>(at.eta.z());
    const Vector3<T> nu_dot =
        nominal ? accelerationBy(constant, at.nu, at.nu)
                : acceleration(t + after, at.eta, heading, at.nu, input, inputs.lift);
    if constexpr (kPose) {
      const Vector3<T> eta_dot = drift(heading, at.nu);
      for (int i = 0; i < 3; ++i) {
        next.eta(i) += share * eta_dot(i);
        at.eta(i) = state.eta(i) + to * eta_dot(i);
      }
    }
    for (int i = 0; i < 3; ++i) {
      next.nu(i) += share * nu_dot(i);
      at.nu(i) = state.nu(i) + to * nu_dot(i);
    }
  };
  const H half = h * 0.5, third = h / 3.0, sixth = h / 6.0;
  stage(H(0.0), sixth, half, inputs.thrusters[0]);
  stage(half, third, half, inputs.thrusters[1]);
  stage(half, third, h, inputs.thrusters[1]);
  stage(h, sixth, h, inputs.thrusters[2]);
  return next;
}

template <typename T>
Measurement<T> Dynamics<T>::measure(const RigidState<T>& state) const {
  Measurement<T> measurement{state.eta, state.nu};
  for (const Active& a : measure_) a.effect->measure(a.p, state.eta, measurement);
  return measurement;
}

template class Dynamics<double>;
template class Dynamics<Jet>;

#define GROUND_INSTANTIATE_STEP(T, kPose, H)                                         \
  template RigidState<T> Dynamics<T>::step<kPose, H>(const T&, const RigidState<T>&, \
                                                     const StepInputs<T>&, const H&) const;
GROUND_INSTANTIATE_STEP(double, true, double)
GROUND_INSTANTIATE_STEP(double, false, double)
GROUND_INSTANTIATE_STEP(Jet, true, Jet)
GROUND_INSTANTIATE_STEP(Jet, false, Jet)
GROUND_INSTANTIATE_STEP(Jet, true, double)
GROUND_INSTANTIATE_STEP(Jet, false, double)
#undef GROUND_INSTANTIATE_STEP

}  // namespace ground
