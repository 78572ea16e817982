#include "ascent.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <set>
#include <stdexcept>

#include "dense_algebra.h"
#include "information.h"

namespace ground::detail {
namespace {

constexpr double kMinGain = 0.01;        // gain of the log-posterior below which the search ends
constexpr double kCoarseGain = 0.1;      // the same while the limit of distances is lowered
constexpr double kNoGain = 0.01;         // share of these below which an expected gain is not tried
constexpr double kMinShare = 0.1;        // share of the other ascent's gain below which one waits
constexpr double kMaxMeanThrust = 0.02;  // largest mean of the runs' relative changes of thrust
constexpr double kMaxLevelStep = 1.0;    // longest step of a level's logarithm

// Indices into DisturbanceLevels::names:
constexpr int kFirstTime = 4, kFirstTrim = 13;
constexpr int kScaledByLoudness[] = {0, 1, 2, 3, 8, 9, 10};  // sigma and white

/// The prior of levels and loudness.
struct Prior {
  LevelVector median, precision;

  explicit Prior(const LevelPrior& prior) {
    median = logs(prior.median);
    for (int i = 0; i < kLevels; ++i) precision(i) = std::pow(prior.deviation[i], -2);
  }
  double operator()(const GreyBoxPoint& point) const {
    const LevelVector away = logs(point.levels) - median;
    double value = -0.5 * away.dot(precision.cwiseProduct(away));
    for (const double loud : point.loudness) value -= 0.5 * std::pow(loud / kLoudness, 2);
    return value;
  }
};

/// A step of damped scoring within bounds. Parameters at a bound do not step outwards.
Eigen::VectorXd boundedStep(const Eigen::MatrixXd& information, const Eigen::VectorXd& score, double damping,
                            const Free& free, const std::vector<double>& scaled) {
  const auto n = score.size();
  Eigen::VectorXd step = Eigen::VectorXd::Zero(n);
  std::vector<bool> held(static_cast<std::size_t>(n), false);
  for (int round = 0; round < 4; ++round) {
    std::vector<Eigen::Index> moving;
    for (Eigen::Index i = 0; i < n; ++i)
      if (!held[i]) moving.push_back(i);
    const auto m = static_cast<Eigen::Index>(moving.size());
    if (m == 0) return step;
    Eigen::MatrixXd A(m, m);
    Eigen::VectorXd b(m);
    for (Eigen::Index i = 0; i < m; ++i) {
      b(i) = score(moving[i]);
      for (Eigen::Index j = 0; j < m; ++j) A(i, j) = information(moving[i], moving[j]);
    }
    A.diagonal() += damping * A.diagonal() + Eigen::VectorXd::Constant(m, 1e-9 + 1e-6 * damping);
    const Eigen::VectorXd found = solveSymmetric(A, b);
    bool changed = false;
    for (Eigen::Index i = 0; i < m; ++i) {
      const auto at = static_cast<std::size_t>(moving[i]);
      const double low = free.lower[at] / free.scale[at], high = free.upper[at] / free.scale[at];
      const double to = scaled[at] + found(i);
      step(moving[i]) = std::clamp(to, low, high) - scaled[at];
      // Solve again with this parameter held, so that the others adapt to it.
      if ((scaled[at] <= low && to < low) || (scaled[at] >= high && to > high)) changed = held[at] = true;
    }
    if (!changed) break;
  }
  return step;
}

/// Ascends to the point of largest posterior.
class Ascent {
 public:
  Ascent(RunFilters& search, const LevelPrior& prior, const GreyBoxPoint& start,
         const GreyBoxOptions& options)
      : search_(search), options_(options), prior_(prior), point_(start) {
    free_ = options.free.empty() ? Free() : makeFree(start.model, options.free);
    for (std::size_t i = 0; i < free_.index.size(); ++i)
      scaled_.push_back(free_.base[free_.index[i]] / free_.scale[i]);
    if (point_.loudness.empty()) point_.loudness.assign(search.filters().size(), 0.0);
    held_ = levelIndices(options.held);
  }

