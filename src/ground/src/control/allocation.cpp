#include "ground/control/allocation.h"

#include <algorithm>
#include <cmath>

namespace ground {
namespace {

constexpr double kEffort = 1e-9;  // e of the class comment
constexpr double kMet = 1e-6;     // relative error of a wrench that counts as met

double inputInTable(const std::vector<std::array<double, 2>>& table, double force) {
  // Points from input 0 outwards, on the side of the force.
  const double side = force > 0 ? 1 : -1;
  double input = 0, reached = 0;
  const auto step = [&](const std::array<double, 2>& point) {
    const double next_input = side * point[0], next = side * point[1];
    if (next_input <= 0 || side * force <= reached) return;
    if (next > reached) {
      const double share = std::min(1.0, (side * force - reached) / (next - reached));
      input += share * (next_input - input);
    } else {
      input = next_input;
    }
    reached = next;
  };
  if (side > 0)
    std::for_each(table.begin(), table.end(), step);
  else
    std::for_each(table.rbegin(), table.rend(), step);
  if (side * force > reached && reached > 0) input *= side * force / reached;
  return side * input;
}

}  // namespace

double inputFor(const ForceCurve& curve, double force) {
  if (force == 0 || curve.linear()) return force;
  if (!curve.table.empty()) return inputInTable(curve.table, force);
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
