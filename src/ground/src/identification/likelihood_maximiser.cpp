#include "likelihood_maximiser.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <set>
#include <stdexcept>
#include <vector>

#include "projected_step.h"

namespace ground::detail {
namespace {

constexpr double kCoarseGain = 0.1;      // least gain while the limit of distances is lowered
constexpr double kNoGain = 0.01;         // share of these below which an expected gain is not tried
constexpr double kMinShare = 0.1;        // share of the other block's gain below which one waits
constexpr double kMaxMeanThrust = 0.02;  // largest mean of the runs' relative changes of thrust
constexpr double kMaxLevelStep = 1.0;    // longest step of a level's logarithm

// Indices into DisturbanceLevels::names:
constexpr int kFirstTime = 4, kFirstTrim = 13;
constexpr int kScaledByRun[] = {0, 1, 2, 3, 8, 9, 10};  // sigma and white

/// A point of the search: the free parameters in coordinates over scale, and the rest.
struct Point {
  GreyBoxPoint at;
  Eigen::VectorXd theta;
};

/// A damped step of scoring.
struct Step {
  Point to;
  double expected;  ///< gain of the log-posterior by score and information
  double length;    ///< in standard deviations
};

/// The parameters, or the levels with the scale of each run's disturbance: each has steps of its own, because
/// their joint information is zero.
struct Block {
  bool levels, absent;
  double damping, least;  ///< current and smallest damping
  double calmer;          ///< factor on the damping after a step with the expected gain
  bool settled = absent;
  double gain = std::numeric_limits<double>::infinity();  ///< gain of the last step

  /// Whether to take a step: not while the other block gains far more.
  bool isDueBeside(const Block& other) const {
    return !settled && (other.settled || gain >= kMinShare * other.gain);
  }
};

/// A step that did not gain.
struct Failure {
  double damping, length, gain;
};

/// Damping of the next trial after failed ones, the last of which is `now`; nothing if no shorter step is
/// worth a trial. The score is not exactly the slope of the log-likelihood, because it ignores that the
/// filter's gains depend on the parameters. So close to the maximum it may promise a gain where there is
/// none, which the parabola through the present point and the last two trials shows.
std::optional<double> dampingAfter(const std::optional<Failure>& before, const Failure& now,
                                   double min_gain) {
  constexpr double kShorter = 0.7;  // largest ratio of lengths of which a parabola is made
  if (!before) return 10 * now.damping;
  if (!std::isfinite(before->gain) || now.length > kShorter * before->length)
    return (now.length > 0.9 * before->length ? 100 : 10) * now.damping;
  const double a = before->length, b = now.length;
  const double slope = (now.gain * a * a - before->gain * b * b) / (a * b * (a - b));
  const double bend = (slope * b - now.gain) / (b * b);
  if (slope <= 0 || slope * slope < 4 * bend * min_gain) return {};
  return std::max(2 * now.damping, (1 + now.damping) * 2 * bend * b / slope - 1);
}

/// Ascends to the point of largest posterior.
class Maximiser {
 public:
  Maximiser(RunFilters& filters, const LevelPrior& prior, const GreyBoxPoint& start,
            const GreyBoxOptions& options)
      : filters_(filters), options_(options), median_(logs(prior.median)), held_(levelIndices(options.held)) {
    for (int i = 0; i < kLevels; ++i) precision_(i) = std::pow(prior.deviation[i], -2);
    if (!options.free.empty()) free_ = makeFree(start.model, options.free);
    const auto n = static_cast<Eigen::Index>(free_.index.size());
    const Eigen::Map<const Eigen::VectorXd> scale(free_.scale.data(), n);
    lower_ = Eigen::Map<const Eigen::VectorXd>(free_.lower.data(), n).cwiseQuotient(scale);
    upper_ = Eigen::Map<const Eigen::VectorXd>(free_.upper.data(), n).cwiseQuotient(scale);
    point_ = {start, Eigen::Map<const Eigen::VectorXd>(startOf(free_).data(), n)};
    if (point_.at.log_scales.empty()) point_.at.log_scales.assign(filters.filters().size(), 0.0);
  }

