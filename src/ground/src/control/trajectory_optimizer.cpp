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
#include "ground/control/register_product.h"

namespace ground {
namespace {

/// Damping of the inputs, relative to full scale [m^2]. Less than the least has no effect.
constexpr double kMinDamping = 1e-4, kMaxDamping = 1e3;
/// Parts of a change that are tried, side by side, if the whole change does not lower the cost. The
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
    if (variables_.size() <= LanesJet::kDirections)
      derivatives_.useDirections(static_cast<int>(variables_.size()));
  }

  double carryOn(double shift) override;
  bool improve(double slight) override;

 private:
  using Input = PerThruster<N>;
  static constexpr int kMax = BoxMinimum<N>::kMax;
  using InputSquare = typename BoxMinimum<N>::Square;
  /// Rows of the states' vectors and matrices, in whole registers (addProduct); those from S on are 0.
  static constexpr int kRows = (S + 7) / 8 * 8;
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

  void linearize(int first);
  template <class Of>
  void keep(std::size_t k, int variable, const Of& of);
  bool backward();
  void moveLinearly();
  Thrusters<double> corrected(std::size_t k, Input input, const State& state) const;
  Thrusters<Lanes> correctedOfEach(std::size_t k, const Lanes& lengths,
                                   const Eigen::Matrix<Lanes, kStates, 1>& states) const;
  bool takeFirst(const Lanes& costs);
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

template <typename T>
TrajectoryOptimizer::Trial<T>::Trial(int steps, int thrusters) {
  const auto count = static_cast<std::size_t>(std::max(0, steps));
  inputs.assign(count, Thrusters<T>::zero(thrusters));
  states.assign(count + 1, Eigen::Matrix<T, kStates, 1>::Zero());
  headings.assign(count + 1, Rotation<T>(T(0.0)));
}

TrajectoryOptimizer::TrajectoryOptimizer(const Model& model, int steps, double step)
    : dynamics_(model),
      dynamics_of_each_(model),
      derivatives_(model),
      effect_states_(model.stateCount()),
      input_max_(model.body.input_max),
      step_(step),
      plan_(steps, thrusterCount()),
      tried_(plan_),
      each_(steps, thrusterCount()) {
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

template <typename T>
T TrajectoryOptimizer::stateCost(int k, const RigidState<T>& state,
                                 const Rotation<T>& heading) const {
  const ReferencePoint& reference = references_[static_cast<std::size_t>(k)];
  const bool end = k + 1 == steps();
  const double position = end ? 1 + weights_.end_position : 1;
  const double velocity = weights_.velocity + (end ? weights_.end_velocity : 0);
  const Vector2<T> off = state.eta.template head<2>() - reference.p.cast<T>();
  const Vector2<T> over_floor = heading.toWorld({state.nu.x(), state.nu.y()});
  const Vector2<T> slip = over_floor - reference.p_dot.cast<T>();
  const T cost = position * off.squaredNorm() + velocity * slip.squaredNorm();
  return walls_ ? T(cost + wallCost(state)) : cost;
}

double TrajectoryOptimizer::wallCost(const RigidState<double>& state) const {
  Eigen::Matrix<double, 1, 5> unused;
  const double excess = walls_->fence.excess(state, walls_->age, unused);
  return walls_->weight * excess * excess;
}

Lanes TrajectoryOptimizer::wallCost(const RigidState<Lanes>& state) const {
  Lanes costs;
  for (int lane = 0; lane < Lanes::kCount; ++lane) {
    const auto of = [lane](const Lanes& x) { return x[lane]; };
    costs[lane] = wallCost(RigidState<double>{state.eta.unaryExpr(of), state.nu.unaryExpr(of)});
  }
  return costs;
}

TrajectoryOptimizer::CostDerivatives TrajectoryOptimizer::stateCostDerivatives(int k) const {
  CostDerivatives by;
  const State& state = plan_.states[static_cast<std::size_t>(k) + 1];
  const ReferencePoint& reference = references_[static_cast<std::size_t>(k)];
  const bool end = k + 1 == steps();
  const double position = 2 * step_ * (end ? 1 + weights_.end_position : 1);
  const double velocity = 2 * step_ * (weights_.velocity + (end ? weights_.end_velocity : 0));
  const Rotation<double>& heading = plan_.headings[static_cast<std::size_t>(k) + 1];
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

template <typename T>
T TrajectoryOptimizer::inputCost(const Thrusters<T>& input) const {
  T squares(0.0), turning(0.0);
  for (int i = 0; i < input.size(); ++i) {
    squares += input(i) * input(i);
    turning += levers_(i) * input(i);
  }
  return (weights_.input * squares + weights_.turning * turning * turning) /
         (input_max_ * input_max_);
}

template <typename T, class Plan>
T TrajectoryOptimizer::tryOut(const Dynamics<T>& dynamics, Trial<T>& trial, double limit,
                              const Plan& plan) const {
  const Vector3<T> missing = missing_.cast<T>();
  trial.states[0] = start_.cast<T>();
  trial.headings[0] = Rotation<T>(trial.states[0](2));
  T cost(0.0);
  // A cost that is not a number ends it, too.
  for (std::size_t i = 0; i < trial.inputs.size() && !noneOf(cost < T(limit)); ++i) {
    const int k = static_cast<int>(i);
    auto& next = trial.states[i + 1];
    next = trial.states[i];
    trial.inputs[i] = plan(i, next);
    Rotation<T>& heading = trial.headings[i + 1];
    heading = trial.headings[i];
    const RigidState<T> before{next.template head<3>(), next.template segment<3>(3)};
    const RigidState<T> after = drivenStep(dynamics, T(t_ + k * step_), before, trial.inputs[i],
                                           lift_, missing, step_, next.data() + 6, &heading);
    next.template head<3>() = after.eta;
    next.template segment<3>(3) = after.nu;
    cost += step_ * (inputCost(trial.inputs[i]) + stateCost(k, after, heading));
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
  take(tryOut(dynamics_, tried_, kNoLimit,
              [this](std::size_t k, const State&) { return plan_.inputs[k]; }));
  return cost_;
}

Lanes TrajectoryOptimizer::costsOfEach() {
  return tryOut(dynamics_of_each_, each_, kNoLimit,
                [this](std::size_t k, const auto&) { return each_.inputs[k]; });
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

/// Derivatives of the states after up to eight steps of the plan, from `first` on, by the states
/// before them and by the inputs: a step in each lane.
template <int N, int S>
void SizedOptimizer<N, S>::linearize(int first) {
  const int inputs = thrusterCount(), lanes = std::min(steps() - first, Lanes::kCount);
  const auto stepOf = [&](int lane) {  // surplus lanes repeat the last step
    return static_cast<std::size_t>(first + std::min(lane, lanes - 1));
  };
  std::array<Lanes, kStates> state;
  Thrusters<Lanes> input = Thrusters<Lanes>::zero(inputs);
  Rotation<Lanes> heading;
  LanesJet t(0.0);
  for (int lane = 0; lane < Lanes::kCount; ++lane) {
    const std::size_t k = stepOf(lane);
    for (int i = 0; i < kStates; ++i) state[static_cast<std::size_t>(i)][lane] = plan_.states[k](i);
    for (int i = 0; i < inputs; ++i) {
      const double one = plan_.inputs[k](i);
      input(i)[lane] = std::abs(one) < least_input_(i) ? least_input_(i) : one;
    }
    heading.c[lane] = plan_.headings[k].c;
    heading.s[lane] = plan_.headings[k].s;
    t.a[lane] = t_ + static_cast<double>(k) * step_;
  }
  const Vector3<LanesJet> missing = missing_.cast<LanesJet>();
  const auto count = static_cast<int>(variables_.size());
  for (int begin = 0; begin < count; begin += LanesJet::kDirections) {
    const int end = std::min(count, begin + LanesJet::kDirections);
    std::array<LanesJet, kStates> x;
    std::copy(state.begin(), state.end(), x.begin());
    Thrusters<LanesJet> command = input.cast<LanesJet>();
    for (int i = begin; i < end; ++i) {
      const int variable = variables_[static_cast<std::size_t>(i)];
      LanesJet& one =
          variable < kStates ? x[static_cast<std::size_t>(variable)] : command(variable - kStates);
      one.v[i - begin] = 1.0;
    }
    Rotation<Lanes> turned = heading;
    const RigidState<LanesJet> before{{x[0], x[1], x[2]}, {x[3], x[4], x[5]}};
    const RigidState<LanesJet> body =
        drivenStep(derivatives_, t, before, command, lift_, missing, step_, &x[6], &turned);
    for (int i = 0; i < 3; ++i) {
      x[static_cast<std::size_t>(i)] = body.eta(i);
      x[static_cast<std::size_t>(3 + i)] = body.nu(i);
    }
    for (int lane = 0; lane < lanes; ++lane)
      for (int i = begin; i < end; ++i)
        keep(stepOf(lane), variables_[static_cast<std::size_t>(i)], [&](int j) {
          return x[static_cast<std::size_t>(j)].v[i - begin][lane];
        });
  }
  if (dynamics_.usesPose()) return;
  for (int lane = 0; lane < lanes; ++lane) {
    // The motion is invariant under translation and rotation of the pose.
    const std::size_t k = stepOf(lane);
    const Vector2<double> way = (plan_.states[k + 1] - plan_.states[k]).template head<2>();
    Linear& linear = linear_[k];
    linear.A(0, 2) = linear.transposed(2, 0) = -way.y();
    linear.A(1, 2) = linear.transposed(2, 1) = way.x();
  }
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
    addProduct(curvature, A, VA);
    Drive VB = Drive::Zero(kRows, inputs);
    addProduct(curvature, B, VB);
    Input Qu = input_curvature * input;
    Qu.noalias() += B.transpose() * gradient;
    InputSquare Quu = input_curvature;
    Quu.noalias() += B.transpose() * VB;
    Drive Qxu = Drive::Zero(kRows, inputs);
    addProduct(transposed, VB, Qxu);
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
    addProduct(transposed, gradient, Qx);
    addProduct(gain, Quu * change + Qu, Qx);
    addProduct(Qxu, change, Qx);
    gradient = Qx;
    Square Qxx = Square::Zero();
    addProduct(transposed, VA, Qxx);
    Drive half = Qxu;
    addProduct(gain, 0.5 * Quu, half);
    addProduct(half, gain.transpose(), Qxx);
    addProduct(gain, half.transpose(), Qxx);
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

/// The same in eight lanes, with parts of the last iteration's change.
template <int N, int S>
Thrusters<Lanes> SizedOptimizer<N, S>::correctedOfEach(
    std::size_t k, const Lanes& lengths,
    const Eigen::Matrix<Lanes, kStates, 1>& states) const {
  Thrusters<Lanes> inputs = Thrusters<Lanes>::zero(thrusterCount());
  for (int i = 0; i < inputs.size(); ++i) {
    Lanes wanted = plan_.inputs[k](i) + lengths * open_[k](i);
    for (int j = 0; j < S; ++j) wanted += gains_[k](j, i) * (states(j) - plan_.states[k](j));
    const Lanes low = low_(i), high = high_(i);
    inputs(i) = blend(wanted < low, low, blend(wanted > high, high, wanted));
  }
  return inputs;
}

/// Replaces the plan by the first of the eight simulated ones that costs less, if there is one.
template <int N, int S>
bool SizedOptimizer<N, S>::takeFirst(const Lanes& costs) {
  int first = 0;
  while (first < Lanes::kCount && !(costs[first] < cost_)) ++first;
  if (first == Lanes::kCount) return false;
  const auto of = [first](const Lanes& x) { return x[first]; };
  for (std::size_t k = 0; k < tried_.states.size(); ++k) {
    tried_.states[k] = each_.states[k].unaryExpr(of);
    tried_.headings[k].c = each_.headings[k].c[first];
    tried_.headings[k].s = each_.headings[k].s[first];
  }
  for (std::size_t k = 0; k < tried_.inputs.size(); ++k)
    for (int i = 0; i < thrusterCount(); ++i) tried_.inputs[k](i) = each_.inputs[k](i)[first];
  take(costs[first]);
  return true;
}

/// Makes the largest part of the last iteration's change that lowers the cost, if there is one.
template <int N, int S>
bool SizedOptimizer<N, S>::tryParts() {
  Lanes lengths = kLengths.back();
  for (std::size_t i = 0; i < kLengths.size(); ++i) lengths[static_cast<int>(i)] = kLengths[i];
  return takeFirst(tryOut(dynamics_of_each_, each_, cost_, [&](std::size_t k, const auto& states) {
    return correctedOfEach(k, lengths, states);
  }));
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
    addProduct(linear_[k].A, deviation, next);
    addProduct(linear_[k].B, after - before, next);
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
  take(tryOut(dynamics_, tried_, kNoLimit, [this](std::size_t k, const State& state) {
    return corrected(k, vectorOf(plan_.inputs[k]), state);
  }));
  const double limit = std::isfinite(cost_) ? cost_ : kNoLimit;
  // The shifted inputs are the tried ones now.
  const double open = tryOut(dynamics_, tried_, limit, [this](std::size_t k, const State&) {
    return tried_.inputs[k];
  });
  if (open < limit) take(open);
  return cost_;
}

template <int N, int S>
bool SizedOptimizer<N, S>::improve(double slight) {
  if (!is_simulated_) rollOut();
  for (int k = 0; k < steps() && !is_linear_; k += Lanes::kCount) {
    if (!timeLeft()) return false;
    linearize(k);
  }
  is_linear_ = true;
  if (backward()) {
    has_gains_ = true;
    if (damping_ == 0 && predicted_ > -slight * cost_) {
      moveLinearly();
      return true;
    }
    if (!timeLeft()) return false;
    const double cost = tryOut(dynamics_, tried_, cost_, [&](std::size_t k, const State& state) {
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
