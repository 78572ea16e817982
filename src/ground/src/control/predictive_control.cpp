#include "ground/control/predictive_control.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "ground/control/allocation.h"
#include "ground/model/measurement.h"

namespace ground {
namespace {

/// First turns of other plans, in both directions [rad]; full thrust follows.
constexpr std::array<double, 4> kTurns = {M_PI / 4, M_PI / 2, 3 * M_PI / 4, M_PI};
constexpr double kMaxOtherCost = 0.98;    // relative cost below which another plan replaces it
constexpr double kMinImprovement = 1e-3;  // relative decrease of the cost to continue iterating

}  // namespace

const Tunables<PredictiveParams>& PredictiveParams::table() {
  static const auto table =
      joined<PredictiveParams>(PlanParams::table(), PlanWeights::table(), ObserverParams::table());
  return table;
}

PredictiveControl::PredictiveControl(const Model& model, const PredictiveParams& params)
    : model_(model), turns_{turnTo(false), turnTo(true)}, seen_(model), observer_(model, params) {
  const Allocation::Output full = Allocation(model, {}).most({1, 0, 0});
  forward_ = full.inputs;
  full_thrust_ = full.wrench.x();
  wanted_ = Thrusters<double>::zero(forward_.size());
  setParams(params);
}

PredictiveControl::Turn PredictiveControl::turnTo(bool starboard) const {
  const ThrusterLayout& layout = *model_.thrusters;
  const Body<double>& body = model_.body;
  const Thrusters<double> inputs = fastestTurn(layout, starboard, body.input_max);
  return {inputs, body.l * body.k * std::abs(layout.atRest(inputs).z())};
}

void PredictiveControl::setParams(const PredictiveParams& params) {
  const std::string wrong = params.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  if (!best_.plan || params.steps != params_.steps || params.horizon != params_.horizon) {
    for (Contender* one : {&best_, &others_[0], &others_[1]}) {
      one->plan = std::make_unique<TrajectoryOptimizer>(model_, params.steps, params.horizon / params.steps);
      one->plan->setWalls(walls_);
      one->time.reset();
    }
    references_.resize(static_cast<std::size_t>(params.steps));
  }
  for (Contender* one : {&best_, &others_[0], &others_[1]}) one->plan->setWeights(params);
  observer_.setParams(params);
  params_ = params;
}

void PredictiveControl::avoid(const PlanWalls& walls) {
  walls_ = walls;
  for (Contender* one : {&best_, &others_[0], &others_[1]}) one->plan->setWalls(walls);
}

void PredictiveControl::reset() {
  observer_.reset();
  best_.time.reset();
  endSearch();
}

void PredictiveControl::commanded(double time, const Thrusters<double>& thrusters, double lift) {
  observer_.command(time, thrusters, lift);
}

void PredictiveControl::warmStart(double time) {
  if (best_.time) {
    best_.plan->warmStart(std::max(0.0, time - *best_.time));
  } else {
    std::vector<Thrusters<double>>& inputs = best_.plan->newInputs();
    std::fill(inputs.begin(), inputs.end(), Thrusters<double>(0.5 * asVector(forward_)));
    best_.plan->rollOut();
  }
  best_.time = time;
}

/// A seed's inputs in the step that begins `from` seconds after the plan.
Thrusters<double> PredictiveControl::inputsOf(const Seed& seed, double from,
                                              const TrajectoryOptimizer& plan) const {
  const double half = 0.5 * turnTime(seed.turn);
  const bool starboard = seed.turn >= 0;
  // Fraction of this step in each phase.
  const auto share = [&](double a, double b) {
    const double to = from + plan.step();
    return std::clamp((std::min(to, b) - std::max(from, a)) / plan.step(), 0.0, 1.0);
  };
  const double before = share(0, half), after = share(half, 2 * half);
  const double then = seed.thrust * share(2 * half, params_.horizon);
  Thrusters<double> inputs = forward_;
  asVector(inputs) = before * asVector(turns_[starboard ? 1 : 0].inputs) +
                     after * asVector(turns_[starboard ? 0 : 1].inputs) + then * asVector(forward_);
  return plan.clipped(inputs);
}

void PredictiveControl::follow(const Seed& seed, TrajectoryOptimizer& plan) const {
  std::vector<Thrusters<double>>& inputs = plan.newInputs();
  for (std::size_t k = 0; k < inputs.size(); ++k)
    inputs[k] = inputsOf(seed, static_cast<double>(k) * plan.step(), plan);
}

double PredictiveControl::turnTime(double angle) const {
  // To one side for the first half, to the other for the second half: a turn that ends at rest.
  if (angle == 0) return 0;
  const double moment = std::min(turns_[0].moment, turns_[1].moment);
  return 2 * std::sqrt(std::abs(angle) * model_.body.I_z / moment);
}

void PredictiveControl::makeSeeds(TrajectoryOptimizer& plan) {
  auto next = seeds_.begin();
  *next++ = {0, 0};
  *next++ = {0, 1};
  for (double turn : kTurns) {
    *next++ = {turn, 1};
    *next++ = {-turn, 1};
  }
  // Turns from the end of a coasting motion towards the end of the reference, with the thrust that
  // reaches it.
  follow(seeds_.front(), plan);
  plan.rollOut();
  const Vector2<double> way = references_.back().p - plan.states().back().head<2>();
  const double turn = wrapAngle(std::atan2(way.y(), way.x()) - start_.state.eta.z());
  const double other_way = turn > 0 ? turn - 2 * M_PI : turn + 2 * M_PI;
  for (double by : {turn, other_way}) {
    const double time = std::max(0.25 * params_.horizon, params_.horizon - turnTime(by));
    const double force = 2 * model_.body.m * way.norm() / (time * time);
    const double thrust = force < full_thrust_ ? force / full_thrust_ : 1;
    *next++ = {by, thrust};
    *next++ = {by, 0.5 * thrust};
  }
}

/// Computes the costs of the seeds; stops, with has_seeds_ false, when time is up.
void PredictiveControl::rateSeeds(TrajectoryOptimizer& plan) {
  makeSeeds(plan);
  for (std::size_t number = 0; number < kSeeds; ++number) {
    if (!budget_.left()) return;
    follow(seeds_[number], plan);
    seed_costs_[number] = plan.rollOut();
  }
  has_seeds_ = true;
}

/// Begins at the seed with the lowest cost of those that were not tried; returns whether it did.
bool PredictiveControl::beginAtSeed(TrajectoryOptimizer& plan) {
  if (!has_seeds_) rateSeeds(plan);
  if (!has_seeds_) return false;
  if (std::all_of(is_tried_.begin(), is_tried_.end(), [](bool tried) { return tried; }))
    is_tried_.fill(false);
  std::size_t best = kSeeds;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t number = 0; number < kSeeds; ++number) {
    if (is_tried_[number] || !(seed_costs_[number] < least)) continue;
    best = number;
    least = seed_costs_[number];
  }
  if (best == kSeeds || !budget_.left()) return false;
  is_tried_[best] = true;
  follow(seeds_[best], plan);
  plan.rollOut();
  return true;
}