  GreyBoxFit run() {
    if (options_.far) {
      // With free trims from the start, differences between runs would replace the parameters.
      const std::set<int> held = held_;
      for (int i = kFirstTrim; i < kLevels; ++i) held_.insert(i);
      climb(std::numeric_limits<double>::infinity(), kCoarseGain);
      climb(200, kCoarseGain);
      held_ = held;
    }
    climb(options_.cap);
    if (centreThrust()) climb(options_.cap);
    return result();
  }

 private:
  double value(const GreyBoxPoint& point, double cap) {
    const Eigen::VectorXd away = fromExpected(point.model);
    return search_.evaluate(point, cap) + prior_(point) - 0.5 * away.dot(free_.prior * away);
  }

  /// The free parameters' coordinates over scale, minus the mean of their prior.
  Eigen::VectorXd fromExpected(const Model& model) const {
    const std::vector<double> coordinates = model.coordinates();
    Eigen::VectorXd away = -free_.expected;
    for (std::size_t i = 0; i < free_.index.size(); ++i)
      away(static_cast<Eigen::Index>(i)) += coordinates[free_.index[i]] / free_.scale[i];
    return away;
  }

  void deriveParameters() {
    RunScores found = search_.scores(point_, free_);
    score_ = found.score.colwise().sum().transpose() - free_.prior * fromExpected(point_.model);
    information_ = found.information;
    by_acceleration_ = found.by_acceleration;
    // Parameters do not move along directions that are not identifiable.
    const Eigen::MatrixXd unseen = knownBy(by_acceleration_).unseen;
    if (unseen.cols() == 0) return;
    score_ -= unseen * (unseen.transpose() * score_);
    const Eigen::MatrixXd across = information_ * unseen * unseen.transpose();
    information_ += unseen * (unseen.transpose() * across) - across - across.transpose();
  }

