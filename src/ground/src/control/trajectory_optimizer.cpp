#include "ground/control/trajectory_optimizer.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace ground {
namespace {

constexpr double kMinDamping = 1e-9, kMaxDamping = 1e3;
constexpr std::array<double, 4> kLengths = {1.0, 0.5, 0.2, 0.05};

/// The minimum of g' d + d' H d / 2 for low <= d <= high with positive definite H. Sets which
/// elements are not at a bound in `free`.
Vector2<double> boxMinimum(const Eigen::Matrix2d& H, const Vector2<double>& g,
                           const Vector2<double>& low, const Vector2<double>& high,
                           std::array<bool, 2>& free) {
  const auto inside = [&](double x, int i) { return std::clamp(x, low(i), high(i)); };
  const double determinant = H.determinant();
  const Vector2<double> whole((H(0, 1) * g(1) - H(1, 1) * g(0)) / determinant,
                              (H(0, 1) * g(0) - H(0, 0) * g(1)) / determinant);
  free = {true, true};
  if ((whole.array() >= low.array()).all() && (whole.array() <= high.array()).all()) return whole;
  // The minimum lies on an edge; along each edge the function is a parabola.
  Vector2<double> best = Vector2<double>::Zero();
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 2; ++i) {
    const int j = 1 - i;
    for (double bound : {low(i), high(i)}) {
      Vector2<double> d;
      d(i) = bound;
      const double wanted = -(g(j) + H(i, j) * bound) / H(j, j);
      d(j) = inside(wanted, j);
      const double value = g.dot(d) + 0.5 * d.dot(H * d);
      if (value < least) {
        least = value;
        best = d;
        free[static_cast<std::size_t>(i)] = false;
        free[static_cast<std::size_t>(j)] = d(j) == wanted;
      }
    }
  }
  return best;
}

}  // namespace

const Tunables<PlanWeights>& PlanWeights::table() {
  using W = PlanWeights;
  static const Tunables<W> table = {
      {{"velocity", "s^2", "Weight of the velocity error", 0, 100, {1, -4, 1}}, &W::velocity},
      {{"input", "m^2", "Weight of the inputs, of full scale", 0, 100, {1, -7, -1}}, &W::input},
      {{"turning", "m^2", "Weight of their difference, of full scale", 0, 100, {1, -7, -1}},
       &W::turning},
      {{"end_position", "-", "Weight of the position error at the end", 0, 1e4, {1, -2, 3}},
       &W::end_position},
      {{"end_velocity", "s^2", "Weight of the velocity error at the end", 0, 1e4, {1, -2, 3}},
       &W::end_velocity},
  };
  return table;
}

TrajectoryOptimizer::TrajectoryOptimizer(const Model& model, int steps, double step)
    : dynamics_(model),
      derivatives_(model),
      effect_states_(model.stateCount()),
      input_max_(model.body.input_max),
      step_(step) {
  if (effect_states_ > kMaxStates)
    throw std::invalid_argument("a model whose effects have more than " +
                                std::to_string(kMaxStates) +
                                " states cannot be planned with");
  if (steps < 1 || steps > kMaxSteps || !(step > 0))
    throw std::invalid_argument("the horizon needs between 1 and 200 steps of positive length");
  const auto count = static_cast<std::size_t>(steps);
  inputs_.assign(count, Vector2<double>::Zero());
  tried_inputs_ = open_ = inputs_;
  states_.assign(count + 1, State::Zero());
  tried_states_ = states_;
  references_.resize(count);
  unbounded_.setConstant(std::numeric_limits<double>::quiet_NaN());
  linear_.assign(count, {Square::Identity(), Drive::Zero()});
  gains_.assign(count, Gain::Zero());
}

void TrajectoryOptimizer::setProblem(double t, const State& start, double lift,
                                     const Vector3<double>& missing,
                                     const std::vector<ReferencePoint>& references) {
  t_ = t;
  lift_ = lift;
  missing_ = missing;
  unbounded_.setConstant(std::numeric_limits<double>::quiet_NaN());
  states_[0] = tried_states_[0] = start;
  std::copy(references.begin(), references.end(), references_.begin());
}