/// Improves a plan until it hardly gets better, at most `iterations` times; returns whether more of
/// them may be of use.
bool PredictiveControl::improve(TrajectoryOptimizer& plan, int iterations) {
  const double first = plan.cost();
  for (int i = 0; i < iterations && budget_.left(); ++i) {
    ++improvements_;
    const double before = plan.cost();
    if (plan.improve() && before - plan.cost() < kMinImprovement * before) return false;
  }
  return budget_.isUp() || plan.cost() < (1 - kMinImprovement) * first;
}

void PredictiveControl::search(double time) {
  const int iterations = params_.search_iterations / static_cast<int>(others_.size());
  for (Contender& other : others_) {
    if (!budget_.left()) return;
    if (other.time) {
      other.plan->warmStart(std::max(0.0, time - *other.time));
    } else if (!beginAtSeed(*other.plan)) {
      continue;
    }
    other.time = time;
    if (!improve(*other.plan, iterations)) other.time.reset();
    if (!(other.plan->cost() < kMaxOtherCost * best_.plan->cost())) continue;
    std::swap(best_.plan, other.plan);
    other.time.reset();
  }
}

void PredictiveControl::endSearch() {
  is_tried_.fill(false);
  for (Contender& other : others_) other.time.reset();
}

Vector2<double> PredictiveControl::position(const RigidState<double>& measured) const {
  if (!seen_.distorts()) return measured.eta.head<2>();
  try {
    return stateSeenAs(seen_, {measured.eta, measured.nu}).eta.head<2>();
  } catch (const std::runtime_error&) {
    return measured.eta.head<2>();  // like the observer
  }
}

void PredictiveControl::observe(const Observation& seen) {
  observer_.countFrom(seen.drive_start);
  observer_.voltage(seen.given.volts);
  observer_.measure(seen.stamp, seen.state, seen.pose);
}

std::string PredictiveControl::objection() const {
  if (observer_.started()) return "";
  return "states have no measured pose: their publisher must fill in pose and pose_covariance";
}

Thrusters<double> PredictiveControl::decide(const Observation& seen) {
  budget_.start(params_.deadline);
  wanted_ = Thrusters<double>::zero(forward_.size());
  observe(seen);
  const double acts = seen.now + observer_.delay();
  start_ = observer_.at(acts);
  if (!observer_.started() || !seen.state.eta.allFinite() || !start_.state.eta.allFinite() ||
      !start_.state.nu.allFinite()) {
    reset();  // restarts with the next state
    return wanted_;
  }
  TrajectoryOptimizer::State state = TrajectoryOptimizer::State::Zero();
  state.head<3>() = start_.state.eta;
  state.segment<3>(3) = start_.state.nu;
  for (int i = 0; i < kMaxStates; ++i) state(6 + i) = start_.effects[static_cast<std::size_t>(i)];
  const double since = acts - seen.reference_start;
  for (std::size_t k = 0; k < references_.size(); ++k)
    references_[k] =
        seen.reference->at(std::max(0.0, since + static_cast<double>(k + 1) * best_.plan->step()));
  for (Contender* one : {&best_, &others_[0], &others_[1]})
    one->plan->setProblem(acts - seen.drive_start, state, seen.given, start_.missing, references_);

  has_seeds_ = false;
  warmStart(acts);
  improvements_ = 0;
  improve(*best_.plan, params_.iterations);
  if (best_.plan->error() < params_.lost) {
    endSearch();
  } else {
    search(acts);
  }
  if (!std::isfinite(best_.plan->cost())) {
    best_.time.reset();
    return wanted_;
  }
  wanted_ = best_.plan->wanted();
  return best_.plan->inputs().front();
}

}  // namespace ground
