#include "ground/identification/grey_box.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "estimates.h"
#include "forecast.h"
#include "likelihood_maximiser.h"
#include "parallel.h"
#include "robust_loss.h"

namespace ground {

using namespace detail;

namespace {

// Standard deviation of parameters without information, in coordinates over scale.
constexpr double kVagueDeviation = 0.3;

/// Throws std::invalid_argument on bad information about uncertain parameters.
void checkUncertainty(const ForecastOptions& options) {
  const auto free = static_cast<Eigen::Index>(options.free.size());
  if (options.information.rows() != free || options.information.cols() != free ||
      options.scale.size() != options.free.size())
    throw std::invalid_argument("each uncertain parameter needs its information and scale");
  for (const double scale : options.scale)
    if (!(scale > 0 && std::isfinite(scale)))
      throw std::invalid_argument("the scale of an uncertain parameter must be positive");
  if (!options.information.allFinite())
    throw std::invalid_argument("the information about uncertain parameters is not finite");
}

/// Throws std::invalid_argument on bad options.
void checkForecast(const ForecastOptions& options, std::size_t samples) {
  for (std::size_t i = 0; i < options.starts.size(); ++i) {
    const int start = options.starts[i];
    if (start < 0 || start >= static_cast<int>(samples) || (i > 0 && start < options.starts[i - 1]))
      throw std::invalid_argument("forecasts start at ascending samples of the run");
  }
  checkUncertainty(options);
  if (options.horizons.size() != options.starts.size())
    throw std::invalid_argument("each start of a forecast needs a horizon");
  for (const double horizon : options.horizons)
    if (!(horizon >= 0)) throw std::invalid_argument("the horizon of a forecast is negative or NaN");
  if (!(options.draws >= 2 && options.part > 0 &&
        std::lround(0.5 * (1 - options.part) * (options.draws + 1.0)) >= 1))
    throw std::invalid_argument("too few draws for the ends of the band");
  if (!(options.velocity_noise.minCoeff() >= 0 && options.velocity_noise.allFinite()))
    throw std::invalid_argument("the noise of velocities is negative or not finite");
}

/// Logarithms of a run's scale to average over, relative to the expected one.
std::vector<double> scalesAbout(bool unknown) {
  if (!unknown) return {0};
  std::vector<double> values;
  for (int i = -3; i <= 3; ++i) values.push_back(2.0 / 3 * i * kScaleDeviation);
  return values;
}

/// A model for each draw, with uncertain parameters clamped to their bounds.
std::vector<DrawnModel> drawModels(const Model& model, const ForecastOptions& options, const Free& free,
                                   std::mt19937_64& random) {
  const auto n = static_cast<Eigen::Index>(options.free.size());
  if (n == 0) return std::vector<DrawnModel>(static_cast<std::size_t>(options.draws), {model, {}});
  Eigen::MatrixXd information = options.information;
  information.diagonal().array() += 1 / (kVagueDeviation * kVagueDeviation);
  const Eigen::LLT<Eigen::MatrixXd> root(information);
  if (root.info() != Eigen::Success)
    throw std::invalid_argument("the information about uncertain parameters is not positive definite");
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
    models.push_back({modelAt(model, free, scaled.data()), away});
  }
  return models;
}

/// Converts logarithms of weights to weights that sum to 1.
void normaliseWeights(std::vector<Alternative>& alternatives) {
  double largest = -kInfinity, sum = 0;
  for (const Alternative& one : alternatives) largest = std::max(largest, one.weight);
  for (Alternative& one : alternatives) sum += one.weight = std::exp(one.weight - largest);
  for (Alternative& one : alternatives) one.weight /= sum;
}

}  // namespace

GreyBox::GreyBox(std::vector<RunData> runs, const Body<double>& craft)
    : runs_(std::move(runs)), prior_(craft) {
  if (runs_.empty()) throw std::invalid_argument("there is no run");
  for (const RunData& run : runs_) DisturbanceFilter{run};
}

void GreyBox::check(const GreyBoxPoint& point, double cap) const {
  if (!point.log_scales.empty() && point.log_scales.size() != runs_.size())
    throw std::invalid_argument("each run needs the scale of its disturbance");
  const auto& levels = point.levels;
  if (!(levels.time.minCoeff() > 0 && levels.time_room > 0 && levels.position > 0 && levels.heading > 0))
    throw std::invalid_argument("correlation times and the noise of poses must be positive");
  for (std::size_t run = 0; run < runs_.size(); ++run)
    for (const double level : levelsOf(point, run).values())
      if (!(level >= 0 && std::isfinite(level)))
        throw std::invalid_argument("a level of the disturbance is negative or not finite");
  if (!(cap > 0)) throw std::invalid_argument("the cap of distances must be positive");
}