TrajectoryOptimizer::State TrajectoryOptimizer::advance(int k, const State& state,
                                                        const Vector2<double>& input) const {
  State next = state;
  const StepInputs<double> acting = dynamics_.actuate(input, lift_, step_, next.data() + 6);
  const RigidState<double> before{state.head<3>(), state.segment<3>(3)};
  const RigidState<double> body =
      pushedStep(dynamics_, t_ + k * step_, before, acting, missing_, step_);
  next.head<3>() = body.eta;
  next.segment<3>(3) = body.nu;
  return next;
}

void TrajectoryOptimizer::linearize(int k) {
  const State& state = states_[static_cast<std::size_t>(k)];
  const State& after = states_[static_cast<std::size_t>(k) + 1];
  const Vector2<double>& input = inputs_[static_cast<std::size_t>(k)];
  Linear& linear = linear_[static_cast<std::size_t>(k)];
  // Variables of the derivatives: indices of states, then of inputs.
  std::array<int, kStates + 2> by{};
  int count = 0;
  for (int i = 3; i < 6 + effect_states_; ++i) by[static_cast<std::size_t>(count++)] = i;
  for (int i = 0; i < 2; ++i) by[static_cast<std::size_t>(count++)] = kStates + i;
  if (dynamics_.usesPose()) {
    for (int i = 0; i < 3; ++i) by[static_cast<std::size_t>(count++)] = i;
  } else {
    // The motion is invariant under translation and rotation of the pose.
    linear.A.leftCols<3>().setZero();
    linear.A.topLeftCorner<3, 3>().setIdentity();
    linear.A(0, 2) = -(after(1) - state(1));
    linear.A(1, 2) = after(0) - state(0);
  }
  constexpr int kAtOnce = Jet::kDirections;
  for (int first = 0; first < count; first += kAtOnce) {
    const int last = std::min(count, first + kAtOnce);
    std::array<Jet, kStates + 2> x;
    for (int i = 0; i < kStates; ++i) x[static_cast<std::size_t>(i)] = Jet(state(i));
    for (int i = 0; i < 2; ++i) x[static_cast<std::size_t>(kStates + i)] = Jet(input(i));
    for (int i = first; i < last; ++i)
      x[static_cast<std::size_t>(by[static_cast<std::size_t>(i)])].v[i - first] = 1;
    const StepInputs<Jet> acting =
        derivatives_.actuate({x[kStates], x[kStates + 1]}, lift_, Jet(step_), &x[6]);
    const RigidState<Jet> before{{x[0], x[1], x[2]}, {x[3], x[4], x[5]}};
    const Vector3<Jet> missing = missing_.cast<Jet>();
    const RigidState<Jet> body =
        pushedStep(derivatives_, Jet(t_ + k * step_), before, acting, missing, step_);
    for (int i = first; i < last; ++i) {
      const int column = by[static_cast<std::size_t>(i)];
      State derivative = State::Zero();
      for (int j = 0; j < 3; ++j) {
        derivative(j) = body.eta(j).v[i - first];
        derivative(3 + j) = body.nu(j).v[i - first];
      }
      for (int j = 0; j < effect_states_; ++j)
        derivative(6 + j) = x[static_cast<std::size_t>(6 + j)].v[i - first];
      if (column < kStates) {
        linear.A.col(column) = derivative;
      } else {
        linear.B.col(column - kStates) = derivative;
      }
    }
  }
}

