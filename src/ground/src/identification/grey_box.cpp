#include "ground/identification/grey_box.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <set>
#include <stdexcept>

#include "descent.h"
#include "disturbance_filter.h"
#include "estimates.h"
#include "forecast.h"
#include "free_parameters.h"
#include "parallel.h"

namespace ground {
namespace {

constexpr int kLevels = DisturbanceLevels::kCount;
using LevelVector = Eigen::Matrix<double, kLevels, 1>;

constexpr double kLoudness = 0.5;    // deviation of its prior
constexpr double kSettled = 0.01;    // gain of the log-posterior that ends the search
constexpr double kUnidentified = 30;  // deviation in parts of a parameter's typical size
constexpr double kCentred = 0.02;  // mean of the relative changes of thrust that is left
constexpr double kLongestLevel = 1.0;  // step of a level's logarithm
constexpr double kVague = 0.3;  // deviation of parameters without information, in parts of the scale

/// Levels whose strength follows the loudness of the run: sigma and white.
constexpr int kFirstTime = 3, kFirstTrim = 11;  // of the levels
constexpr int kLoud[] = {0, 1, 2, 6, 7, 8};

DisturbanceLevels levelsOf(const GreyBoxPoint& point, std::size_t run) {
  DisturbanceLevels levels = point.levels;
  if (!point.loudness.empty()) {
    const double factor = std::exp(point.loudness[run]);
    levels.sigma *= factor;
    levels.white *= factor;
  }
  return levels;
}

LevelVector logs(const DisturbanceLevels& levels) {
  LevelVector result;
  const auto values = levels.values();
  for (int i = 0; i < kLevels; ++i) result(i) = std::log(values[i]);
  return result;
}

DisturbanceLevels fromLogs(const LevelVector& logs) {
  std::array<double, kLevels> values;
  for (int i = 0; i < kLevels; ++i) values[i] = std::exp(logs(i));
  return DisturbanceLevels::of(values);
}

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

/// Recordings at a point: filters, and the likelihood there.
class Search {
 public:
  Search(const std::vector<RunData>& runs, double max_gap, int threads) : threads_(threads) {
    for (const RunData& run : runs) filters_.emplace_back(run, max_gap);
    by_run_.resize(runs.size());
  }

  double evaluate(const GreyBoxPoint& point, double cap) {
    inParallel(filters_.size(), threads_, [&](std::size_t i) {
      by_run_[i] = filters_[i].run(point.model, levelsOf(point, i), cap);
    });
    return std::accumulate(by_run_.begin(), by_run_.end(), 0.0);
  }

  RunScores scores(const GreyBoxPoint& point, const Free& free) const {
    std::vector<RunScores> found(filters_.size());
    inParallel(filters_.size(), threads_, [&](std::size_t i) {
      found[i] = filters_[i].scores(point.model, free, 1e9);
    });
    for (std::size_t i = 1; i < found.size(); ++i) {
      found[0].score += found[i].score;
      found[0].information += found[i].information;
    }
    return found[0];
  }

  /// Of the free parameters as far as it does not take the disturbance's level for known.
  Eigen::MatrixXd information(const GreyBoxPoint& point, const Free& free) const {
    std::vector<Eigen::MatrixXd> found(filters_.size());
    inParallel(filters_.size(), threads_, [&](std::size_t i) {
      found[i] =
          filters_[i].scores(point.model, free, 1e9, nullptr, Fixed::kAcceleration).information;
    });
    for (std::size_t i = 1; i < found.size(); ++i) found[0] += found[i];
    return found[0];
  }

  std::vector<RunLevelScores> levelScores(const GreyBoxPoint& point) const {
    std::vector<RunLevelScores> found(filters_.size());
    inParallel(filters_.size(), threads_, [&](std::size_t i) {
      found[i] = filters_[i].levelScores(levelsOf(point, i));
    });
    return found;
  }

  const std::vector<DisturbanceFilter>& filters() const { return filters_; }
  const std::vector<double>& byRun() const { return by_run_; }