  GreyBoxFit run() {
    if (!options_.warm) {
      // With free trims from the start, differences between runs would replace the parameters.
      const std::set<int> held = held_;
      for (int i = kFirstTrim; i < kLevels; ++i) held_.insert(i);
      climb(std::numeric_limits<double>::infinity(), kCoarseGain);
      climb(200, kCoarseGain);
      held_ = held;
    }
    climb(options_.cap, options_.least_gain);
    centreThrust();
    return result();
  }

 private:
  double value(const Point& point, double cap) {
    const LevelVector away = logs(point.at.levels) - median_;
    const Eigen::VectorXd shift = point.theta - free_.expected;
    double penalty = away.dot(precision_.cwiseProduct(away)) + shift.dot(free_.prior * shift);
    for (const double scale : point.at.log_scales) penalty += std::pow(scale / kScaleDeviation, 2);
    return filters_.evaluate(point.at, cap) - 0.5 * penalty;
  }

  /// Derivatives by the parameters at the current point.
  void deriveParameters() {
    RunScores found = filters_.scores(point_.at, free_);
    score_ = found.score.colwise().sum().transpose() - free_.prior * (point_.theta - free_.expected);
    information_ = found.information;
    by_acceleration_ = found.by_acceleration;
    // Parameters do not move along directions that are not identifiable.
    const Eigen::MatrixXd null_space = identifiableBy(by_acceleration_).null_space;
    if (null_space.cols() == 0) return;
    score_ -= null_space * (null_space.transpose() * score_);
    const Eigen::MatrixXd across = information_ * null_space * null_space.transpose();
    information_ += null_space * (null_space.transpose() * across) - across - across.transpose();
  }

  Step stepParameters(double damping) const {
    Eigen::MatrixXd damped = information_;
    damped.diagonal() = (1 + damping) * damped.diagonal().array() + 1e-9 + 1e-6 * damping;
    const Eigen::VectorXd step = projectedStep(damped, -score_, lower_ - point_.theta, upper_ - point_.theta);
    // where all poses count as outliers, nothing holds the filter, and derivatives grow without bound
    if (!step.allFinite()) throw std::runtime_error("the derivatives of the likelihood are not finite");
    Step result = stepBy(step, score_, information_);
    result.to.theta += step;
    result.to.at.model = modelAt(point_.at.model, free_, result.to.theta.data());
    return result;
  }

  /// Derivatives by the levels, then by the scale of each run. The latter are sums of
  /// derivatives by the run's levels.
  void deriveLevels() {
    const auto found = filters_.levelScores(point_.at, held_);
    const auto runs = static_cast<Eigen::Index>(found.size());
    level_score_ = Eigen::VectorXd::Zero(kLevels + runs);
    level_information_ = Eigen::MatrixXd::Zero(kLevels + runs, kLevels + runs);
    level_score_.head<kLevels>() = -precision_.cwiseProduct(logs(point_.at.levels) - median_);
    level_information_.diagonal().head<kLevels>() = precision_;
    constexpr double kPrecision = 1 / (kScaleDeviation * kScaleDeviation);
    for (Eigen::Index i = 0; i < runs; ++i) {
      const RunLevelScores& run = found[static_cast<std::size_t>(i)];
      level_score_.head<kLevels>() += run.score;
      level_information_.topLeftCorner<kLevels, kLevels>() += run.information;
      double slope = -kPrecision * point_.at.log_scales[static_cast<std::size_t>(i)], bend = kPrecision;
      Eigen::VectorXd across = Eigen::VectorXd::Zero(kLevels);
      for (const int a : kScaledByRun) {
        slope += run.score(a);
        across += run.information.col(a);
      }
      for (const int a : kScaledByRun) bend += across(a);
      level_score_(kLevels + i) = slope;
      level_information_(kLevels + i, kLevels + i) = bend;
      level_information_.block(0, kLevels + i, kLevels, 1) = across;
      level_information_.block(kLevels + i, 0, 1, kLevels) = across.transpose();
    }
    for (const int i : held_) {
      level_score_(i) = 0;
      level_information_.row(i).setZero();
      level_information_.col(i).setZero();
      level_information_(i, i) = 1;
    }
  }

