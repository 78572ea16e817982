#include "ground/control/allocation.h"

#include <algorithm>
#include <cmath>

namespace ground {
namespace {

constexpr double kEffort = 1e-9;  // e of the class comment
constexpr double kMet = 1e-6;     // relative error of a wrench that counts as met

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
    : layout_(layout), lever_(body.l), weights_(weights.surge, weights.sway, weights.yaw) {
  const int count = layout.size();
  columns_.resize(3, count);
  for (Forces* forces : {&full_, &low_, &high_}) forces->resize(count);
  for (int i = 0; i < count; ++i) {
    const Thruster& one = layout[i];
    columns_.col(i) << layout.forward(i), layout.starboard(i), layout.lever(i);
    full_(i) = body.k * one.gain;
    low_(i) = full_(i) * one.curve.at(one.least * body.input_max);
    high_(i) = full_(i) * one.curve.at(one.most * body.input_max);
  }
  hessian_.noalias() = columns_.transpose() * weights_.asDiagonal() * columns_;
  // A gain only matters relative to the others'.
  const double scale = kEffort * full_.cwiseAbs2().minCoeff();
  for (int i = 0; i < count; ++i) hessian_(i, i) += scale / (full_(i) * full_(i));
}

Allocation::Output Allocation::run(const Vector3<double>& wrench) const {
  const Vector3<double> demand(wrench.x(), wrench.y(), wrench.z() / lever_);
  problem_.solve(hessian_, -(columns_.transpose() * weights_.cwiseProduct(demand)), low_, high_);
  const Forces& force = problem_.minimum();
  const Vector3<double> given = columns_ * force;
  const Vector3<double> reachable = columns_ * problem_.unbounded();
  const bool met = (given - reachable).norm() <= kMet * high_.maxCoeff();
  const Thrusters<double> inputs = inputsOf(force);
  return {inputs, met ? inputs : inputsOf(problem_.unbounded()), {given.x(), given.y(), given.z() * lever_}};
}

Allocation::Output Allocation::most(const Vector3<double>& direction) const {
  const double everything = 2 * (high_ - low_).sum();
  return run(everything * Vector3<double>(direction.x(), direction.y(), lever_ * direction.z()));
}

Thrusters<double> Allocation::inputsOf(const Forces& force) const {
  Thrusters<double> inputs = Thrusters<double>::zero(layout_.size());
  for (int i = 0; i < inputs.size(); ++i) inputs(i) = inputFor(layout_[i].curve, force(i) / full_(i));
  return inputs;
}

}  // namespace ground
