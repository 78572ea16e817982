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
#include "ground/control/box_minimum.h"

namespace ground {
namespace {

/// Damping of the inputs, relative to full scale [m^2]. Less than the least has no effect.
constexpr double kMinDamping = 1e-4, kMaxDamping = 1e3;
/// Parts of a change that are tried, one by one, if the whole change does not lower the cost. The
/// largest one that does is taken. Smaller parts, or the cheapest one, lead to worse valleys.
constexpr std::array<double, 3> kLengths = {0.5, 0.2, 0.05};
static_assert(1 > kLengths[0] && kLengths[0] > kLengths[1] && kLengths[1] > kLengths[2]);

constexpr double kNoLimit = std::numeric_limits<double>::infinity();
constexpr double kSmallForce = 0.05;  // relative force at which flat force curves are linearised

/// The optimizer of N inputs, Eigen::Dynamic for any number, and of models with at most S states.
/// The algebra, which takes most of the time, is faster with small sizes that the compiler knows.
template <int N, int S>
class SizedOptimizer final : public TrajectoryOptimizer {
 public:
  SizedOptimizer(const Model& model, int steps, double step)
      : TrajectoryOptimizer(model, steps, step) {
    const auto count = static_cast<std::size_t>(steps);
    const int inputs = thrusterCount();
    Input levers = Input::Zero(inputs);
    low_ = high_ = levers;
    for (int i = 0; i < inputs; ++i) {
      const Thruster& one = dynamics_.layout()[i];
      low_(i) = one.least * input_max_;
      high_(i) = one.most * input_max_;
      levers(i) = levers_(i);
    }
    turning_ = levers * levers.transpose();
    open_.assign(count, Input::Zero(inputs));
    linear_.assign(count, {Square::Identity(), Square::Identity(), Drive::Zero(kRows, inputs)});
    gains_.assign(count, Drive::Zero(kRows, inputs));
    for (int i = 3; i < 6 + effect_states_; ++i) variables_.push_back(i);
    for (int i = 0; i < inputs; ++i) variables_.push_back(kStates + i);
    if (dynamics_.usesPose()) variables_.insert(variables_.end(), {0, 1, 2});
  }

  double carryOn(double shift) override;
  bool improve(double slight) override;

 private:
  using Input = PerThruster<N>;
  static constexpr int kMax = BoxMinimum<N>::kMax;
  using InputSquare = typename BoxMinimum<N>::Square;
  static constexpr int kRows = S;
  using Vector = Eigen::Matrix<double, kRows, 1>;
  using Square = Eigen::Matrix<double, kRows, S>;
  /// For each input a column of states.
  using Drive = Eigen::Matrix<double, kRows, N, 0, kRows, kMax>;
  /// Derivatives of a state by the state before it, also transposed, and by the inputs.
  struct Linear {
    Square A, transposed;
    Drive B;
  };

  static Eigen::Map<const Input> vectorOf(const Thrusters<double>& inputs) {
    return Eigen::Map<const Input>(inputs.begin(), inputs.size());
  }

  void linearize(std::size_t k);
  template <class Of>
  void keep(std::size_t k, int variable, const Of& of);
  bool backward();
  void moveLinearly();
  Thrusters<double> corrected(std::size_t k, Input input, const State& state) const;
  bool tryParts();
  void shiftPlan(double shift);

