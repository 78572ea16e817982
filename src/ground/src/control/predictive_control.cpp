#include "ground/control/predictive_control.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace ground {
namespace {

/// Turns that other plans begin with, in quarters of a turn, either way.
constexpr std::array<double, 4> kTurns = {0.5, 1.0, 1.5, 2.0};
constexpr int kSeeds = 2 * static_cast<int>(kTurns.size()) + 2;
constexpr double kClearlyBetter = 0.98;  // of the cost, to give up a plan for another
constexpr double kSettled = 1e-4;        // share of the cost that an improvement has to bring

}  // namespace

std::string PredictiveParams::validate() const {
  const auto within = [](double x, double low, double high) { return x >= low && x <= high; };
  if (!within(horizon, 0.1, 10)) return "horizon must be between 0.1 and 10 s";
  if (steps < 2 || steps > TrajectoryOptimizer::kMostSteps)
    return "steps must be between 2 and 200";
  if (iterations < 1 || iterations > 50) return "iterations must be between 1 and 50";
  if (search_iterations < 0 || search_iterations > 100)
    return "search_iterations must be between 0 and 100";
  if (!(lost > 0)) return "lost must be positive";
  return "";
}

PredictiveControl::PredictiveControl(const Model& model, const PredictiveParams& params)
    : model_(model), input_max_(model.body.input_max), observer_(model, params.observer) {
  setParams(params);
  // Half the way one thruster alone, half the way the other: a turn that ends at rest.
  const Body<double>& body = model.body;
  quarter_turn_ = 2 * std::sqrt(M_PI / 2 * body.I_z / (body.l * body.k * body.input_max));
}

void PredictiveControl::setParams(const PredictiveParams& params) {
  const std::string wrong = params.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  if (!plan_ || params.steps != params_.steps || params.horizon != params_.horizon) {
    const double step = params.horizon / params.steps;
    plan_ = std::make_unique<TrajectoryOptimizer>(model_, params.steps, step);
    other_ = std::make_unique<TrajectoryOptimizer>(model_, params.steps, step);
    references_.resize(static_cast<std::size_t>(params.steps));
    has_plan_ = false;
  }
  plan_->setWeights(params.weights);
  other_->setWeights(params.weights);
  observer_.setParams(params.observer);
  params_ = params;
}

void PredictiveControl::reset() {
  observer_.reset();
  has_plan_ = false;
}

void PredictiveControl::commanded(double time, const Vector2<double>& thrusters, double lift) {
  observer_.command(time, thrusters, lift);
}

void PredictiveControl::carryOn(double time) {
  std::vector<Vector2<double>>& inputs = plan_->inputs();
  if (!has_plan_) {
    std::fill(inputs.begin(), inputs.end(), Vector2<double>::Constant(0.5 * input_max_));
  } else {
    // Each step gets the mean of what was planned for its time.
    const double shift = std::max(0.0, time - plan_time_) / plan_->step();
    const double whole = std::floor(shift), part = shift - whole;
    const std::size_t last = inputs.size() - 1;
    const auto at = [&](std::size_t k) {
      return inputs[std::min(last, k + static_cast<std::size_t>(std::min(whole, 1e6)))];
    };
    for (std::size_t k = 0; k <= last; ++k)
      inputs[k] = (1 - part) * at(k) + part * at(std::min(last, k + 1));
  }
  has_plan_ = true;
  plan_time_ = time;
}

void PredictiveControl::seed(int number) {
  std::vector<Vector2<double>>& inputs = other_->inputs();
  const double step = other_->step();
  if (number >= kSeeds - 2) {
    std::fill(inputs.begin(), inputs.end(),
              Vector2<double>::Constant(number == kSeeds - 1 ? 0.0 : input_max_));
    return;
  }
  const int side = number % 2;
  const double half =
      0.5 * quarter_turn_ * std::sqrt(kTurns[static_cast<std::size_t>(number / 2)]);
  for (std::size_t k = 0; k < inputs.size(); ++k) {
    // How much of this step is spent on each phase.
    const double from = static_cast<double>(k) * step;
    const auto share = [&](double a, double b) {
      return std::clamp((std::min(from + step, b) - std::max(from, a)) / step, 0.0, 1.0);
    };
    const double then = share(2 * half, 1e9);
    inputs[k](side) = input_max_ * (share(0, half) + then);
    inputs[k](1 - side) = input_max_ * (share(half, 2 * half) + then);
  }
}

void PredictiveControl::search() {
  int best = -1;
  double least = 0;
  for (int number = 0; number < kSeeds; ++number) {
    seed(number);
    const double cost = other_->rollOut();
    if (std::isfinite(cost) && (best < 0 || cost < least)) {
      best = number;
      least = cost;
    }
  }
  if (best < 0) return;
  // The most promising one and, in turn, one of the rest.
  next_seed_ = (next_seed_ + 1) % kSeeds;
  int left = params_.search_iterations;
  for (int number : {best, next_seed_}) {
    seed(number);
    other_->rollOut();
    for (int i = 0; i < params_.search_iterations / 2 && left > 0; ++i, --left) {
      ++improvements_;
      const double before = other_->cost();
      if (other_->improve() && before - other_->cost() < kSettled * before) break;
    }
    if (other_->cost() < kClearlyBetter * plan_->cost()) std::swap(plan_, other_);
  }
}

Vector2<double> PredictiveControl::decide(const Observation& seen) {
  observer_.measure(seen.stamp, seen.state);
  const double acts = seen.now + observer_.delay();
  start_ = observer_.at(acts);
  if (!start_.state.eta.allFinite() || !start_.state.nu.allFinite()) {
    reset();  // nothing to go by: no thrust, and a new beginning with the next state
    return Vector2<double>::Zero();
  }
  TrajectoryOptimizer::State state = TrajectoryOptimizer::State::Zero();
  state.head<3>() = start_.state.eta;
  state.segment<3>(3) = start_.state.nu;
  for (int i = 0; i < DisturbanceObserver::kActuators; ++i)
    state(6 + i) = start_.actuators[static_cast<std::size_t>(i)];
  const double since = acts - seen.reference_start;
  for (std::size_t k = 0; k < references_.size(); ++k)
    references_[k] = seen.reference->at(
        std::max(0.0, since + static_cast<double>(k + 1) * plan_->step()));
  for (TrajectoryOptimizer* plan : {plan_.get(), other_.get()})
    plan->setProblem(acts - observer_.start(), state, seen.lift, start_.missing, references_);

  carryOn(acts);
  plan_->rollOut();
  improvements_ = 0;
  for (int i = 0; i < params_.iterations; ++i) {
    ++improvements_;
    const double before = plan_->cost();
    if (plan_->improve() && before - plan_->cost() < kSettled * before) break;
  }
  if (!(plan_->error() < params_.lost)) search();
  if (!std::isfinite(plan_->cost())) {
    has_plan_ = false;
    return Vector2<double>::Zero();
  }
  return plan_->inputs().front();
}

}  // namespace ground