 private:
  int threads_;
  std::vector<DisturbanceFilter> filters_;
  std::vector<double> by_run_;
};

/// A step of damped scoring within bounds: parameters at a bound that want out stay there.
Eigen::VectorXd boundedStep(const Eigen::MatrixXd& information, const Eigen::VectorXd& score,
                            double damping, const Free& free, const std::vector<double>& scaled) {
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
    const Eigen::VectorXd found = A.ldlt().solve(b);
    bool changed = false;
    for (Eigen::Index i = 0; i < m; ++i) {
      const auto at = static_cast<std::size_t>(moving[i]);
      const double low = free.lower[at] / free.scale[at], high = free.upper[at] / free.scale[at];
      const double to = scaled[at] + found(i);
      step(moving[i]) = std::clamp(to, low, high) - scaled[at];
      // Holding it lets the others follow.
      if ((scaled[at] <= low && to < low) || (scaled[at] >= high && to > high))
        changed = held[at] = true;
    }
    if (!changed) break;
    step.setZero();
  }
  return step;
}

void setCoordinates(Model& model, const std::vector<double>& coordinates) {
  const auto infos = model.parameters();
  std::vector<double> values = model.values();
  for (std::size_t i = 0; i < values.size(); ++i)
    if (coordinates[i] != model.coordinates()[i])
      values[i] = std::clamp(infos[i].fromCoordinate(coordinates[i]), infos[i].lower, infos[i].upper);
  model.setValues(values);
}

/// What an information tells of each parameter.
struct Known {
  Eigen::VectorXd variance;      ///< of coordinates over scale, by the directions that are seen
  std::vector<bool> identified;  ///< false: takes part in a direction that is not
  Eigen::MatrixXd unseen;        ///< orthonormal columns: directions along which nothing changes
  double volume;                 ///< logarithm of the information's determinant, as far as seen
};

Known knownBy(const Eigen::MatrixXd& information) {
  const Eigen::Index n = information.rows();
  const Eigen::VectorXd size =
      information.diagonal().cwiseMax(std::numeric_limits<double>::min()).cwiseSqrt();
  const Eigen::MatrixXd even =
      size.cwiseInverse().asDiagonal() * information * size.cwiseInverse().asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(even);
  constexpr double kUnseen = 1e-10, kTakesPart = 1e-12;  // of the largest eigenvalue; of a direction
  Eigen::Index first = 0;  // direction that is seen
  while (first < n && !(eigen.eigenvalues()(first) > kUnseen * eigen.eigenvalues()(n - 1))) ++first;
  const Eigen::MatrixXd directions = size.cwiseInverse().asDiagonal() * eigen.eigenvectors();
  Known known;
  known.variance = directions.rightCols(n - first).cwiseAbs2() *
                   eigen.eigenvalues().tail(n - first).cwiseInverse();
  for (Eigen::Index i = 0; i < n; ++i)
    known.identified.push_back(
        eigen.eigenvectors().row(i).head(first).squaredNorm() < kTakesPart &&
        known.variance(i) < kUnidentified * kUnidentified);
  known.volume = eigen.eigenvalues().tail(n - first).array().log().sum() +
                 2 * size.array().log().sum();
  known.unseen = directions.leftCols(first).householderQr().householderQ() *
                 Eigen::MatrixXd::Identity(n, first);
  return known;
}

/// Values with 95% intervals; `freedom`: degrees of each parameter, none: the levels of what is
/// random count as known.
std::vector<FittedParameter> estimates(const Model& model, const Free& free,
                                       const std::vector<double>& scaled,
                                       const Known& known, const std::vector<double>& freedom) {
  std::vector<FittedParameter> result;
  const auto infos = model.parameters();
  for (std::size_t i = 0; i < scaled.size(); ++i) {
    constexpr double kNormal = 1.959964;
    const double deviation =
        known.identified[i] ? std::sqrt(known.variance(static_cast<Eigen::Index>(i))) : kInfinity;
    const ParameterInfo& info = infos[free.index[i]];
    result.push_back(detail::estimateOf(info, free, i, scaled[i], deviation,
                                        freedom.empty() ? kNormal : detail::quantileOf(freedom[i]),
                                        info.fromCoordinate(free.base[free.index[i]])));
  }
  return result;
}

/// Ascends to the likeliest point.
class Ascent {
 public:
  Ascent(Search& search, const LevelPrior& prior, const GreyBoxPoint& start,
         const GreyBoxOptions& options)
      : search_(search), options_(options), prior_(prior), point_(start) {
    free_ = options.free.empty() ? Free() : makeFree(start.model, options.free);
    for (std::size_t i = 0; i < free_.index.size(); ++i)
      scaled_.push_back(free_.base[free_.index[i]] / free_.scale[i]);
    if (point_.loudness.empty()) point_.loudness.assign(search.filters().size(), 0.0);
    const auto& names = DisturbanceLevels::names();
    for (const std::string& name : options.held) {
      const auto at = std::find(names.begin(), names.end(), name);
      if (at == names.end()) throw std::invalid_argument("there is no level '" + name + "'");
      held_.insert(static_cast<int>(at - names.begin()));
    }
  }

