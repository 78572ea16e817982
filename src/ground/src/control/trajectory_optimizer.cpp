#include "ground/control/trajectory_optimizer.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "ground/control/allocation.h"

namespace ground {
namespace {

/// Damping of the inputs, relative to full scale [m^2]. Less than the least has no effect.
constexpr double kMinDamping = 1e-4, kMaxDamping = 1e3;
/// Step sizes of the backtracking; the first that lowers the cost is taken. Smaller ones, or the
/// best one, ended in worse local minima.
constexpr std::array<double, 4> kLengths = {1, 0.5, 0.2, 0.05};
constexpr double kNoLimit = std::numeric_limits<double>::infinity();
constexpr double kSmallForce = 0.05;  // relative force at which flat force curves are linearised

/// A B, column by column: the compiler then uses wide registers, which it does not for Eigen's product.
template <int kSize, class Columns>
Columns times(const Eigen::Matrix<double, kSize, kSize>& A, const Columns& B) {
  Columns product(kSize, B.cols());
  for (Eigen::Index j = 0; j < B.cols(); ++j) {
    product.col(j) = B(0, j) * A.col(0);
    for (int k = 1; k < kSize; ++k) product.col(j) += B(k, j) * A.col(k);
  }
  return product;
}

/// Moment of an input of 1, over k l; of an angle, at full thrust.
double leverOf(const ThrusterLayout& layout, int channel) {
  if (layout.pushes(channel)) return layout.lever(channel);
  Thrusters<double> inputs = Thrusters<double>::zero(layout.size());
  for (int i = 0; i < inputs.size(); ++i)
    if (layout.pushes(i)) inputs(i) = layout[i].most;
  const double without = layout.atRest(inputs).z();
  inputs(channel) = 1;
  return layout.atRest(inputs).z() - without;
}

}  // namespace

TrajectoryOptimizer::TrajectoryOptimizer(const Model& model, int steps, double step)
    : dynamics_(model),
      derivatives_(model),
      count_(6 + model.stateCount()),
      input_max_(model.body.input_max),
      step_(step) {
  if (steps < 1 || steps > kMaxSteps || !(step > 0))
    throw std::invalid_argument("the horizon needs between 1 and 200 steps of positive length");
  const ThrusterLayout& layout = dynamics_.layout();
  const int inputs = layout.size();
  low_ = high_ = levers_ = PerThruster::Zero(inputs);
  least_input_ = Thrusters<double>::zero(inputs);
  unbounded_ = Thrusters<double>::filled(inputs, std::numeric_limits<double>::quiet_NaN());
  for (int i = 0; i < inputs; ++i) {
    low_(i) = layout[i].least * input_max_;
    high_(i) = layout[i].most * input_max_;
    levers_(i) = leverOf(layout, i);
    if (!layout[i].curve.linear()) least_input_(i) = inputFor(layout[i].curve, kSmallForce);
  }
  const auto number = static_cast<std::size_t>(steps);
  references_.resize(number);
  plan_.inputs.assign(number, Thrusters<double>::zero(inputs));
  plan_.states.assign(number + 1, State::Zero());
  tried_ = plan_;
  stages_.assign(number, {Square::Identity(), StatesByInputs::Zero(kStates, inputs),
                          PerThruster::Zero(inputs), StatesByInputs::Zero(kStates, inputs)});
  // Without a dependence on the pose, the derivatives by it are known.
  for (int i = dynamics_.usesPose() ? 0 : 3; i < count_; ++i) variables_.push_back(i);
  for (int i = 0; i < inputs; ++i) variables_.push_back(kStates + i);
}

void TrajectoryOptimizer::setProblem(double t, const State& start, const Conditions<double>& given,
                                     const Vector3<double>& missing,
                                     const std::vector<ReferencePoint>& references) {
  t_ = t;
  given_ = given;
  missing_ = missing;
  asVector(unbounded_).setConstant(std::numeric_limits<double>::quiet_NaN());
  start_ = start;
  std::copy(references.begin(), references.end(), references_.begin());
}

std::vector<Thrusters<double>>& TrajectoryOptimizer::newInputs() {
  has_gains_ = false;
  damping_ = 0;
  return plan_.inputs;
}

/// Cost of the state at the end of step i, per second.
double TrajectoryOptimizer::stateCost(std::size_t i, const RigidState<double>& state) const {
  const ReferencePoint& reference = references_[i];
  const bool end = i + 1 == references_.size();
  const double position = end ? 1 + weights_.end_position : 1;
  const double velocity = weights_.velocity + (end ? weights_.end_velocity : 0);
  const Vector2<double> over_floor = bodyToWorld<double>(state.eta.z(), state.nu.head<2>().eval());
  const double cost = position * (state.eta.head<2>() - reference.p).squaredNorm() +
                      velocity * (over_floor - reference.p_dot).squaredNorm();
  if (!walls_) return cost;
  Eigen::Matrix<double, 1, 5> unused;
  const double violation = walls_->fence.violation(state, walls_->age, unused);
  return cost + walls_->weight * violation * violation;
}

/// l_x and the Gauss-Newton part of l_xx of the cost of the plan's state at the end of step i.
TrajectoryOptimizer::CostDerivatives TrajectoryOptimizer::stateCostDerivatives(std::size_t i) const {
  CostDerivatives by;
  const State& state = plan_.states[i + 1];
  const ReferencePoint& reference = references_[i];
  const bool end = i + 1 == references_.size();
  const double position = 2 * step_ * (end ? 1 + weights_.end_position : 1);
  const double velocity = 2 * step_ * (weights_.velocity + (end ? weights_.end_velocity : 0));
  const Rotation<double> heading(state(2));
  const Vector2<double> over_floor = heading.toWorld({state(3), state(4)});
  by.gradient.head<2>() = position * (state.head<2>() - reference.p);
  by.curvature(0, 0) = by.curvature(1, 1) = position;
  Eigen::Matrix<double, 2, 3> turned;  // velocity over the floor by psi, u, v
  turned << -over_floor.y(), heading.c, -heading.s, over_floor.x(), heading.s, heading.c;
  by.gradient.tail<3>() = velocity * turned.transpose() * (over_floor - reference.p_dot);
  by.curvature.bottomRightCorner<3, 3>() = velocity * turned.transpose() * turned;
  if (!walls_) return by;
  Eigen::Matrix<double, 1, 5> wall;
  const double violation = walls_->fence.violation({state.head<3>(), state.segment<3>(3)}, walls_->age, wall);
  if (!(violation > 0)) return by;
  const double weight = 2 * step_ * walls_->weight;
  by.gradient += weight * violation * wall.transpose();
  by.curvature += weight * wall.transpose() * wall;
  return by;
}

/// Cost of the inputs of a step, per second.
double TrajectoryOptimizer::inputCost(const Thrusters<double>& input) const {
  const double turning = levers_.dot(asVector(input));
  return (weights_.input * asVector(input).squaredNorm() + weights_.turning * turning * turning) /
         (input_max_ * input_max_);
}

/// Simulates the inputs policy(i, state) into `tried_` until the cost reaches `limit`; returns the
/// cost.
template <class Policy>
double TrajectoryOptimizer::simulate(double limit, const Policy& policy) {
  tried_.states[0] = start_;
  double cost = 0;
  for (std::size_t i = 0; i < tried_.inputs.size() && cost < limit; ++i) {
    State& next = tried_.states[i + 1];
    next = tried_.states[i];
    tried_.inputs[i] = policy(i, next);
    const RigidState<double> after =
        drivenStep(dynamics_, t_ + static_cast<double>(i) * step_, {next.head<3>(), next.segment<3>(3)},
                   tried_.inputs[i], given_, missing_, step_, next.data() + 6);
    next.head<3>() = after.eta;
    next.segment<3>(3) = after.nu;
    cost += step_ * (inputCost(tried_.inputs[i]) + stateCost(i, after));
  }
  return cost;
}

/// Makes the tried trajectory the plan.
void TrajectoryOptimizer::accept(double cost) {
  cost_ = cost;
  is_linear_ = false;
  std::swap(plan_, tried_);
}

double TrajectoryOptimizer::rollOut() {
  accept(simulate(kNoLimit, [this](std::size_t i, const State&) { return plan_.inputs[i]; }));
  return cost_;
}

double TrajectoryOptimizer::error() const {
  double sum = 0;
  for (std::size_t i = 0; i < references_.size(); ++i)
    sum += (plan_.states[i + 1].head<2>() - references_[i].p).squaredNorm();
  return std::sqrt(sum / steps());
}

Thrusters<double> TrajectoryOptimizer::wanted() const {
  Thrusters<double> wanted = plan_.inputs.front();
  for (int i = 0; i < wanted.size(); ++i) {
    if (wanted(i) <= low_(i) && unbounded_(i) < low_(i)) wanted(i) = unbounded_(i);
    if (wanted(i) >= high_(i) && unbounded_(i) > high_(i)) wanted(i) = unbounded_(i);
  }
  return wanted;
}

/// f_x and f_u of step i of the plan.
void TrajectoryOptimizer::linearize(std::size_t i) {
  Stage& stage = stages_[i];
  const auto number = static_cast<int>(variables_.size());
  for (int begin = 0; begin < number; begin += kDerivatives) {
    const int end = std::min(number, begin + kDerivatives);
    std::array<Jet, kStates> x;
    for (int j = 0; j < count_; ++j) x[static_cast<std::size_t>(j)] = Jet(plan_.states[i](j));
    Thrusters<Jet> command = plan_.inputs[i].cast<Jet>();
    for (int j = 0; j < command.size(); ++j)
      if (std::abs(command(j).a) < least_input_(j)) command(j).a = least_input_(j);
    for (int j = begin; j < end; ++j) {
      const int variable = variables_[static_cast<std::size_t>(j)];
      (variable < kStates ? x[static_cast<std::size_t>(variable)] : command(variable - kStates))
          .v[j - begin] = 1.0;
    }
    const RigidState<Jet> after = drivenStep<Jet>(
        derivatives_, Jet(t_ + static_cast<double>(i) * step_), {{x[0], x[1], x[2]}, {x[3], x[4], x[5]}},
        command, {given_.lift, given_.volts}, missing_.cast<Jet>(), step_, &x[6]);
    for (std::size_t j = 0; j < 3; ++j) {
      x[j] = after.eta(static_cast<int>(j));
      x[3 + j] = after.nu(static_cast<int>(j));
    }
    for (int j = begin; j < end; ++j) {
      const int variable = variables_[static_cast<std::size_t>(j)];
      for (int row = 0; row < count_; ++row)
        (variable < kStates ? stage.fx(row, variable) : stage.fu(row, variable - kStates)) =
            x[static_cast<std::size_t>(row)].v[j - begin];
    }
  }
  if (dynamics_.usesPose()) return;
  // The motion is invariant under translation and rotation of the pose.
  const Vector2<double> moved = (plan_.states[i + 1] - plan_.states[i]).head<2>();
  stage.fx(0, 2) = -moved.y();
  stage.fx(1, 2) = moved.x();
}

/// The backward pass for the first kSize states, in the paper's symbols. Returns false if the
/// quadratic problem has no minimum.
template <int kSize, int kInputs>
bool TrajectoryOptimizer::backwardPass() {
  using Box = BoxMinimumOf<kInputs>;
  using Vector = Eigen::Matrix<double, kSize, 1>;
  using States = Eigen::Matrix<double, kSize, kSize>;
  using Input = typename Box::Vector;
  using ByInputs = Eigen::Matrix<double, kSize, kInputs, 0, kSize, Input::MaxRowsAtCompileTime>;
  Box box;
  const double scale = 1 / (input_max_ * input_max_);
  Vector Vx = Vector::Zero();
  States Vxx = States::Zero();
  typename Box::Square luu = weights_.turning * levers_ * levers_.transpose();
  luu.diagonal().array() += weights_.input;
  luu *= 2 * step_ * scale;
  for (std::size_t i = stages_.size(); i-- > 0;) {
    Stage& stage = stages_[i];
    const States fx = stage.fx.topLeftCorner<kSize, kSize>(), fxT = fx.transpose();
    const ByInputs fu = stage.fu.template topRows<kSize>();
    const Input u = asVector(plan_.inputs[i]);
    const CostDerivatives cost = stateCostDerivatives(i);
    Vx.template head<5>() += cost.gradient;
    Vxx.template topLeftCorner<5, 5>() += cost.curvature;
    // (5); Qxu is Qux transposed
    const ByInputs Vxx_fu = times(Vxx, fu);
    const Input Qu = luu * u + fu.transpose() * Vx;
    const typename Box::Square Quu = luu + fu.transpose().lazyProduct(Vxx_fu);
    const ByInputs Qxu = times(fxT, Vxx_fu);
    typename Box::Square damped = Quu;
    damped.diagonal().array() += damping_ * scale;
    if (!box.solve(damped, Qu, low_ - u, high_ - u)) return false;
    const Input& k = box.minimum();
    stage.k = k;
    const ByInputs KT = -box.solveFree(Qxu);
    stage.K.topRows<kSize>() = KT;
    if (i == 0) asVector(unbounded_) = u + box.unbounded();
    // (6), with the damping in k and K only
    Vx = (times(fxT, Vx) + KT * (Quu * k + Qu) + Qxu * k).eval();
    Vxx = times(fxT, times(Vxx, fx));
    const ByInputs KT_Quu_Qxu = KT.lazyProduct(Quu) + Qxu;
    for (Eigen::Index j = 0; j < KT.cols(); ++j)
      Vxx += KT_Quu_Qxu.col(j) * KT.col(j).transpose() + KT.col(j) * Qxu.col(j).transpose();
  }
  return true;
}

/// Inputs of step i: the plan's, with a part of the last iteration's change and with its feedback on
/// the deviation of `state` from the plan, within their ranges.
Thrusters<double> TrajectoryOptimizer::withFeedback(std::size_t i, double length, const State& state) const {
  const Stage& stage = stages_[i];
  PerThruster u = asVector(plan_.inputs[i]) + length * stage.k;
  u += stage.K.transpose() * (state - plan_.states[i]);
  return u.cwiseMax(low_).cwiseMin(high_).eval();
}

/// Moves inputs, gains and planned states by `shift` [s].
void TrajectoryOptimizer::shiftPlan(double shift) {
  const std::size_t last = stages_.size() - 1;
  const double whole = std::floor(shift / step_), part = shift / step_ - whole;
  const auto ahead = static_cast<std::size_t>(std::min<double>(whole, kMaxSteps));
  const auto between = [part](const auto& a, const auto& b) { return (1 - part) * a + part * b; };
  for (std::size_t i = 0; i <= last; ++i) {
    const std::size_t from = std::min(last, i + ahead), to = std::min(last, from + 1);
    asVector(plan_.inputs[i]) = between(asVector(plan_.inputs[from]), asVector(plan_.inputs[to]));
    plan_.states[i] = between(plan_.states[from], plan_.states[from + 1]).eval();
    stages_[i].K = between(stages_[from].K, stages_[to].K);
    if (i + ahead > last) stages_[i].K.setZero();  // no states are planned so far ahead
  }
  // The measured heading may have been wrapped.
  const double turn = start_(2) - plan_.states[0](2), turns = turn - wrapAngle(turn);
  for (State& state : plan_.states) state(2) += turns;
}

double TrajectoryOptimizer::warmStart(double shift) {
  shiftPlan(shift);
  if (!has_gains_) return rollOut();
  accept(simulate(kNoLimit, [this](std::size_t i, const State& state) { return withFeedback(i, 0, state); }));
  const double limit = std::isfinite(cost_) ? cost_ : kNoLimit;
  // accept() left the shifted inputs in tried_.
  const double open =
      simulate(limit, [this](std::size_t i, const State&) -> Thrusters<double> { return tried_.inputs[i]; });
  if (open < limit) accept(open);
  return cost_;
}

bool TrajectoryOptimizer::improve() {
  for (std::size_t i = 0; i < stages_.size() && !is_linear_; ++i) linearize(i);
  is_linear_ = true;
  const bool is_pair = low_.size() == 2;
  if (count_ == 6 ? (is_pair ? backwardPass<6, 2>() : backwardPass<6, Eigen::Dynamic>())
                  : backwardPass<kStates, Eigen::Dynamic>()) {
    has_gains_ = true;
    for (const double length : kLengths) {
      const double cost =
          simulate(cost_, [&](std::size_t i, const State& state) { return withFeedback(i, length, state); });
      if (!(cost < cost_)) continue;
      accept(cost);
      if (length == 1) damping_ = damping_ / 5 < kMinDamping ? 0 : damping_ / 5;
      return true;
    }
  }
  damping_ = std::min(kMaxDamping, std::max(kMinDamping, 10 * damping_));
  return false;
}

}  // namespace ground
