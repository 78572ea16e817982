#include "ground/model/dynamics.h"

#include <Eigen/LU>
#include <stdexcept>

namespace ground {
namespace {

template <typename T>
std::vector<T> constants(const std::vector<double>& values) {
  return std::vector<T>(values.begin(), values.end());
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
    state_count_ += effect.info().states;
    p += effect.info().parameters.size();
  }
  mass_inverse_ = mass_.inverse();
}

template <typename T>
StepInputs<T> Dynamics<T>::actuate(const Vector2<T>& command, double lift, const T& h,
                                   T* states) const {
  StepInputs<T> inputs{{command, command, command}, lift};
  for (const Active& a : actuators_) a.effect->actuate(a.p, h, states + a.state, inputs);
  return inputs;
}

template <typename T>
RigidState<T> Dynamics<T>::derivative(const T& t, const RigidState<T>& state,
                                      const Vector2<T>& input, double lift) const {
  const Vector3<T>& nu = state.nu;
  Point<T> point{t, state.eta, nu, nu, input, body_.k * input, lift, &body_, &mass_};
  point.nu_air.template head<2>() -= worldToBody<T>(state.eta.z(), air_);
  Vector2<T> thrust = point.thrust;
  for (const Active& a : thrust_) a.effect->thrust(a.p, point, thrust);
  point.thrust = thrust;

  const Vector2<T> p = mass_.template topRows<2>() * nu;  // linear momentum, body
  const T &u = nu.x(), &v = nu.y(), &r = nu.z();
  // -C(nu) nu in Kirchhoff's form, which holds for every mass matrix (Fossen 1994, 2.4), and -D nu
  Vector3<T> wrench(thrust(0) + thrust(1) + r * p.y() - body_.X_u * point.nu_air.x(),
                    -r * p.x() - body_.Y_v * point.nu_air.y(),
                    body_.l * (thrust(0) - thrust(1)) + v * p.x() - u * p.y() - body_.N_r * r);
  for (const Active& a : wrench_) a.effect->wrench(a.p, point, wrench);

  RigidState<T> rate;
  rate.eta.template head<2>() = bodyToWorld<T>(state.eta.z(), nu.template head<2>());
  rate.eta.z() = r;
  rate.nu = mass_inverse_ * wrench;
  return rate;
}

template <typename T>
RigidState<T> Dynamics<T>::step(const T& t, const RigidState<T>& state, const StepInputs<T>& inputs,
                                const T& h) const {
  const auto moved = [&state](const RigidState<T>& rate, const T& dt) {
    return RigidState<T>{state.eta + dt * rate.eta, state.nu + dt * rate.nu};
  };
  const auto& u = inputs.thrusters;
  const T half = h * 0.5;
  const auto k1 = derivative(t, state, u[0], inputs.lift);
  const auto k2 = derivative(t + half, moved(k1, half), u[1], inputs.lift);
  const auto k3 = derivative(t + half, moved(k2, half), u[1], inputs.lift);
  const auto k4 = derivative(t + h, moved(k3, h), u[2], inputs.lift);
  const T sixth = h / 6.0;
  return {state.eta + sixth * (k1.eta + T(2.0) * (k2.eta + k3.eta) + k4.eta),
          state.nu + sixth * (k1.nu + T(2.0) * (k2.nu + k3.nu) + k4.nu)};
}

template <typename T>
Measurement<T> Dynamics<T>::measure(const RigidState<T>& state) const {
  Measurement<T> measurement{state.eta, state.nu};
  for (const Active& a : measure_) a.effect->measure(a.p, state.eta, measurement);
  return measurement;
}

template class Dynamics<double>;
template class Dynamics<Jet>;

}  // namespace ground
