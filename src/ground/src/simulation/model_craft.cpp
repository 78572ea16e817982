#include "ground/simulation/model_craft.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "ground/model/inputs.h"

namespace ground {

ModelCraft::ModelCraft(const Model& model, const Params& params)
    : params_(params),
      source_(params.disturbance.empty()
                  ? std::nullopt
                  : std::make_optional<DisturbanceSource>(params.disturbance, kDefaultStep, params.seed)),
      battery_(params.battery.empty()
                   ? std::nullopt
                   : std::make_optional<Battery>(params.battery, model.body.volts, params.start)),
      next_wrench_(params.start),
      model_(onThisRun(model)),
      inputs_(model.thrusters->size()),
      moving_(std::make_unique<Moving>(model_, inputs_, params.initial, params.start)) {
  if (battery_) inputs_.battery.add(params.start, battery_->voltage());
  untouched_ = params.initial.nu.isZero() && !moving_->simulation.derivative().nu.isZero();
}

/// The model with the disturbance's factor on the thrust of this run.
Model ModelCraft::onThisRun(Model model) const {
  if (source_) model.body.k *= source_->thrustFactor();
  return model;
}

void ModelCraft::command(const Thrusters<double>& thrusters, double lift) {
  moving_->dynamics.requireThrusters(thrusters.size());
  lift = std::clamp(lift, 0.0, 1.0);
  inputs_.add(time(), model_.thrusters->clipped(thrusters, model_.body.input_max), lift);
  if (battery_) {
    battery_->draw({asVector(inputs_.thrusters.back()) / model_.body.input_max, lift});
    inputs_.battery.add(time(), battery_->voltage());
  }
  if (lift_ || lift > 0) lift_ = lift;
  if (lift > 0 || !asVector(thrusters).isZero()) untouched_ = false;
  constexpr double kMemory = kActuatorMemory + 5;  // includes the longest input delay [s]
  if (const std::size_t count = inputs_.dropBefore(time() - kMemory)) moving_->simulation.forget(count);
}

RigidState<double> ModelCraft::derivative() const {
  RigidState<double> rate = moving_->simulation.derivative();
  if (disturbed()) rate.nu += moving_->mobility * wrench();
  if (sits()) {
    const Vector3<double> most = friction();
    for (int i = 0; i < 3; ++i) {
      const double nu = state().nu(i);
      // At rest, friction cancels accelerations up to its limit.
      rate.nu(i) -= nu != 0 ? std::copysign(most(i), nu) : std::clamp(rate.nu(i), -most(i), most(i));
    }
  }
  return rate;
}

Vector3<double> ModelCraft::wrench() const {
  Vector3<double> sum = wrench_;
  if (pushed() && time() >= params_.push.from)
    sum.head<2>() += worldToBody<double>(state().eta.z(), params_.push.force);
  return sum;
}

/// Largest decelerations by dry friction of the skirt without lift: along u and v [m/s^2] and in
/// yaw [rad/s^2]. The friction's lever is taken as that of the thrusters.
Vector3<double> ModelCraft::friction() const {
  const Vector3<double>& nu = state().nu;
  const double speed = nu.head<2>().norm();
  const Body<double>& body = model_.body;
  const double turning = params_.braking * body.m * body.l / body.I_z;
  const double along_u = speed > 0 ? std::abs(nu.x()) / speed : 1;
  const double along_v = speed > 0 ? std::abs(nu.y()) / speed : 1;
  return {params_.braking * along_u, params_.braking * along_v, turning};
}

/// Moves the craft under the disturbance and friction of the floor. Half of the impulse of the
/// wrench acts before each step and half after it. Friction does not reverse the velocity.
void ModelCraft::advance(double time) {
  Simulation<double>& simulation = moving_->simulation;
  while ((disturbed() || sits()) && simulation.time() < time) {
    double until = time;
    Vector3<double> push = Vector3<double>::Zero();
    if (source_) {
      if (simulation.time() >= next_wrench_) {
        wrench_ = source_->next();
        next_wrench_ = params_.start + static_cast<double>(++drawn_) * kDefaultStep;
      }
      until = std::min(until, next_wrench_);
    }
    if (pushed()) until = std::min(until, nextPush());
    if (pushed() || sits()) until = std::min(until, simulation.time() + kDefaultStep);
    const double dt = until - simulation.time();
    if (disturbed()) push = 0.5 * dt * (moving_->mobility * wrench());
    for (const bool before : {true, false}) {
      Vector3<double>& nu = simulation.state().nu;
      nu += push;
      const Vector3<double> most = sits() ? (0.5 * dt * friction()).eval() : Vector3<double>::Zero();
      for (int i = 0; i < 3; ++i) nu(i) -= std::clamp(nu(i), -most(i), most(i));
      if (before) simulate(until);
    }
  }
  simulate(time);
}

void ModelCraft::simulate(double until) {
  if (battery_ && until > time()) {
    battery_->advance(until);
    inputs_.battery.add(until, battery_->voltage());
  }
  moving_->simulation.advance(until);
}

void ModelCraft::setModel(const Model& model) {
  const RigidState<double> here = state();
  InputSequence inputs = inputs_;
  for (auto& thrusters : inputs.thrusters) thrusters *= model.body.input_max / model_.body.input_max;
  const Model other = onThisRun(model);
  const Moving probe(other, inputs, here, time());
  const RigidState<double> rate = probe.simulation.derivative();
  if (!rate.eta.allFinite() || !rate.nu.allFinite())
    throw std::invalid_argument("the craft's acceleration by this model is not finite");
  model_ = other;
  inputs_ = std::move(inputs);
  moving_ = std::make_unique<Moving>(model_, inputs_, here, time());
}

}  // namespace ground