  /// Derivatives by the levels, then by the loudness of each run. The latter are sums of
  /// derivatives by the run's levels.
  void deriveLevels() {
    const auto found = search_.levelScores(point_, held_);
    const auto runs = static_cast<Eigen::Index>(found.size());
    level_score_ = Eigen::VectorXd::Zero(kLevels + runs);
    level_information_ = Eigen::MatrixXd::Zero(kLevels + runs, kLevels + runs);
    level_score_.head<kLevels>() = -prior_.precision.cwiseProduct(logs(point_.levels) - prior_.median);
    level_information_.diagonal().head<kLevels>() = prior_.precision;
    constexpr double kPrecision = 1 / (kLoudness * kLoudness);
    for (Eigen::Index i = 0; i < runs; ++i) {
      const RunLevelScores& run = found[static_cast<std::size_t>(i)];
      level_score_.head<kLevels>() += run.score;
      level_information_.topLeftCorner<kLevels, kLevels>() += run.information;
      double slope = -kPrecision * point_.loudness[static_cast<std::size_t>(i)], bend = kPrecision;
      Eigen::VectorXd across = Eigen::VectorXd::Zero(kLevels);
      for (const int a : kScaledByLoudness) {
        slope += run.score(a);
        across += run.information.col(a);
      }
      for (const int a : kScaledByLoudness) bend += across(a);
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

  /// Moves the mean of the runs' relative changes of thrust into the parameter k. The likelihood is
  /// nearly flat along this direction, so that scoring steps would be small. Returns whether the
  /// derivatives have to be computed again.
  bool centreThrust() {
    const auto k = std::find(options_.free.begin(), options_.free.end(), "k");
    if (k == options_.free.end() || !options_.levels || held_.count(kLevels - 1)) return false;
    double mean = 0, square = 0;
    const double count = static_cast<double>(search_.filters().size());
    for (const DisturbanceFilter& filter : search_.filters()) {
      mean += filter.constants()(3) / count;
      square += std::pow(filter.constants()(3), 2) / count;
    }
    if (std::abs(mean) < kMaxMeanThrust) return false;
    const GreyBoxPoint before = point_;
    const std::vector<double> scaled = scaled_;
    const double best = best_;
    const auto at = static_cast<std::size_t>(k - options_.free.begin());
    scaled_[at] *= 1 + mean;
    setCoordinates(point_.model, free_.coordinates(scaled_.data()));
    point_.levels.thrust = std::max(1e-3, std::sqrt(std::max(0.0, square - mean * mean)));
    climb(options_.cap);
    if (best_ > best) return true;
    point_ = before;
    scaled_ = scaled;
    return true;
  }

  /// Ascends by alternating steps of parameters and levels, because their joint information is
  /// zero. Each has its own damping: far from the maximum, steps of the levels overshoot more. The
  /// one that gains far more than the other takes several steps in turn.
  void climb(double cap, double min_gain = kMinGain) {
    min_gain_ = min_gain;
    best_ = requireFinite(value(point_, cap));
    // Damped, because slow and white wrench substitute for each other and steps would oscillate.
    Turn parameters{scaled_.empty(), 1e-3, 1e-6, 0.1}, levels{!options_.levels, 0.5, 1e-3, 0.5};
    int i = 0;
    for (; i < options_.max_iterations && !(parameters.settled && levels.settled); ++i) {
      if (parameters.isDueBeside(levels)) {
        deriveParameters();
        take(parameters, levels, cap, &Ascent::moveParameters);
      }
      if (levels.isDueBeside(parameters)) {
        deriveLevels();
        take(levels, parameters, cap, &Ascent::moveLevels);
      }
    }
    iterations_ += i;
    converged_ = parameters.settled && levels.settled;
  }

  /// Ascent of the parameters alone, or of the levels alone.
  struct Turn {
    bool absent;
    double damping, least;  ///< current and smallest damping
    double calmer;          ///< factor on the damping after a step with the expected gain
    bool settled = absent;
    double gain = std::numeric_limits<double>::infinity();  ///< gain of the last step

    /// Whether to take a step: not while the other ascent gains far more.
    bool isDueBeside(const Turn& other) const {
      return !settled && (other.settled || gain >= kMinShare * other.gain);
    }
  };

  /// A damped step.
  struct Step {
    double expected;  ///< gain of the log-posterior by score and information
    double length;    ///< in standard deviations
  };
  /// Moves a point and its parameters by a damped step.
  using Move = Step (Ascent::*)(double damping, GreyBoxPoint&, std::vector<double>& scaled) const;

  static Step stepBy(const Eigen::VectorXd& step, const Eigen::VectorXd& score,
                     const Eigen::MatrixXd& information) {
    const double square = step.dot(information * step);
    return {score.dot(step) - 0.5 * square, std::sqrt(std::max(0.0, square))};
  }

  Step moveParameters(double damping, GreyBoxPoint& point, std::vector<double>& scaled) const {
    const Eigen::VectorXd step = boundedStep(information_, score_, damping, free_, scaled_);
    for (std::size_t j = 0; j < scaled.size(); ++j) scaled[j] += step(static_cast<Eigen::Index>(j));
    setCoordinates(point.model, free_.coordinates(scaled.data()));
    return stepBy(step, score_, information_);
  }

  Step moveLevels(double damping, GreyBoxPoint& point, std::vector<double>&) const {
    Eigen::MatrixXd damped = level_information_;
    damped.diagonal() *= 1 + damping;
    Eigen::VectorXd step = solveSymmetric(damped, level_score_);
    const Step result = stepBy(step, level_score_, level_information_);
    for (Eigen::Index i = 0; i < step.size(); ++i) {
      // A scoring step of the logarithm changes the variance by the factor 1 + 2 step.
      if (i < kFirstTime || i >= kFirstTime + 4) step(i) = 0.5 * std::log(std::max(1e-3, 1 + 2 * step(i)));
      step(i) = std::clamp(step(i), -kMaxLevelStep, kMaxLevelStep);
    }
    point.levels = fromLogs(logs(point.levels) + step.head<kLevels>());
    for (std::size_t r = 0; r < point.loudness.size(); ++r)
      point.loudness[r] += step(kLevels + static_cast<Eigen::Index>(r));
    return result;
  }

  /// A step that did not gain.
  struct Failure {
    double damping, length, gain;
  };

  /// Damping of the next trial after failed ones, the last of which is `now`; nothing if no shorter
  /// step is worth a trial. The score is not exactly the slope of the log-likelihood, because it
  /// ignores that the filter's gains depend on the parameters. So close to the maximum it may
  /// promise a gain where there is none, which the parabola through the present point and the last
  /// two trials shows.
  std::optional<double> dampingAfter(const std::optional<Failure>& before, const Failure& now) const {
    constexpr double kShorter = 0.7;  // largest ratio of lengths of which a parabola is made
    if (!before) return 10 * now.damping;
    if (!std::isfinite(before->gain) || now.length > kShorter * before->length)
      return (now.length > 0.9 * before->length ? 100 : 10) * now.damping;
    const double a = before->length, b = now.length;
    const double slope = (now.gain * a * a - before->gain * b * b) / (a * b * (a - b));
    const double bend = (slope * b - now.gain) / (b * b);
    if (slope <= 0 || slope * slope < 4 * bend * min_gain_) return {};
    return std::max(2 * now.damping, (1 + now.damping) * 2 * bend * b / slope - 1);
  }

  /// One step uphill.
  void take(Turn& turn, Turn& other_turn, double cap, Move move) {
    std::optional<Failure> before;
    for (int trial = 0; trial < 8; ++trial) {
      GreyBoxPoint other = point_;
      std::vector<double> scaled = scaled_;
      const auto [expected, length] = (this->*move)(turn.damping, other, scaled);
      if (trial == 0 && expected < kNoGain * min_gain_) {
        turn.settled = true;
        return;
      }
      const double found = value(other, cap), gain = found - best_;
      if (std::isfinite(found) && gain > -1e-9) {
        point_ = other;
        scaled_ = scaled;
        best_ = found;
        turn.gain = gain;
        turn.settled = gain < min_gain_ && expected < 2 * min_gain_;
        if (gain > min_gain_) other_turn.settled = other_turn.absent;
        const double trust = gain / expected;
        turn.damping = std::max(turn.least, turn.damping * (trust > 0.5    ? turn.calmer
                                                            : trust < 0.25 ? 4
                                                                           : 1));
        return;
      }
      if (expected < min_gain_) break;
      const Failure now{turn.damping, length, gain};
      const std::optional<double> damping = dampingAfter(before, now);
      if (!damping) break;
      turn.damping = *damping;
      before = now;
    }
    turn.settled = true;
    value(point_, cap);  // sets the filters back to point_ for the next derivatives
  }

  GreyBoxFit result() {
    GreyBoxFit fit;
    fit.point = point_;
    fit.by_run = search_.byRun();
    fit.log_likelihood = std::accumulate(fit.by_run.begin(), fit.by_run.end(), 0.0);
    fit.log_posterior = best_;
    for (const DisturbanceFilter& filter : search_.filters()) {
      const Eigen::Vector4d mean = filter.constants(), &sigma = filter.constantsSigma();
      fit.trims.push_back({mean.head<3>(), sigma.head<3>(), mean(3), sigma(3)});
    }
    if (!scaled_.empty() && by_acceleration_.size() == 0) deriveParameters();  // after no step
    fit.information = by_acceleration_;
    fit.scale = free_.scale;
    if (!scaled_.empty())
      fit.parameters = estimatesBy(knownBy(by_acceleration_), point_.model, free_, scaled_, {});
    fit.level_information = level_information_;
    fit.iterations = iterations_;
    fit.converged = converged_;
    return fit;
  }

  RunFilters& search_;
  const GreyBoxOptions& options_;
  const Prior prior_;
  GreyBoxPoint point_;
  Free free_;
  std::vector<double> scaled_;
  Eigen::VectorXd score_;
  Eigen::MatrixXd information_, by_acceleration_;
  Eigen::VectorXd level_score_;
  Eigen::MatrixXd level_information_;
  std::set<int> held_;  // levels
  int iterations_ = 0;
  // Each climb sets these:
  double best_, min_gain_;
  bool converged_;
};

}  // namespace

void setCoordinates(Model& model, const std::vector<double>& coordinates) {
  const auto infos = model.parameters();
  const std::vector<double> before = model.coordinates();
  std::vector<double> values = model.values();
  for (std::size_t i = 0; i < values.size(); ++i)
    if (coordinates[i] != before[i])
      values[i] = std::clamp(infos[i].fromCoordinate(coordinates[i]), infos[i].lower, infos[i].upper);
  model.setValues(values);
}

GreyBoxFit ascend(RunFilters& filters, const LevelPrior& prior, const GreyBoxPoint& start,
                  const GreyBoxOptions& options) {
  return Ascent(filters, prior, start, options).run();
}

}  // namespace ground::detail