  Step stepLevels(double damping) const {
    Eigen::MatrixXd damped = level_information_;
    damped.diagonal() *= 1 + damping;
    Eigen::VectorXd step = damped.ldlt().solve(level_score_);
    Step result = stepBy(step, level_score_, level_information_);
    for (Eigen::Index i = 0; i < step.size(); ++i) {
      // A scoring step of the logarithm changes the variance by the factor 1 + 2 step.
      if (i < kFirstTime || i >= kFirstTime + 4) step(i) = 0.5 * std::log(std::max(1e-3, 1 + 2 * step(i)));
      step(i) = std::clamp(step(i), -kMaxLevelStep, kMaxLevelStep);
    }
    result.to.at.levels = fromLogs(logs(point_.at.levels) + step.head<kLevels>());
    for (std::size_t r = 0; r < result.to.at.log_scales.size(); ++r)
      result.to.at.log_scales[r] += step(kLevels + static_cast<Eigen::Index>(r));
    return result;
  }

  Step stepBy(const Eigen::VectorXd& step, const Eigen::VectorXd& score,
              const Eigen::MatrixXd& information) const {
    const double square = step.dot(information * step);
    return {point_, score.dot(step) - 0.5 * square, std::sqrt(std::max(0.0, square))};
  }

  /// Moves the mean of the runs' relative changes of thrust into the parameter k. The likelihood is nearly
  /// flat along this direction, so that scoring steps would be small.
  void centreThrust() {
    const auto k = std::find(options_.free.begin(), options_.free.end(), "k");
    if (k == options_.free.end() || !options_.levels || held_.count(kLevels - 1)) return;
    double mean = 0, square = 0;
    const double count = static_cast<double>(filters_.filters().size());
    for (const DisturbanceFilter& filter : filters_.filters()) {
      mean += filter.constants()(3) / count;
      square += std::pow(filter.constants()(3), 2) / count;
    }
    if (std::abs(mean) < kMaxMeanThrust) return;
    const Point before = point_;
    const double best = best_;
    point_.theta(k - options_.free.begin()) *= 1 + mean;
    point_.at.model = modelAt(point_.at.model, free_, point_.theta.data());
    point_.at.levels.thrust = std::max(1e-3, std::sqrt(std::max(0.0, square - mean * mean)));
    climb(options_.cap, options_.least_gain);
    if (best_ <= best) point_ = before;
    climb(options_.cap, options_.least_gain);
  }

  /// Ascends by alternating steps of parameters and levels. Each has its own damping: far from the maximum,
  /// steps of the levels overshoot more. The one that gains far more than the other takes several steps in
  /// turn.
  void climb(double cap, double min_gain) {
    cap_ = cap;
    min_gain_ = min_gain;
    best_ = requireFinite(value(point_, cap_));
    // Damped, because slow and white wrench substitute for each other and steps would oscillate.
    Block parameters{false, options_.free.empty(), 1e-3, 1e-6, 0.1};
    Block levels{true, !options_.levels, 0.5, 1e-3, 0.5};
    int i = 0;
    for (; i < options_.max_iterations && !(parameters.settled && levels.settled); ++i) {
      if (parameters.isDueBeside(levels)) ascend(parameters, levels);
      if (levels.isDueBeside(parameters)) ascend(levels, parameters);
    }
    iterations_ += i;
    converged_ = parameters.settled && levels.settled;
  }

