#include "ground/control/allocation.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace ground {
namespace {

constexpr double kEffort = 1e-9;      // e of the class comment
constexpr double kMet = 1e-6;         // relative error of a wrench that counts as met
constexpr double kLeastInput = 1e-3;  // at which the slope of a force curve is taken

/// The smallest input in size with a force on the side of `far`, the end of the table there.
double inputInTable(const ForceCurve& curve, double force, double far) {
  const double most = curve.at(far);
  if (std::abs(force) > std::abs(most)) return most == 0 ? far : far * (force / most);
  double below = 0, above = far;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (below + above);
    (std::abs(curve.at(middle)) < std::abs(force) ? below : above) = middle;
  }
  return above;
}

}  // namespace

double inputFor(const ForceCurve& curve, double force) {
  if (force == 0 || curve.linear()) return force;
  if (!curve.table.empty())
    return inputInTable(curve, force, force > 0 ? curve.table.back()[0] : curve.table.front()[0]);
  return std::copysign(std::pow(std::abs(force), 1 / curve.power), force);
}

Allocation::Allocation(const ThrusterLayout& layout, const Body<double>& body, const Weights& weights)
    : layout_(layout),
      lever_(body.l),
      weights_(weights.surge, weights.sway, weights.yaw),
      k_(body.k),
      steering_(steeringOf<double>(layout_)),
      slopes_(steeringOf<Jet>(layout_)) {
  const int count = layout.size();
  columns_.resize(3, count);
  for (Forces* forces : {&full_, &low_, &high_}) forces->resize(count);
  for (int i = 0; i < count; ++i) {
    const Thruster& one = layout[i];
    columns_.col(i) << layout.forward(i), layout.starboard(i), layout.lever(i);
    if (layout.steers()) {  // the range of the inputs
      full_(i) = 1;
      low_(i) = one.least * body.input_max;
      high_(i) = one.most * body.input_max;
      continue;
    }
    full_(i) = body.k * one.gain;
    low_(i) = full_(i) * one.curve.at(one.least * body.input_max);
    high_(i) = full_(i) * one.curve.at(one.most * body.input_max);
  }
  hessian_.noalias() = columns_.transpose() * weights_.asDiagonal() * columns_;
  // A gain only matters relative to the others'.
  const double scale = kEffort * full_.cwiseAbs2().minCoeff();
  for (int i = 0; i < count; ++i) hessian_(i, i) += scale / (full_(i) * full_(i));
}

Allocation::Allocation(const Model& model, const Weights& weights)
    : Allocation(*model.thrusters, model.body, weights) {
  if (!layout_.steers()) return;
  for (const Model::Entry& entry : model.effects) {
    if (!(entry.effect->hooks() & Effect::kSteer)) continue;
    const auto& infos = entry.effect->info().parameters;
    std::vector<double> p;
    for (std::size_t i = 0; i < infos.size(); ++i) p.push_back(infos[i].toCoordinate(entry.values[i]));
    const std::vector<Jet> constants(p.begin(), p.end());
    static_cast<const EffectHooks<double>&>(*entry.effect).steer(p.data(), steering_);
    static_cast<const EffectHooks<Jet>&>(*entry.effect).steer(constants.data(), slopes_);
  }
}

/// The wrench of a craft that steers, at rest: X, Y, N / l [N]; and its derivatives by the inputs.
Vector3<double> Allocation::wrenchAt(const Forces& input, Columns* slopes) const {
  const auto wrench = [&](const auto& steering, auto inputs) {
    using T = std::decay_t<decltype(inputs(0))>;
    Thrusters<T> force = layout_.forces(inputs);
    force *= T(k_);
    const Vector3<T> rest(T(0.0), T(0.0), T(0.0));
    Vector3<T> all = layout_.total(force);
    addSteering(layout_, steering, Angles<T>(layout_, steering, inputs), force, rest, T(1.0), all);
    return all;
  };
  const Thrusters<double> plain(input);
  if (!slopes) return wrench(steering_, plain);
  Thrusters<Jet> inputs = plain.cast<Jet>();
  for (int i = 0; i < inputs.size(); ++i) {
    // A curve may have no slope at rest.
    if (!layout_[i].curve.linear() && std::abs(input(i)) < kLeastInput) inputs(i).a = kLeastInput;
    inputs(i).v[i] = 1;
  }
  const Vector3<Jet> all = wrench(slopes_, inputs);
  slopes->resize(3, inputs.size());
  for (int row = 0; row < 3; ++row)
    for (int i = 0; i < inputs.size(); ++i) (*slopes)(row, i) = all(row).v[i];
  return {all(0).a, all(1).a, all(2).a};
}