  Input low_, high_;     ///< ranges of the inputs
  InputSquare turning_;  ///< curvature of the cost of turning
  std::vector<Input> open_;
  std::vector<Linear> linear_;
  std::vector<Drive> gains_;  ///< transposed
  BoxMinimum<N> box_;
  /// What the steps are differentiated by: indices of states, then of inputs (from kStates on).
  std::vector<int> variables_;
  double predicted_ = 0;  ///< change of the cost that the last quadratic problem predicts [m^2 s]
};

template <int N>
std::unique_ptr<TrajectoryOptimizer> makeSized(const Model& model, int steps, double step) {
  constexpr int kBody = 6, kOfLag = 2;  // states of the rigid body, of the motors of a pair
  const int states = model.stateCount();
  if (states == 0) return std::make_unique<SizedOptimizer<N, kBody>>(model, steps, step);
  if constexpr (N == 2) {
    if (states <= kOfLag)
      return std::make_unique<SizedOptimizer<N, kBody + kOfLag>>(model, steps, step);
  }
  return std::make_unique<SizedOptimizer<N, TrajectoryOptimizer::kStates>>(model, steps, step);
}

}  // namespace

const Tunables<PlanWeights>& PlanWeights::table() {
  using W = PlanWeights;
  static const Tunables<W> table = {
      {{"velocity", "s^2", "Weight of the velocity error", 0, 100, {1, -4, 1}}, &W::velocity},
      {{"input", "m^2", "Weight of the inputs, of full scale", 0, 100, {1, -7, -1}}, &W::input},
      {{"turning", "m^2", "Weight of the moment of the inputs, of full scale", 0, 100, {1, -7, -1}},
       &W::turning},
      {{"end_position", "-", "Weight of the position error at the end", 0, 1e4, {1, -2, 3}},
       &W::end_position},
      {{"end_velocity", "s^2", "Weight of the velocity error at the end", 0, 1e4, {1, -2, 3}},
       &W::end_velocity},
  };
  return table;
}

TrajectoryOptimizer::Trial::Trial(int steps, int thrusters) {
  const auto count = static_cast<std::size_t>(std::max(0, steps));
  inputs.assign(count, Thrusters<double>::zero(thrusters));
  states.assign(count + 1, State::Zero());
}

TrajectoryOptimizer::TrajectoryOptimizer(const Model& model, int steps, double step)
    : dynamics_(model),
      derivatives_(model),
      effect_states_(model.stateCount()),
      input_max_(model.body.input_max),
      step_(step),
      plan_(steps, thrusterCount()),
      tried_(plan_) {
  if (effect_states_ > kMaxStates)
    throw std::invalid_argument("a model whose effects have more than " +
                                std::to_string(kMaxStates) +
                                " states cannot be planned with");
  if (steps < 1 || steps > kMaxSteps || !(step > 0))
    throw std::invalid_argument("the horizon needs between 1 and 200 steps of positive length");
  const int inputs = thrusterCount();
  references_.resize(static_cast<std::size_t>(steps));
  unbounded_ = Thrusters<double>::filled(inputs, std::numeric_limits<double>::quiet_NaN());
  least_input_ = levers_ = Thrusters<double>::zero(inputs);
  for (int i = 0; i < inputs; ++i) {
    levers_(i) = dynamics_.layout().lever(i);
    const ForceCurve& curve = dynamics_.layout()[i].curve;
    if (!curve.linear()) least_input_(i) = inputFor(curve, kSmallForce);
  }
}

std::unique_ptr<TrajectoryOptimizer> TrajectoryOptimizer::make(const Model& model, int steps,
                                                               double step) {
  if (model.thrusters->size() == 2) return makeSized<2>(model, steps, step);
  return makeSized<Eigen::Dynamic>(model, steps, step);
}

void TrajectoryOptimizer::setProblem(double t, const State& start, double lift,
                                     const Vector3<double>& missing,
                                     const std::vector<ReferencePoint>& references) {
  t_ = t;
  lift_ = lift;
  missing_ = missing;
  asVector(unbounded_).setConstant(std::numeric_limits<double>::quiet_NaN());
  start_ = start;
  std::copy(references.begin(), references.end(), references_.begin());
}

double TrajectoryOptimizer::stateCost(int k, const RigidState<double>& state) const {
  const ReferencePoint& reference = references_[static_cast<std::size_t>(k)];
  const bool end = k + 1 == steps();
  const double position = end ? 1 + weights_.end_position : 1;
  const double velocity = weights_.velocity + (end ? weights_.end_velocity : 0);
  const Vector2<double> off = state.eta.head<2>() - reference.p;
  const Vector2<double> slip =
      bodyToWorld<double>(state.eta.z(), state.nu.head<2>()) - reference.p_dot;
  const double cost = position * off.squaredNorm() + velocity * slip.squaredNorm();
  if (!walls_) return cost;
  Eigen::Matrix<double, 1, 5> unused;
  const double excess = walls_->fence.excess(state, walls_->age, unused);
  return cost + walls_->weight * excess * excess;
}

TrajectoryOptimizer::CostDerivatives TrajectoryOptimizer::stateCostDerivatives(int k) const {
  CostDerivatives by;
  const State& state = plan_.states[static_cast<std::size_t>(k) + 1];
  const ReferencePoint& reference = references_[static_cast<std::size_t>(k)];
  const bool end = k + 1 == steps();
  const double position = 2 * step_ * (end ? 1 + weights_.end_position : 1);
  const double velocity = 2 * step_ * (weights_.velocity + (end ? weights_.end_velocity : 0));
  const Rotation<double> heading(state(2));
  const Vector2<double> over_floor = heading.toWorld({state(3), state(4)});
  const Vector2<double> slip = over_floor - reference.p_dot;
  by.gradient.head<2>() = position * (state.head<2>() - reference.p);
  by.curvature(0, 0) = by.curvature(1, 1) = position;
  Eigen::Matrix<double, 2, 3> turned;  // velocity over the floor by psi, u, v
  turned << -over_floor.y(), heading.c, -heading.s, over_floor.x(), heading.s, heading.c;
  by.gradient.tail<3>().noalias() = velocity * turned.transpose() * slip;
  by.curvature.bottomRightCorner<3, 3>().noalias() = velocity * turned.transpose() * turned;
  if (!walls_) return by;
  Eigen::Matrix<double, 1, 5> wall;
  const double excess =
      walls_->fence.excess({state.head<3>(), state.segment<3>(3)}, walls_->age, wall);
  if (!(excess > 0)) return by;
  const double weight = 2 * step_ * walls_->weight;
  by.gradient += weight * excess * wall.transpose();
  by.curvature.noalias() += weight * wall.transpose() * wall;
  return by;
}

double TrajectoryOptimizer::inputCost(const Thrusters<double>& input) const {
  double squares = 0, turning = 0;
  for (int i = 0; i < input.size(); ++i) {
    squares += input(i) * input(i);
    turning += levers_(i) * input(i);
  }
  return (weights_.input * squares + weights_.turning * turning * turning) /
         (input_max_ * input_max_);
}

template <class Plan>
double TrajectoryOptimizer::tryOut(double limit, const Plan& plan) {
  Trial& trial = tried_;
  trial.states[0] = start_;
  double cost = 0;
  // A cost that is not a number ends it, too.
  for (std::size_t i = 0; i < trial.inputs.size() && cost < limit; ++i) {
    const int k = static_cast<int>(i);
    State& next = trial.states[i + 1];
    next = trial.states[i];
    trial.inputs[i] = plan(i, next);
    const RigidState<double> before{next.head<3>(), next.segment<3>(3)};
    const RigidState<double> after = drivenStep(dynamics_, t_ + k * step_, before, trial.inputs[i],
                                                lift_, missing_, step_, next.data() + 6);
    next.head<3>() = after.eta;
    next.segment<3>(3) = after.nu;
    cost += step_ * (inputCost(trial.inputs[i]) + stateCost(k, after));
  }
  return cost;
}

void TrajectoryOptimizer::take(double cost) {
  cost_ = cost;
  is_linear_ = false;
  is_simulated_ = true;
  std::swap(plan_, tried_);
}

double TrajectoryOptimizer::rollOut() {
  take(tryOut(kNoLimit, [this](std::size_t k, const State&) { return plan_.inputs[k]; }));
  return cost_;
}

double TrajectoryOptimizer::error() const {
  double sum = 0;
  for (std::size_t k = 0; k < references_.size(); ++k)
    sum += (plan_.states[k + 1].head<2>() - references_[k].p).squaredNorm();
  return std::sqrt(sum / steps());
}

Thrusters<double> TrajectoryOptimizer::wanted() const {
  Thrusters<double> wanted = plan_.inputs.front();
  for (int i = 0; i < wanted.size(); ++i) {
    const Thruster& one = dynamics_.layout()[i];
    const double low = one.least * input_max_, high = one.most * input_max_;
    if (wanted(i) <= low && unbounded_(i) < low) wanted(i) = unbounded_(i);
    if (wanted(i) >= high && unbounded_(i) > high) wanted(i) = unbounded_(i);
  }
  return wanted;
}

/// Keeps the derivatives of state j after step k by a variable, which of(j) gives.
template <int N, int S>
template <class Of>
void SizedOptimizer<N, S>::keep(std::size_t k, int variable, const Of& of) {
  Linear& linear = linear_[k];
  for (int j = 0; j < S; ++j) {
    if (variable < kStates)
      linear.A(j, variable) = linear.transposed(variable, j) = of(j);
    else
      linear.B(j, variable - kStates) = of(j);
  }
}

/// Derivatives of the states after step k of the plan by the states before it and by the inputs.
template <int N, int S>
void SizedOptimizer<N, S>::linearize(std::size_t k) {
  const auto count = static_cast<int>(variables_.size());
  for (int begin = 0; begin < count; begin += kDerivatives) {
    const int end = std::min(count, begin + kDerivatives);
    std::array<Jet, kStates> x;
    for (int i = 0; i < kStates; ++i) x[static_cast<std::size_t>(i)] = Jet(plan_.states[k](i));
    Thrusters<Jet> command = plan_.inputs[k].cast<Jet>();
    for (int i = 0; i < command.size(); ++i)
      if (abs(command(i)) < least_input_(i)) command(i) = Jet(least_input_(i));
    for (int i = begin; i < end; ++i) {
      const int variable = variables_[static_cast<std::size_t>(i)];
      Jet& one =
          variable < kStates ? x[static_cast<std::size_t>(variable)] : command(variable - kStates);
      one.v[i - begin] = 1.0;
    }
    const RigidState<Jet> before{{x[0], x[1], x[2]}, {x[3], x[4], x[5]}};
    const RigidState<Jet> body =
        drivenStep<Jet>(derivatives_, Jet(t_ + static_cast<double>(k) * step_), before, command,
                        lift_, missing_.cast<Jet>(), step_, &x[6]);
    for (int i = 0; i < 3; ++i) {
      x[static_cast<std::size_t>(i)] = body.eta(i);
      x[static_cast<std::size_t>(3 + i)] = body.nu(i);
    }
    for (int i = begin; i < end; ++i)
      keep(k, variables_[static_cast<std::size_t>(i)],
           [&](int j) { return x[static_cast<std::size_t>(j)].v[i - begin]; });
  }
  if (dynamics_.usesPose()) return;
  // The motion is invariant under translation and rotation of the pose.
  const Vector2<double> way = (plan_.states[k + 1] - plan_.states[k]).template head<2>();
  Linear& linear = linear_[k];
  linear.A(0, 2) = linear.transposed(2, 0) = -way.y();
  linear.A(1, 2) = linear.transposed(2, 1) = way.x();
}

/// The quadratic problem of the iteration, from its end to its start. Returns false if it has no
/// minimum, or when time is up.
template <int N, int S>
bool SizedOptimizer<N, S>::backward() {
  const double scale = 1 / (input_max_ * input_max_);
  const int inputs = thrusterCount();
  Vector gradient = Vector::Zero();
  Square curvature = Square::Zero();
  InputSquare input_curvature = weights_.turning * turning_;
  input_curvature.diagonal().array() += weights_.input;
  input_curvature *= 2 * step_ * scale;
  predicted_ = 0;
  for (int k = steps() - 1; k >= 0; --k) {
    if (!timeFor(k)) return false;
    const auto i = static_cast<std::size_t>(k);
    const CostDerivatives cost = stateCostDerivatives(k);
    gradient.template head<5>() += cost.gradient;
    curvature.template topLeftCorner<5, 5>() += cost.curvature;

    const auto& [A, transposed, B] = linear_[i];
    const auto input = vectorOf(plan_.inputs[i]);
    Square VA = Square::Zero();
    VA.noalias() += curvature * (A);
    Drive VB = Drive::Zero(kRows, inputs);
    VB.noalias() += curvature * (B);
    Input Qu = input_curvature * input;
    Qu.noalias() += B.transpose() * gradient;
    InputSquare Quu = input_curvature;
    Quu.noalias() += B.transpose() * VB;
    Drive Qxu = Drive::Zero(kRows, inputs);
    Qxu.noalias() += transposed * (VB);
    InputSquare damped = Quu;
    damped.diagonal().array() += damping_ * scale;
    if (!box_.solve(damped, Qu, low_ - input, high_ - input)) return false;
    const Input& change = box_.minimum();
    predicted_ += change.dot(Qu + 0.5 * Quu * change);
    if (k == 0) asVector(unbounded_) = input + box_.unbounded();
    const Drive gain = -box_.solveFree(Qxu);
    open_[i] = change;
    gains_[i] = gain;
    Vector Qx = Vector::Zero();
    Qx.noalias() += transposed * (gradient);
    Qx.noalias() += gain * (Quu * change + Qu);
    Qx.noalias() += Qxu * (change);
    gradient = Qx;
    Square Qxx = Square::Zero();
    Qxx.noalias() += transposed * (VA);
    Drive half = Qxu;
    half.noalias() += gain * (0.5 * Quu);
    Qxx.noalias() += half * (gain.transpose());
    Qxx.noalias() += gain * (half.transpose());
    curvature = Qxx;
  }
  return true;
}

/// Inputs of step k with feedback on the deviation of `state` from the plan, within their ranges.
template <int N, int S>
Thrusters<double> SizedOptimizer<N, S>::corrected(std::size_t k, Input input,
                                                  const State& state) const {
  input.noalias() +=
      gains_[k].template topRows<S>().transpose() * (state - plan_.states[k]).template head<S>();
  return input.cwiseMax(low_).cwiseMin(high_).eval();
}

/// Makes the largest part of the last iteration's change that lowers the cost, if there is one.
template <int N, int S>
bool SizedOptimizer<N, S>::tryParts() {
  for (const double length : kLengths) {
    if (!timeLeft()) return false;
    const double cost = tryOut(cost_, [&](std::size_t k, const State& state) {
      return corrected(k, vectorOf(plan_.inputs[k]) + length * open_[k], state);
    });
    if (!(cost < cost_)) continue;
    take(cost);
    return true;
  }
  return false;
}

/// Makes the last iteration's change of the plan, to first order.
template <int N, int S>
void SizedOptimizer<N, S>::moveLinearly() {
  Vector deviation = Vector::Zero();  // of the new state from the planned one
  for (std::size_t k = 0; k < plan_.inputs.size(); ++k) {
    const Input before = vectorOf(plan_.inputs[k]);
    const Input wanted = before + open_[k] + gains_[k].transpose() * deviation;
    const Input after = wanted.cwiseMax(low_).cwiseMin(high_);
    asVector(plan_.inputs[k]) = after;
    Vector next = Vector::Zero();
    next.noalias() += linear_[k].A * (deviation);
    next.noalias() += linear_[k].B * (after - before);
    deviation = next;
    plan_.states[k + 1].template head<S>() += deviation.template head<S>();
  }
  cost_ += predicted_;
  is_linear_ = is_simulated_ = false;
}

/// Moves inputs, gains and planned states by `shift` [s].
template <int N, int S>
void SizedOptimizer<N, S>::shiftPlan(double shift) {
  const auto last = static_cast<std::size_t>(steps() - 1);
  const double whole = std::floor(shift / step_), part = shift / step_ - whole;
  const auto ahead = static_cast<std::size_t>(std::min<double>(whole, kMaxSteps));
  const auto between = [part](const auto& a, const auto& b) { return (1 - part) * a + part * b; };
  for (std::size_t k = 0; k <= last; ++k) {
    const std::size_t from = std::min(last, k + ahead), to = std::min(last, from + 1);
    plan_.inputs[k] = between(vectorOf(plan_.inputs[from]), vectorOf(plan_.inputs[to])).eval();
    plan_.states[k] = between(plan_.states[from], plan_.states[from + 1]).eval();
    gains_[k] = between(gains_[from], gains_[to]).eval();
    if (k + ahead > last) gains_[k].setZero();  // no states are planned so far ahead
  }
  // The measured heading may have been wrapped.
  const double turn = start_(2) - plan_.states[0](2), turns = turn - wrapAngle(turn);
  for (State& state : plan_.states) state(2) += turns;
}

template <int N, int S>
double SizedOptimizer<N, S>::carryOn(double shift) {
  shiftPlan(shift);
  if (!has_gains_) return rollOut();
  take(tryOut(kNoLimit, [this](std::size_t k, const State& state) {
    return corrected(k, vectorOf(plan_.inputs[k]), state);
  }));
  const double limit = std::isfinite(cost_) ? cost_ : kNoLimit;
  // The shifted inputs are the tried ones now.
  const double open = tryOut(limit, [this](std::size_t k, const State&) {
    return tried_.inputs[k];
  });
  if (open < limit) take(open);
  return cost_;
}

template <int N, int S>
bool SizedOptimizer<N, S>::improve(double slight) {
  if (!is_simulated_) rollOut();
  for (int k = 0; k < steps() && !is_linear_; ++k) {
    if (!timeFor(k)) return false;
    linearize(static_cast<std::size_t>(k));
  }
  is_linear_ = true;
  if (backward()) {
    has_gains_ = true;
    if (damping_ == 0 && predicted_ > -slight * cost_) {
      moveLinearly();
      return true;
    }
    if (!timeLeft()) return false;
    const double cost = tryOut(cost_, [&](std::size_t k, const State& state) {
      return corrected(k, vectorOf(plan_.inputs[k]) + open_[k], state);
    });
    if (cost < cost_) {
      take(cost);
      damping_ = damping_ / 5 < kMinDamping ? 0 : damping_ / 5;
      return true;
    }
    if (!timeLeft()) return false;
    if (tryParts()) return true;
  }
  const bool is_interrupted = budget_ && budget_->isUp();
  if (!is_interrupted) damping_ = std::min(kMaxDamping, std::max(kMinDamping, 10 * damping_));
  return false;
}

}  // namespace ground