GreyBoxPoint GreyBox::start(const Model& model) const {
  GreyBoxPoint point{model, prior_.median, {}};
  point.levels.sigma *= 5;
  point.levels.sigma_room *= 10;
  return point;
}

GreyBoxFit GreyBox::fit(const GreyBoxPoint& start, const GreyBoxOptions& options) const {
  check(start, options.cap);
  const auto levels = start.levels.values();
  if (*std::min_element(levels.begin(), levels.end()) == 0)
    throw std::invalid_argument("a fit begins at positive levels of the disturbance");
  if (options.max_iterations < 0) throw std::invalid_argument("a fit has 0 or more iterations");
  std::vector<const RunData*> all;
  for (const RunData& run : runs_) all.push_back(&run);
  requireIdentifiable(options.free, all);
  RunFilters search(runs_, options.threads);
  return maximiseLikelihood(search, prior_, start, options);
}

std::vector<FittedParameter> GreyBox::intervals(const GreyBoxFit& fit, const GreyBoxOptions& options) const {
  if (options.free.empty()) return {};
  const auto runs = static_cast<Eigen::Index>(runs_.size());
  const Eigen::Index count = fit.level_information.rows();  // levels, then the scale of each run
  if (count != kLevels + runs || fit.level_information.cols() != count || !fit.level_information.allFinite())
    throw std::invalid_argument("intervals need a fit of these runs and of their levels");
  check(fit.point, options.cap);
  const std::set<int> held = levelIndices(options.held);
  RunFilters search(runs_, options.threads);
  const Free free = makeFree(fit.point.model, options.free);
  // `away`: change of the levels' logarithms and of the runs' scales.
  const auto at = [&](const Eigen::VectorXd& away) {
    GreyBoxPoint point = fit.point;
    point.levels = fromLogs(logs(point.levels) + away.head<kLevels>());
    point.log_scales.resize(runs_.size(), 0.0);
    for (std::size_t r = 0; r < runs_.size(); ++r)
      point.log_scales[r] += away(kLevels + static_cast<Eigen::Index>(r));
    requireFinite(search.evaluate(point, options.cap));
    return identifiableBy(search.scores(point, free).by_acceleration);
  };
  Eigen::MatrixXd slopes = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(free.index.size()), count);
  Eigen::VectorXd lost = Eigen::VectorXd::Zero(count);
  for (int c = 0; c < count; ++c) {
    constexpr double kStep = 0.3;  // of a logarithm: averages the slope over the likely range
    if (held.count(c)) continue;
    const Eigen::VectorXd away = kStep * Eigen::VectorXd::Unit(count, c);
    const Identifiable more = at(away), less = at(-away);
    slopes.col(c) = (more.variance() - less.variance()) / (2 * kStep);
    lost(c) = (less.log_determinant - more.log_determinant) / (2 * kStep);
  }
  const auto inverse = fit.level_information.ldlt();
  // Fitted levels are biased low, because the parameters also fit part of the disturbance: one
  // Newton step to the maximum of the restricted likelihood (Patterson and Thompson 1971).
  const Eigen::VectorXd away = 0.5 * inverse.solve(lost);
  const Identifiable known = at(away);
  const Eigen::VectorXd variance = known.variance();
  // Satterthwaite (1946): twice the squared variance over the variance of the estimated variance.
  const Eigen::MatrixXd doubt = slopes * inverse.solve(slopes.transpose());
  constexpr double kMinFreedom = 3, kMaxFreedom = 1e6;  // degrees of freedom
  Eigen::VectorXd quantile(variance.size());
  for (Eigen::Index i = 0; i < variance.size(); ++i)
    quantile(i) = quantileOf(
        doubt(i, i) > 0 ? std::clamp(2 * std::pow(variance(i), 2) / doubt(i, i), kMinFreedom, kMaxFreedom)
                        : kMaxFreedom);
  return estimatesOf(fit.point.model, free, startOf(free), deviationsOf(known), quantile);
}

std::vector<Eigen::VectorXd> GreyBox::likelihood(const GreyBoxPoint& point, double cap, double block,
                                                 int threads) const {
  check(point, cap);
  RunFilters search(runs_, threads);
  requireFinite(search.evaluate(point, cap));
  std::vector<Eigen::VectorXd> result;
  for (const DisturbanceFilter& filter : search.filters()) result.push_back(filter.densities(block));
  return result;
}

GreyBoxScores GreyBox::scores(const GreyBoxPoint& point, const std::vector<std::string>& parameters,
                              double cap, double block, int threads) const {
  check(point, cap);
  RunFilters search(runs_, threads);
  const Free free = makeFree(point.model, parameters);
  requireFinite(search.evaluate(point, cap));
  std::vector<RunScores> found(runs_.size());
  inParallel(runs_.size(), threads,
             [&](std::size_t i) { found[i] = search.filters()[i].scores(point.model, free, block); });
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
    result.run.insert(result.run.end(), static_cast<std::size_t>(found[i].score.rows()), static_cast<int>(i));
    result.information += found[i].information;
    rows += found[i].score.rows();
  }
  return result;
}

