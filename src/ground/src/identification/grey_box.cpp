#include "ground/identification/grey_box.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <set>
#include <stdexcept>

#include "descent.h"
#include "disturbance_filter.h"
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
constexpr int kFirstTrim = 11;  // of the levels
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

  void derive() {
    if (!free_.index.empty()) {
      RunScores found = search_.scores(point_, free_);
      score_ = found.score.colwise().sum().transpose();
      information_ = found.information;
    }
    if (options_.levels) deriveLevels();
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

  void climb(double cap) {
    double best = value(point_, cap);
    if (!std::isfinite(best))
      throw std::runtime_error("the model's motion along the recordings is not finite");
    double damping = 1e-3;
    converged_ = false;
    for (int i = 0; i < options_.max_iterations && !converged_; ++i, ++iterations_) {
      derive();
      bool better = false;
      for (int trial = 0; trial < 8 && !better; ++trial) {
        GreyBoxPoint other = point_;
        std::vector<double> scaled = scaled_;
        double expected = 0;
        if (!scaled.empty()) {
          const Eigen::VectorXd step = boundedStep(information_, score_, damping, free_, scaled_);
          for (std::size_t j = 0; j < scaled.size(); ++j) scaled[j] += step(j);
          expected += score_.dot(step) - 0.5 * step.dot(information_ * step);
          setCoordinates(other.model, free_.coordinates(scaled.data()));
        }
        if (options_.levels) {
          Eigen::MatrixXd damped = level_information_;
          damped.diagonal() *= 1 + damping;
          Eigen::VectorXd step = damped.ldlt().solve(level_score_);
          expected += level_score_.dot(step) - 0.5 * step.dot(level_information_ * step);
          step = step.cwiseMax(-kLongestLevel).cwiseMin(kLongestLevel);
          other.levels = fromLogs(logs(other.levels) + step.head<kLevels>());
          for (std::size_t r = 0; r < other.loudness.size(); ++r)
            other.loudness[r] += step(kLevels + static_cast<Eigen::Index>(r));
        }
        const double found = value(other, cap);
        if (std::isfinite(found) && found > best - 1e-9) {
          converged_ = found - best < kSettled && expected < 2 * kSettled;
          better = true;
          best = found;
          point_ = other;
          scaled_ = scaled;
          damping = std::max(1e-6, damping * (trial == 0 ? 0.2 : 1));
        } else {
          if (expected < kSettled) break;
          damping *= trial < 2 ? 10 : 30;
        }
      }
      if (!better) {
        value(point_, cap);  // back to where derivatives belong
        converged_ = true;
      }
    }
    best_ = best;
  }

  GreyBoxFit result() {
    derive();
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
    fit.parameters = parameters();
    fit.level_information = level_information_;
    fit.iterations = iterations_;
    fit.converged = converged_;
    return fit;
  }

  /// Values with 95% intervals by the information.
  std::vector<FittedParameter> parameters() const {
    const auto n = static_cast<Eigen::Index>(scaled_.size());
    std::vector<FittedParameter> result;
    if (n == 0) return result;
    const Eigen::VectorXd size =
        information_.diagonal().cwiseMax(std::numeric_limits<double>::min()).cwiseSqrt();
    const Eigen::MatrixXd even =
        size.cwiseInverse().asDiagonal() * information_ * size.cwiseInverse().asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(even);
    constexpr double kUnseen = 1e-10;  // of the largest eigenvalue
    const Eigen::VectorXd inverse = eigen.eigenvalues().unaryExpr([&](double value) {
      return value > kUnseen * eigen.eigenvalues()(n - 1) ? 1 / value : 0.0;
    });
    const auto infos = point_.model.parameters();
    const std::vector<double> values = point_.model.values();
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const Eigen::VectorXd row = eigen.eigenvectors().row(i);
      double unseen = 0;
      for (Eigen::Index j = 0; j < n; ++j)
        if (inverse(j) == 0) unseen += row(j) * row(j);
      const double deviation =
          std::sqrt(row.cwiseAbs2().dot(inverse)) / size(i);  // in parts of the scale
      const bool identified = unseen < 0.01 && deviation < kUnidentified;
      const ParameterInfo& info = infos[free_.index[at]];
      const double coordinate = scaled_[at] * free_.scale[at], value = values[free_.index[at]];
      const double spread = identified ? deviation * free_.scale[at] : kInfinity;
      constexpr double kQuantile = 1.959964;
      double low = info.lower, high = info.upper;
      if (identified) {
        low = info.fromCoordinate(std::max(coordinate - kQuantile * spread, free_.lower[at]));
        high = info.fromCoordinate(std::min(coordinate + kQuantile * spread, free_.upper[at]));
        if (low > high) std::swap(low, high);
      }
      const double slope = free_.reciprocal[at] ? value * value : 1;
      result.push_back({info.name, info.unit, free_.base[free_.index[at]], value, low, high,
                        slope * spread, free_.inward(at, scaled_[at]) != 0, identified});
    }
    return result;
  }

  Search& search_;
  const GreyBoxOptions& options_;
  const Prior prior_;
  GreyBoxPoint point_;
  Free free_;
  std::vector<double> scaled_;
  Eigen::VectorXd score_;
  Eigen::MatrixXd information_;
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