double TrajectoryOptimizer::stateCost(int k, const State& state) const {
  const ReferencePoint& reference = references_[static_cast<std::size_t>(k)];
  const bool end = k + 1 == steps();
  const double position = end ? 1 + weights_.end_position : 1;
  const double velocity = weights_.velocity + (end ? weights_.end_velocity : 0);
  const Vector2<double> over_floor = bodyToWorld<double>(state(2), {state(3), state(4)});
  double cost = position * (state.head<2>() - reference.p).squaredNorm() +
                velocity * (over_floor - reference.p_dot).squaredNorm();
  if (walls_) {
    Eigen::Matrix<double, 1, 5> unused;
    const double excess =
        walls_->fence.excess({state.head<3>(), state.segment<3>(3)}, walls_->age, unused);
    cost += walls_->weight * excess * excess;
  }
  return cost;
}

double TrajectoryOptimizer::inputCost(const Vector2<double>& input) const {
  const Vector2<double> share = input / input_max_;
  const double difference = share(0) - share(1);
  return weights_.input * share.squaredNorm() + weights_.turning * difference * difference;
}

double TrajectoryOptimizer::rollOut() {
  cost_ = 0;
  for (int k = 0; k < steps(); ++k) {
    const auto i = static_cast<std::size_t>(k);
    states_[i + 1] = advance(k, states_[i], inputs_[i]);
    cost_ += step_ * (inputCost(inputs_[i]) + stateCost(k, states_[i + 1]));
  }
  return cost_;
}

double TrajectoryOptimizer::error() const {
  double sum = 0;
  for (std::size_t k = 0; k < references_.size(); ++k)
    sum += (states_[k + 1].head<2>() - references_[k].p).squaredNorm();
  return std::sqrt(sum / steps());
}

Vector2<double> TrajectoryOptimizer::wanted() const {
  Vector2<double> wanted = inputs_.front();
  for (int i = 0; i < 2; ++i) {
    if (wanted(i) <= 0 && unbounded_(i) < 0) wanted(i) = unbounded_(i);
    if (wanted(i) >= input_max_ && unbounded_(i) > input_max_) wanted(i) = unbounded_(i);
  }
  return wanted;
}

/// Adds the derivatives of the cost of the state at the end of step k.
void TrajectoryOptimizer::addStateCost(int k, State& gradient, Square& curvature) const {
  const State& state = states_[static_cast<std::size_t>(k) + 1];
  const ReferencePoint& reference = references_[static_cast<std::size_t>(k)];
  const bool end = k + 1 == steps();
  const double position = 2 * step_ * (end ? 1 + weights_.end_position : 1);
  const double velocity = 2 * step_ * (weights_.velocity + (end ? weights_.end_velocity : 0));
  const Rotation<double> heading(state(2));
  const Vector2<double> over_floor = heading.toWorld({state(3), state(4)});
  const Vector2<double> slip = over_floor - reference.p_dot;
  gradient.head<2>() += position * (state.head<2>() - reference.p);
  curvature(0, 0) += position;
  curvature(1, 1) += position;
  Eigen::Matrix<double, 2, 3> by;  // velocity over the floor by psi, u, v
  by << -over_floor.y(), heading.c, -heading.s, over_floor.x(), heading.s, heading.c;
  gradient.segment<3>(2).noalias() += velocity * by.transpose() * slip;
  curvature.block<3, 3>(2, 2).noalias() += velocity * by.transpose() * by;
}

void TrajectoryOptimizer::addWallCost(const State& state, State& gradient,
                                      Square& curvature) const {
  Eigen::Matrix<double, 1, 5> derivative;
  const double excess =
      walls_->fence.excess({state.head<3>(), state.segment<3>(3)}, walls_->age, derivative);
  if (!(excess > 0)) return;
  const double weight = 2 * step_ * walls_->weight;
  gradient.head<5>() += weight * excess * derivative.transpose();
  curvature.topLeftCorner<5, 5>().noalias() += weight * derivative.transpose() * derivative;
}