double Allocation::cost(const Vector3<double>& demand, const Forces& input,
                        const Vector3<double>& given) const {
  return weights_.dot((given - demand).cwiseAbs2()) + kEffort * k_ * k_ * input.squaredNorm();
}

/// Improves inputs until their cost no longer falls; returns it.
double Allocation::descend(const Vector3<double>& demand, Forces& input) const {
  constexpr int kMaxSteps = 30;
  Columns slopes;
  double now = cost(demand, input, wrenchAt(input, nullptr)), damping = 1e-6;
  for (int step = 0; step < kMaxSteps; ++step) {
    const Vector3<double> given = wrenchAt(input, &slopes);
    const Columns weighted = weights_.asDiagonal() * slopes;
    BoxMinimum::Square hessian = slopes.transpose().lazyProduct(weighted);
    hessian.diagonal().array() += (kEffort + damping) * k_ * k_;
    const Forces gradient = weighted.transpose().lazyProduct(given - demand) + kEffort * k_ * k_ * input;
    if (!problem_.solve(hessian, gradient, low_ - input, high_ - input)) break;
    const Forces next = input + problem_.minimum();
    const double then = cost(demand, next, wrenchAt(next, nullptr));
    if (then < now) {
      const bool done = now - then < kMet * kMet * now;
      input = next;
      now = then;
      damping = std::max(1e-9, 0.1 * damping);
      if (done) break;
    } else {
      damping *= 30;
      if (damping > 1e6) break;
    }
  }
  return now;
}

/// The best of the minima that are reached with all angles at zero, or at either end.
Allocation::Output Allocation::steered(const Vector3<double>& demand) const {
  Forces best = Forces::Zero(layout_.size());
  double least = cost(demand, best, wrenchAt(best, nullptr));
  for (const double side : {0.0, -0.7, 0.7}) {
    Forces input(layout_.size());
    for (int i = 0; i < layout_.size(); ++i)
      input(i) = layout_.pushes(i) ? 0.5 * high_(i) : side > 0 ? side * high_(i) : -side * low_(i);
    const double found = descend(demand, input);
    if (!(found < least)) continue;
    least = found;
    best = input;
  }
  const Vector3<double> given = wrenchAt(best, nullptr);
  return {Thrusters<double>(best), Thrusters<double>(best), {given.x(), given.y(), given.z() * lever_}};
}

Allocation::Output Allocation::run(const Vector3<double>& wrench) const {
  const Vector3<double> demand(wrench.x(), wrench.y(), wrench.z() / lever_);
  if (layout_.steers()) return steered(demand);
  problem_.solve(hessian_, -(columns_.transpose() * weights_.cwiseProduct(demand)), low_, high_);
  const Forces& force = problem_.minimum();
  const Vector3<double> given = columns_ * force;
  const Vector3<double> reachable = columns_ * problem_.unbounded();
  const bool met = (given - reachable).norm() <= kMet * high_.maxCoeff();
  const Thrusters<double> inputs = inputsOf(force);
  return {inputs, met ? inputs : inputsOf(problem_.unbounded()), {given.x(), given.y(), given.z() * lever_}};
}

Allocation::Output Allocation::most(const Vector3<double>& direction) const {
  const double everything = (layout_.steers() ? 20 * k_ : 2) * (high_ - low_).sum();
  return run(everything * Vector3<double>(direction.x(), direction.y(), lever_ * direction.z()));
}

Thrusters<double> Allocation::inputsOf(const Forces& force) const {
  Thrusters<double> inputs = Thrusters<double>::zero(layout_.size());
  for (int i = 0; i < inputs.size(); ++i) inputs(i) = inputFor(layout_[i].curve, force(i) / full_(i));
  return inputs;
}

}  // namespace ground