GreyBoxResiduals GreyBox::residuals(const GreyBoxPoint& point, int run, double cap,
                                    const Eigen::MatrixXd& acting) const {
  const std::size_t at = indexOf(run);
  check(point, cap);
  if (acting.cols() % 3 != 0 ||
      (acting.cols() > 0 && acting.rows() != static_cast<Eigen::Index>(runs_[at].times.size())) ||
      !acting.allFinite())
    throw std::invalid_argument("acting wrenches need a finite row per sample and three columns each");
  DisturbanceFilter filter(runs_[at]);
  requireFinite(filter.run(point.model, levelsOf(point, at), cap));
  const auto count = static_cast<Eigen::Index>(filter.samples().size());
  GreyBoxResiduals result;
  result.whitened = filter.whitened();
  result.states.resize(count, 6);
  for (std::size_t k = 0; k < filter.samples().size(); ++k) {
    const FilterSample& sample = filter.samples()[k];
    result.states.row(static_cast<Eigen::Index>(k)) << sample.filtered.eta.transpose(),
        sample.filtered.nu.transpose();
    result.scored.push_back(!sample.starts);
  }
  result.wrench = filter.wrench();
  result.constants = filter.constantsSoFar();
  if (acting.cols() > 0) result.responses = filter.responses(acting);
  return result;
}

SmoothedWrench GreyBox::smooth(const GreyBoxPoint& point, int run, double cap) const {
  const std::size_t at = indexOf(run);
  check(point, cap);
  return DisturbanceFilter(runs_[at]).smooth(point.model, levelsOf(point, at), cap);
}

std::vector<Forecast> GreyBox::forecast(const GreyBoxPoint& point, int run,
                                        const ForecastOptions& options) const {
  const std::size_t at = indexOf(run);
  const RunData& data = runs_[at];
  checkForecast(options, data.times.size());
  check(point, options.cap);
  DisturbanceFilter filter(data);
  const std::vector<double> about = scalesAbout(options.unknown_scale);
  std::vector<std::vector<Alternative>> alternatives(options.starts.size());
  for (const double more : about) {
    GreyBoxPoint other = point;
    other.log_scales.resize(runs_.size(), 0.0);
    other.log_scales[at] += more;
    const DisturbanceLevels levels = levelsOf(other, at);
    std::vector<FilterBelief> kept(options.starts.size());
    for (std::size_t i = 0; i < kept.size(); ++i) kept[i].sample = options.starts[i];
    requireFinite(filter.run(other.model, levels, options.cap, &kept));
    const double prior = -0.5 * std::pow(more / kScaleDeviation, 2);
    for (std::size_t i = 0; i < kept.size(); ++i)
      alternatives[i].push_back({levels, kept[i], prior + kept[i].log_likelihood});
  }
  std::mt19937_64 random(options.seed);
  Free free = options.free.empty() ? Free() : makeFree(point.model, options.free);
  free.scale = options.scale;
  const std::vector<DrawnModel> models = drawModels(point.model, options, free, random);
  for (auto& possible : alternatives) normaliseWeights(possible);
  // The sensitivity hardly depends on the levels: the most probable ones at the last start serve
  // all alternatives.
  std::vector<FilterBelief> sensitive(options.starts.size());
  for (std::size_t i = 0; i < sensitive.size(); ++i) sensitive[i].sample = options.starts[i];
  if (!options.free.empty() && !alternatives.empty()) {
    const auto& ended = alternatives.back();
    const auto likeliest =
        std::max_element(ended.begin(), ended.end(),
                         [](const Alternative& a, const Alternative& b) { return a.weight < b.weight; });
    requireFinite(filter.run(point.model, likeliest->levels, options.cap));
    filter.scores(point.model, free, 1e9, &sensitive);
  }
  std::vector<Forecast> result;
  for (const auto& possible : alternatives) {
    const auto first = static_cast<std::size_t>(possible.front().belief.sample);
    const double until = data.times[first] + options.horizons[result.size()];
    std::size_t last = filter.lastOfStretch(first);
    while (last > first && data.times[last] > until) --last;
    result.push_back(forecastBy(data, models, possible, sensitive[result.size()].sensitivity,
                                static_cast<int>(last), options, random));
    if (!result.back().mean.allFinite())
      throw std::runtime_error("the model's motion along the recordings is not finite");
  }
  return result;
}

std::size_t GreyBox::indexOf(int run) const {
  if (run < 0 || run >= static_cast<int>(runs_.size())) throw std::invalid_argument("there is no such run");
  return static_cast<std::size_t>(run);
}

}  // namespace ground