/// Feedback gain of the inputs that are not at a bound.
TrajectoryOptimizer::Gain TrajectoryOptimizer::feedback(const Eigen::Matrix2d& damped,
                                                        const Gain& Qux,
                                                        const std::array<bool, 2>& free) {
  Gain gain = Gain::Zero();
  if (free[0] && free[1]) {
    gain.noalias() = -damped.inverse() * Qux;
  } else if (free[0]) {
    gain.row(0) = -Qux.row(0) / damped(0, 0);
  } else if (free[1]) {
    gain.row(1) = -Qux.row(1) / damped(1, 1);
  }
  return gain;
}

bool TrajectoryOptimizer::backward() {
  const double scale = 1 / (input_max_ * input_max_);
  State gradient = State::Zero();
  Square curvature = Square::Zero();
  Eigen::Matrix2d input_curvature;
  input_curvature << weights_.input + weights_.turning, -weights_.turning, -weights_.turning,
      weights_.input + weights_.turning;
  input_curvature *= 2 * step_ * scale;
  for (int k = steps() - 1; k >= 0; --k) {
    const auto i = static_cast<std::size_t>(k);
    addStateCost(k, gradient, curvature);
    if (walls_) addWallCost(states_[i + 1], gradient, curvature);

    const Square& A = linear_[i].A;
    const Drive& B = linear_[i].B;
    const Vector2<double>& input = inputs_[i];
    Square VA;
    VA.noalias() = curvature * A;
    Drive VB;
    VB.noalias() = curvature * B;
    Vector2<double> Qu = input_curvature * input;
    Qu.noalias() += B.transpose() * gradient;
    Eigen::Matrix2d Quu = input_curvature;
    Quu.noalias() += B.transpose() * VB;
    Gain Qux;
    Qux.noalias() = VB.transpose() * A;
    Eigen::Matrix2d damped = Quu;
    damped.diagonal().array() += damping_ * scale;
    if (!(damped.determinant() > 0) || !(damped(0, 0) > 0)) return false;
    std::array<bool, 2> free{};
    const Vector2<double> change =
        boxMinimum(damped, Qu, -input, Vector2<double>::Constant(input_max_) - input, free);
    if (k == 0) unbounded_ = input - damped.inverse() * Qu;
    const Gain gain = feedback(damped, Qux, free);
    open_[i] = change;
    gains_[i] = gain;
    State Qx;
    Qx.noalias() = A.transpose() * gradient;
    Square Qxx;
    Qxx.noalias() = A.transpose() * VA;
    gradient = Qx;
    gradient.noalias() += gain.transpose() * (Quu * change + Qu);
    gradient.noalias() += Qux.transpose() * change;
    const Gain half = 0.5 * Quu * gain + Qux;
    Square cross;
    cross.noalias() = gain.transpose() * half;
    curvature = Qxx + cross + cross.transpose();
  }
  return true;
}

bool TrajectoryOptimizer::improve() {
  for (int k = 0; k < steps(); ++k) linearize(k);
  if (!backward()) {
    damping_ = std::min(kMaxDamping, std::max(kMinDamping, 10 * damping_));
    return false;
  }
  for (double length : kLengths) {
    double cost = 0;
    for (int k = 0; k < steps() && cost < cost_; ++k) {
      const auto i = static_cast<std::size_t>(k);
      Vector2<double> input = inputs_[i] + length * open_[i];
      input.noalias() += gains_[i] * (tried_states_[i] - states_[i]);
      tried_inputs_[i] = input.cwiseMax(0.0).cwiseMin(input_max_);
      tried_states_[i + 1] = advance(k, tried_states_[i], tried_inputs_[i]);
      cost += step_ * (inputCost(tried_inputs_[i]) + stateCost(k, tried_states_[i + 1]));
    }
    if (cost < cost_) {
      cost_ = cost;
      std::swap(inputs_, tried_inputs_);
      std::swap(states_, tried_states_);
      damping_ = length == 1 ? damping_ / 5 : damping_;
      if (damping_ < kMinDamping) damping_ = 0;
      return true;
    }
  }
  damping_ = std::min(kMaxDamping, std::max(kMinDamping, 10 * damping_));
  return false;
}

}  // namespace ground