  /// One step uphill of a block.
  void ascend(Block& block, Block& other) {
    if (block.levels)
      deriveLevels();
    else
      deriveParameters();
    std::optional<Failure> before;
    for (int trial = 0; trial < 8; ++trial) {
      const Step step = block.levels ? stepLevels(block.damping) : stepParameters(block.damping);
      block.settled = trial == 0 && step.expected < kNoGain * min_gain_;
      if (block.settled) return;
      const double found = value(step.to, cap_), gain = found - best_;
      if (std::isfinite(found) && gain > -1e-9) {
        point_ = step.to;
        best_ = found;
        block.gain = gain;
        block.settled = gain < min_gain_ && step.expected < 2 * min_gain_;
        if (gain > min_gain_) other.settled = other.absent;
        const double trust = gain / step.expected;
        const double factor = trust > 0.5 ? block.calmer : trust < 0.25 ? 4 : 1;
        block.damping = std::max(block.least, block.damping * factor);
        return;
      }
      if (step.expected < min_gain_) break;
      const Failure now{block.damping, step.length, gain};
      const std::optional<double> damping = dampingAfter(before, now, min_gain_);
      if (!damping) break;
      block.damping = *damping;
      before = now;
    }
    block.settled = true;
    value(point_, cap_);  // sets the filters back to point_ for the next derivatives
  }

  GreyBoxFit result() {
    GreyBoxFit fit;
    fit.point = point_.at;
    fit.by_run = filters_.byRun();
    fit.log_likelihood = std::accumulate(fit.by_run.begin(), fit.by_run.end(), 0.0);
    fit.log_posterior = best_;
    for (const DisturbanceFilter& filter : filters_.filters()) {
      const Eigen::Vector4d mean = filter.constants(), &sigma = filter.constantsSigma();
      fit.trims.push_back({mean.head<3>(), sigma.head<3>(), mean(3), sigma(3)});
    }
    const Eigen::VectorXd& theta = point_.theta;
    if (theta.size() > 0) {
      if (by_acceleration_.size() == 0) deriveParameters();  // after no step
      const double normal = quantileOf(std::numeric_limits<double>::infinity());
      fit.parameters = estimatesOf(fit.point.model, free_, {theta.data(), theta.data() + theta.size()},
                                   deviationsOf(identifiableBy(by_acceleration_)),
                                   Eigen::VectorXd::Constant(theta.size(), normal));
    }
    fit.information = by_acceleration_;
    fit.scale = free_.scale;
    fit.level_information = level_information_;
    fit.iterations = iterations_;
    fit.converged = converged_;
    return fit;
  }

  RunFilters& filters_;
  const GreyBoxOptions& options_;
  LevelVector median_, precision_;  ///< of the prior of the levels
  std::set<int> held_;              ///< levels that do not change
  Free free_;
  Eigen::VectorXd lower_, upper_;
  Point point_;
  Eigen::VectorXd score_, level_score_;
  Eigen::MatrixXd information_, by_acceleration_, level_information_;
  int iterations_ = 0;
  // Each climb sets these:
  double cap_ = 0, min_gain_ = 0, best_ = 0;
  bool converged_ = false;
};

}  // namespace

Eigen::VectorXd deviationsOf(const Identifiable& known) {
  constexpr double kMaxDeviation = 30;  // of an identified parameter, relative to its typical size
  Eigen::VectorXd found = known.variance().cwiseSqrt();
  for (Eigen::Index i = 0; i < found.size(); ++i)
    if (!known.parameter[static_cast<std::size_t>(i)] || !(found(i) < kMaxDeviation))
      found(i) = std::numeric_limits<double>::infinity();
  return found;
}

GreyBoxFit maximiseLikelihood(RunFilters& filters, const LevelPrior& prior, const GreyBoxPoint& start,
                              const GreyBoxOptions& options) {
  return Maximiser(filters, prior, start, options).run();
}

}  // namespace ground::detail