  GreyBoxFit run() {
    if (options_.far) {
      // Were what differs between runs free from the start, it would take the parameters' place.
      const std::set<int> held = held_;
      for (int i = kFirstTrim; i < kLevels; ++i) held_.insert(i);
      climb(std::numeric_limits<double>::infinity());
      climb(200);
      held_ = held;
    }
    climb(options_.cap);
    if (centreThrust()) climb(options_.cap);  // or back
    return result();
  }

 private:
  double value(const GreyBoxPoint& point, double cap) {
    return search_.evaluate(point, cap) + prior_(point);
  }

  void deriveParameters() {
    RunScores found = search_.scores(point_, free_);
    score_ = found.score.colwise().sum().transpose();
    information_ = found.information;
    if (unseen_.cols() == 0) return;
    // What the recordings cannot tell stays as it was.
    unseen_ = knownBy(search_.information(point_, free_)).unseen;
    score_ -= unseen_ * (unseen_.transpose() * score_);
    const Eigen::MatrixXd across = information_ * unseen_ * unseen_.transpose();
    information_ += unseen_ * (unseen_.transpose() * across) - across - across.transpose();
  }

  /// Levels, then the loudness of each run: its derivatives are sums of those by the run's levels.
  void deriveLevels() {
    const auto found = search_.levelScores(point_);
    const auto runs = static_cast<Eigen::Index>(found.size());
    level_score_ = Eigen::VectorXd::Zero(kLevels + runs);
    level_information_ = Eigen::MatrixXd::Zero(kLevels + runs, kLevels + runs);
    level_score_.head<kLevels>() =
        -prior_.precision.cwiseProduct(logs(point_.levels) - prior_.median);
    level_information_.diagonal().head<kLevels>() = prior_.precision;
    constexpr double kPrecision = 1 / (kLoudness * kLoudness);
    for (Eigen::Index i = 0; i < runs; ++i) {
      const RunLevelScores& run = found[static_cast<std::size_t>(i)];
      level_score_.head<kLevels>() += run.score;
      level_information_.topLeftCorner<kLevels, kLevels>() += run.information;
      double slope = -kPrecision * point_.loudness[static_cast<std::size_t>(i)], bend = kPrecision;
      Eigen::VectorXd across = Eigen::VectorXd::Zero(kLevels);
      for (const int a : kLoud) {
        slope += run.score(a);
        across += run.information.col(a);
      }
      for (const int a : kLoud) bend += across(a);
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

  /// Thrust that is off by the same in all runs is the parameter's: along the way between the two
  /// the likelihood is nearly flat, and steps are small.
  bool centreThrust() {
    const auto k = std::find(options_.free.begin(), options_.free.end(), "k");
    if (k == options_.free.end() || !options_.levels || held_.count(kLevels - 1)) return false;
    double mean = 0, square = 0;
    const double count = static_cast<double>(search_.filters().size());
    for (const DisturbanceFilter& filter : search_.filters()) {
      mean += filter.constants()(3) / count;
      square += std::pow(filter.constants()(3), 2) / count;
    }
    if (std::abs(mean) < kCentred || std::abs(mean) < kCentred * point_.levels.thrust) return false;
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

  /// Parameters and levels take turns: their joint information is zero, but far from the top a
  /// step of the levels may overshoot where one of the parameters does as expected.
  void climb(double cap) {
    best_ = value(point_, cap);
    if (!std::isfinite(best_))
      throw std::runtime_error("the model's motion along the recordings is not finite");
    // Slow and white parts stand in for each other: the levels' steps swing unless damped.
    Turn parameters{scaled_.empty(), 1e-3, 1e-6, 0.1}, levels{!options_.levels, 0.5, 1e-3, 0.5};
    if (!scaled_.empty()) unseen_ = knownBy(search_.information(point_, free_)).unseen;
    int i = 0;
    for (; i < options_.max_iterations && !(parameters.settled && levels.settled); ++i) {
      if (!parameters.settled) {
        deriveParameters();
        take(parameters, levels, cap, &Ascent::moveParameters);
      }
      if (!levels.settled) {
        deriveLevels();
        take(levels, parameters, cap, &Ascent::moveLevels);
      }
    }
    iterations_ += i;
    converged_ = parameters.settled && levels.settled;
  }

  /// Of the parameters, or of the levels.
  struct Turn {
    bool absent;
    double damping, least;  ///< at the start, at the least
    double calmer;          ///< factor on the damping after a step that did as expected
    bool settled = absent;
  };

  /// Moves a point and its parameters by a damped step; returns the gain that is expected.
  using Move = double (Ascent::*)(double damping, GreyBoxPoint&, std::vector<double>& scaled) const;

  double moveParameters(double damping, GreyBoxPoint& point, std::vector<double>& scaled) const {
    const Eigen::VectorXd step = boundedStep(information_, score_, damping, free_, scaled_);
    for (std::size_t j = 0; j < scaled.size(); ++j) scaled[j] += step(static_cast<Eigen::Index>(j));
    setCoordinates(point.model, free_.coordinates(scaled.data()));
    return score_.dot(step) - 0.5 * step.dot(information_ * step);
  }

  double moveLevels(double damping, GreyBoxPoint& point, std::vector<double>&) const {
    Eigen::MatrixXd damped = level_information_;
    damped.diagonal() *= 1 + damping;
    Eigen::VectorXd step = damped.ldlt().solve(level_score_);
    const double expected = level_score_.dot(step) - 0.5 * step.dot(level_information_ * step);
    for (Eigen::Index i = 0; i < step.size(); ++i) {
      // Scoring would change the square of a deviation alone by 2 step of it, where it is likeliest.
      if (i < kFirstTime || i >= kFirstTime + 3)
        step(i) = 0.5 * std::log(std::max(1e-3, 1 + 2 * step(i)));
      step(i) = std::clamp(step(i), -kLongestLevel, kLongestLevel);
    }
    point.levels = fromLogs(logs(point.levels) + step.head<kLevels>());
    for (std::size_t r = 0; r < point.loudness.size(); ++r)
      point.loudness[r] += step(kLevels + static_cast<Eigen::Index>(r));
    return expected;
  }

  /// One step uphill.
  void take(Turn& turn, Turn& other_turn, double cap, Move move) {
    for (int trial = 0; trial < 8; ++trial) {
      GreyBoxPoint other = point_;
      std::vector<double> scaled = scaled_;
      const double expected = (this->*move)(turn.damping, other, scaled);
      const double found = value(other, cap), gain = found - best_;
      if (std::isfinite(found) && gain > -1e-9) {
        point_ = other;
        scaled_ = scaled;
        best_ = found;
        turn.settled = gain < kSettled && expected < 2 * kSettled;
        if (gain > kSettled) other_turn.settled = other_turn.absent;
        const double trust = gain / expected;
        turn.damping = std::max(turn.least, turn.damping * (trust > 0.5    ? turn.calmer
                                                            : trust < 0.25 ? 4
                                                                           : 1));
        return;
      }
      if (expected < kSettled) break;
      turn.damping *= trial < 2 ? 10 : 30;
    }
    turn.settled = true;
    value(point_, cap);  // back to where derivatives belong
  }

  GreyBoxFit result() {
    if (!free_.index.empty()) information_ = search_.information(point_, free_);
    if (options_.levels) deriveLevels();
    GreyBoxFit fit;
    fit.point = point_;
    fit.by_run = search_.byRun();
    fit.log_likelihood = std::accumulate(fit.by_run.begin(), fit.by_run.end(), 0.0);
    fit.log_posterior = best_;
    for (const DisturbanceFilter& filter : search_.filters()) {
      const Eigen::Vector4d mean = filter.constants(), &sigma = filter.constantsSigma();
      fit.trims.push_back({mean.head<3>(), sigma.head<3>(), mean(3), sigma(3)});
    }
    fit.information = information_;
    fit.scale = free_.scale;
    if (!scaled_.empty())
      fit.parameters = estimates(point_.model, free_, scaled_, knownBy(information_), {});
    fit.level_information = level_information_;
    fit.iterations = iterations_;
    fit.converged = converged_;
    return fit;
  }

  Search& search_;
  const GreyBoxOptions& options_;
  const Prior prior_;
  GreyBoxPoint point_;
  Free free_;
  std::vector<double> scaled_;
  Eigen::VectorXd score_;
  Eigen::MatrixXd information_, unseen_;
  Eigen::VectorXd level_score_;
  Eigen::MatrixXd level_information_;
  double best_ = 0;
  std::set<int> held_;  // levels
  int iterations_ = 0;
  bool converged_ = false;
};

/// Throws std::invalid_argument.
void checkForecast(const ForecastOptions& options, std::size_t samples) {
  for (std::size_t i = 0; i < options.starts.size(); ++i) {
    const int start = options.starts[i];
    if (start < 0 || start >= static_cast<int>(samples) || (i > 0 && start < options.starts[i - 1]))
      throw std::invalid_argument("forecasts start at ascending samples of the run");
  }
  const auto free = static_cast<Eigen::Index>(options.free.size());
  if (options.information.rows() != free || options.information.cols() != free ||
      options.scale.size() != options.free.size())
    throw std::invalid_argument("each uncertain parameter needs its information and scale");
  if (options.horizons.size() != options.starts.size())
    throw std::invalid_argument("each start of a forecast needs a horizon");
  if (!(options.part > 0 && std::lround(0.5 * (1 - options.part) * (options.draws + 1)) >= 1))
    throw std::invalid_argument("too few draws for the ends of the band");
}

/// Values of a run's loudness to weigh, relative to the one expected.
std::vector<double> loudnessAbout(bool unknown) {
  if (!unknown) return {0};
  std::vector<double> values;
  for (int i = -3; i <= 3; ++i) values.push_back(2.0 / 3 * i * kLoudness);
  return values;
}

/// A model for each draw, its uncertain parameters within their bounds.
std::vector<DrawnModel> drawModels(const Model& model, const ForecastOptions& options,
                                   const Free& free, std::mt19937_64& random) {
  const auto n = static_cast<Eigen::Index>(options.free.size());
  if (n == 0)
    return std::vector<DrawnModel>(static_cast<std::size_t>(options.draws), {model, {}});
  Eigen::MatrixXd information = options.information;
  information.diagonal().array() += 1 / (kVague * kVague);
  const Eigen::LLT<Eigen::MatrixXd> root(information);
  std::normal_distribution<double> normal;
  std::vector<DrawnModel> models;
  for (int i = 0; i < options.draws; ++i) {
    Eigen::VectorXd away(n);
    for (Eigen::Index j = 0; j < n; ++j) away(j) = normal(random);
    away = root.matrixU().solve(away);
    std::vector<double> scaled;
    for (std::size_t j = 0; j < free.index.size(); ++j) {
      const double likeliest = free.base[free.index[j]] / free.scale[j];
      scaled.push_back(std::clamp(likeliest + away(static_cast<Eigen::Index>(j)),
                                  free.lower[j] / free.scale[j], free.upper[j] / free.scale[j]));
      away(static_cast<Eigen::Index>(j)) = scaled.back() - likeliest;
    }
    models.push_back({model, away});
    setCoordinates(models.back().model, free.coordinates(scaled.data()));
  }
  return models;
}

/// From logarithms to weights that sum to 1.
void normaliseWeights(std::vector<Alternative>& alternatives) {
  double largest = -kInfinity, sum = 0;
  for (const Alternative& one : alternatives) largest = std::max(largest, one.weight);
  for (Alternative& one : alternatives) sum += one.weight = std::exp(one.weight - largest);
  for (Alternative& one : alternatives) one.weight /= sum;
}

}  // namespace

GreyBox::GreyBox(std::vector<RunData> runs, const Body<double>& craft, double max_gap)
    : runs_(std::move(runs)), prior_(craft), max_gap_(max_gap) {
  for (const RunData& run : runs_) DisturbanceFilter(run, max_gap_);
}

GreyBox::~GreyBox() = default;

GreyBoxPoint GreyBox::start(const Model& model) const {
  GreyBoxPoint point{model, prior_.median, {}};
  point.levels.sigma *= 5;
  return point;
}

GreyBoxFit GreyBox::fit(const GreyBoxPoint& start, const GreyBoxOptions& options) const {
  Search search(runs_, max_gap_, options.threads);
  return Ascent(search, prior_, start, options).run();
}

std::vector<FittedParameter> GreyBox::intervals(const GreyBoxFit& fit,
                                                const GreyBoxOptions& options) const {
  if (options.free.empty()) return {};
  Search search(runs_, max_gap_, options.threads);
  const Free free = makeFree(fit.point.model, options.free);
  std::vector<double> scaled;
  for (std::size_t i = 0; i < free.index.size(); ++i)
    scaled.push_back(free.base[free.index[i]] / free.scale[i]);
  const Eigen::Index count = fit.level_information.rows();
  const auto at = [&](const Eigen::VectorXd& away) {  // of levels' logarithms and loudness
    GreyBoxPoint point = fit.point;
    point.levels = fromLogs(logs(point.levels) + away.head<kLevels>());
    point.loudness.resize(runs_.size(), 0.0);
    for (std::size_t r = 0; r < runs_.size(); ++r)
      point.loudness[r] += away(kLevels + static_cast<Eigen::Index>(r));
    search.evaluate(point, options.cap);
    return knownBy(search.information(point, free));
  };
  const auto& names = DisturbanceLevels::names();
  Eigen::MatrixXd slopes =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(free.index.size()), count);
  Eigen::VectorXd lost = Eigen::VectorXd::Zero(count);
  for (int c = 0; c < count; ++c) {
    constexpr double kStep = 0.3;  // of a logarithm: the slope of a mean over what is likely
    if (c < kLevels && std::count(options.held.begin(), options.held.end(), names[c])) continue;
    const Eigen::VectorXd away = kStep * Eigen::VectorXd::Unit(count, c);
    const Known more = at(away), less = at(-away);
    slopes.col(c) = (more.variance - less.variance) / (2 * kStep);
    lost(c) = (less.volume - more.volume) / (2 * kStep);
  }
  // Levels come out low, for the parameters follow some of what is random: one Newton step to where
  // the restricted likelihood is largest (Patterson and Thompson 1971).
  const Eigen::LDLT<Eigen::MatrixXd> levels(fit.level_information);
  const Eigen::VectorXd away = 0.5 * levels.solve(lost);
  const Known known = at(away);
  const Eigen::VectorXd& variance = known.variance;
  // Twice the squared mean over the variance: of the estimated variances (Satterthwaite 1946).
  const Eigen::MatrixXd doubt = slopes * levels.solve(slopes.transpose());
  constexpr double kLeast = 3, kMost = 1e6;  // degrees of freedom
  std::vector<double> freedom;
  for (Eigen::Index i = 0; i < variance.size(); ++i)
    freedom.push_back(doubt(i, i) > 0
                          ? std::clamp(2 * std::pow(variance(i), 2) / doubt(i, i), kLeast, kMost)
                          : kMost);
  return estimates(fit.point.model, free, scaled, known, freedom);
}

std::vector<Eigen::VectorXd> GreyBox::likelihood(const GreyBoxPoint& point, double cap,
                                                 double block, int threads) const {
  Search search(runs_, max_gap_, threads);
  search.evaluate(point, cap);
  std::vector<Eigen::VectorXd> result;
  for (const DisturbanceFilter& filter : search.filters()) result.push_back(filter.densities(block));
  return result;
}

GreyBoxScores GreyBox::scores(const GreyBoxPoint& point, const std::vector<std::string>& parameters,
                              double cap, double block, int threads) const {
  Search search(runs_, max_gap_, threads);
  const Free free = makeFree(point.model, parameters);
  if (!std::isfinite(search.evaluate(point, cap)))
    throw std::runtime_error("the model's motion along the recordings is not finite");
  std::vector<RunScores> found(runs_.size());
  inParallel(runs_.size(), threads, [&](std::size_t i) {
    found[i] = search.filters()[i].scores(point.model, free, block);
  });
  GreyBoxScores result;
  result.scale = free.scale;
  const auto n = static_cast<Eigen::Index>(parameters.size());
  Eigen::Index rows = 0;
  for (const RunScores& run : found) rows += run.score.rows();
  result.score.resize(rows, n);
  result.information = Eigen::MatrixXd::Zero(n, n);
  rows = 0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    result.score.middleRows(rows, found[i].score.rows()) = found[i].score;
    result.run.insert(result.run.end(), static_cast<std::size_t>(found[i].score.rows()),
                      static_cast<int>(i));
    result.information += found[i].information;
    rows += found[i].score.rows();
  }
  return result;
}

GreyBoxResiduals GreyBox::residuals(const GreyBoxPoint& point, int run, double cap,
                                    const Eigen::MatrixXd& acting,
                                    const std::vector<int>& channels) const {
  const std::size_t at = indexOf(run);
  DisturbanceFilter filter(runs_[at], max_gap_);
  filter.run(point.model, levelsOf(point, at), cap);
  const auto count = static_cast<Eigen::Index>(filter.samples().size());
  if (acting.cols() != static_cast<Eigen::Index>(channels.size()) ||
      (acting.cols() > 0 && acting.rows() != count))
    throw std::invalid_argument("acting wrenches need a row a sample and a channel a column");
  for (const int channel : channels)
    if (channel < 0 || channel > 2) throw std::invalid_argument("channels are 0, 1 and 2");
  GreyBoxResiduals result;
  result.whitened.resize(count, 3);
  for (std::size_t k = 0; k < filter.samples().size(); ++k) {
    result.whitened.row(static_cast<Eigen::Index>(k)) = filter.whitened(k);
    result.scored.push_back(!filter.samples()[k].starts);
  }
  result.wrench = filter.wrench();
  result.constants = filter.constantsSoFar();
  if (acting.cols() > 0) result.responses = filter.responses(acting, channels);
  return result;
}

std::vector<Forecast> GreyBox::forecast(const GreyBoxPoint& point, int run,
                                        const ForecastOptions& options) const {
  const std::size_t at = indexOf(run);
  const RunData& data = runs_[at];
  checkForecast(options, data.times.size());
  DisturbanceFilter filter(data, max_gap_);
  const std::vector<double> about = loudnessAbout(options.unknown_loudness);
  std::vector<std::vector<Alternative>> alternatives(options.starts.size());
  for (const double more : about) {
    GreyBoxPoint other = point;
    other.loudness.resize(runs_.size(), 0.0);
    other.loudness[at] += more;
    const DisturbanceLevels levels = levelsOf(other, at);
    std::vector<FilterBelief> kept(options.starts.size());
    for (std::size_t i = 0; i < kept.size(); ++i) kept[i].sample = options.starts[i];
    if (!std::isfinite(filter.run(other.model, levels, options.cap, &kept)))
      throw std::runtime_error("the model's motion along the recordings is not finite");
    const double prior = -0.5 * std::pow(more / kLoudness, 2);
    for (std::size_t i = 0; i < kept.size(); ++i)
      alternatives[i].push_back({levels, kept[i], prior + kept[i].log_likelihood});
  }
  std::mt19937_64 random(options.seed);
  Free free = options.free.empty() ? Free() : makeFree(point.model, options.free);
  free.scale = options.scale;
  const std::vector<DrawnModel> models = drawModels(point.model, options, free, random);
  for (auto& possible : alternatives) normaliseWeights(possible);
  // It hardly depends on the levels: those that are likeliest in the end serve all alternatives.
  std::vector<FilterBelief> sensitive(options.starts.size());
  for (std::size_t i = 0; i < sensitive.size(); ++i) sensitive[i].sample = options.starts[i];
  if (!options.free.empty() && !alternatives.empty()) {
    const auto& ended = alternatives.back();
    const auto likeliest = std::max_element(
        ended.begin(), ended.end(),
        [](const Alternative& a, const Alternative& b) { return a.weight < b.weight; });
    filter.run(point.model, likeliest->levels, options.cap);
    filter.scores(point.model, free, 1e9, &sensitive);
  }
  std::vector<Forecast> result;
  for (const auto& possible : alternatives) {
    const auto first = static_cast<std::size_t>(possible.front().belief.sample);
    const double until = data.times[first] + options.horizons[result.size()];
    std::size_t last = filter.lastOfStretch(first);
    while (last > first && data.times[last] > until) --last;
    result.push_back(
        forecastBy(data, models, possible, sensitive[result.size()].sensitivity,
                   static_cast<int>(last), options, random));
    if (!result.back().mean.allFinite())
      throw std::runtime_error("the model's motion along the recordings is not finite");
  }
  return result;
}

std::size_t GreyBox::indexOf(int run) const {
  if (run < 0 || run >= static_cast<int>(runs_.size()))
    throw std::invalid_argument("there is no such run");
  return static_cast<std::size_t>(run);
}

}  // namespace ground
