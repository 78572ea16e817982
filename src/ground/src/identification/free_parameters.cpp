#include "free_parameters.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace ground::detail {

namespace {

void addFree(const ParameterInfo& info, int index, double coordinate, double scale, Free& free) {
  const bool reciprocal = info.coordinate == Coordinate::kReciprocal;
  scale = std::max(std::abs(coordinate), scale);
  free.index.push_back(index);
  free.scale.push_back(scale > 0 ? scale : 1.0);
  free.reciprocal.push_back(reciprocal);
  free.lower.push_back(reciprocal ? info.toCoordinate(info.upper) : info.lower);
  free.upper.push_back(reciprocal ? info.toCoordinate(info.lower) : info.upper);
  // The solver needs a closed bound also for an open range, such as that of a mass.
  const bool infinite = reciprocal && free.lower.back() == 0 && !std::isinf(info.neutral);
  if (infinite || free.lower.back() == std::numeric_limits<double>::min())
    free.lower.back() = 1e-6 * free.scale.back();
}

}  // namespace

Free makeFree(const Model& model, const std::vector<std::string>& names) {
  Free free;
  free.base = model.coordinates();
  const auto infos = model.parameters();
  for (const std::string& name : names) {
    const int index = model.index(name);
    if (std::find(free.index.begin(), free.index.end(), index) != free.index.end())
      throw std::invalid_argument("parameter " + name + " is named twice");
    addFree(infos[index], index, free.base[index], infos[index].scale(model.body), free);
  }
  const Eigen::Map<const Eigen::VectorXd> scale(free.scale.data(),
                                                static_cast<Eigen::Index>(free.scale.size()));
  free.prior = scale.asDiagonal() * model.penalty(names) * scale.asDiagonal();
  free.expected = Eigen::VectorXd::Zero(scale.size());
  for (Eigen::Index i = 0; i < scale.size(); ++i) {
    const ParameterInfo& info = infos[free.index[static_cast<std::size_t>(i)]];
    if (free.prior(i, i) > 0) free.expected(i) = info.toCoordinate(info.neutral) / scale(i);
  }
  free.known = free.precision = Eigen::VectorXd::Zero(scale.size());
  return free;
}

void setPriors(const Model& model, const std::vector<ParameterPrior>& priors, Free& free) {
  // Beside a deviation of less than 1e-4, rounding hides what is known of others.
  constexpr double kMostPrecise = 1e8;
  const auto infos = model.parameters();
  for (const ParameterPrior& prior : priors) {
    const int index = model.index(prior.name);
    const auto at = std::find(free.index.begin(), free.index.end(), index);
    if (at == free.index.end())
      throw std::invalid_argument(prior.name + " has a prior, but is not free in this fit");
    if (!(prior.deviation > 0) || !std::isfinite(prior.mean))
      throw std::invalid_argument("the prior of " + prior.name + " needs a deviation above 0");
    const auto i = at - free.index.begin();
    const double scale = free.scale[static_cast<std::size_t>(i)];
    const bool reciprocal = free.reciprocal[static_cast<std::size_t>(i)];
    const double slope = reciprocal ? 1 / (prior.mean * prior.mean) : 1;
    free.known(i) = infos[index].toCoordinate(prior.mean) / scale;
    free.precision(i) = std::min(kMostPrecise, std::pow(scale / (slope * prior.deviation), 2));
  }
}

void keep(const Model& model, const std::vector<std::string>& names, Free& free) {
  for (const std::string& name : names)
    for (std::size_t i = 0; i < free.index.size(); ++i)
      if (free.index[i] == model.index(name)) free.lower[i] = free.upper[i] = free.base[free.index[i]];
}

void requireIdentifiable(const std::vector<std::string>& names, const std::vector<const RunData*>& runs) {
  const auto has = [&names](const char* name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  const auto differ = [&runs](double (*number)(const Payload&)) {
    return std::any_of(runs.begin(), runs.end(), [&](const RunData* run) {
      return number(run->payload) != number(runs.front()->payload);
    });
  };
  if (!has("k") || !has("I_z")) return;
  const char* const remedy =
      "; fix one of them, or record the craft also with a payload of known mass and place, and say so in the "
      "mapping (payload)";
  if (has("m") && !differ([](const Payload& p) { return p.mass; }))
    throw std::invalid_argument(
        std::string("m cannot be free together with k and I_z: motion only identifies k/m, k l/I_z and the "
                    "dampings over m and I_z, because all runs are of the same mass") +
        remedy);
  if (has("l") && !differ([](const Payload& p) { return p.inertia + p.mass * p.place.squaredNorm(); }))
    throw std::invalid_argument(
        std::string("l cannot be free together with k and I_z: motion only identifies k/m, k l/I_z and the "
                    "dampings over m and I_z, because all runs have the same inertia; measure the lever") +
        remedy);
}

std::vector<double> startOf(const Free& free) {
  std::vector<double> scaled;
  for (std::size_t i = 0; i < free.index.size(); ++i)
    scaled.push_back(free.base[free.index[i]] / free.scale[i]);
  return scaled;
}

Model modelAt(const Model& model, const Free& free, const double* scaled) {
  const auto infos = model.parameters();
  const std::vector<double> coordinates = free.coordinates(scaled);
  std::vector<double> values = model.values();
  for (const int i : free.index)
    values[i] = std::clamp(infos[i].fromCoordinate(coordinates[i]), infos[i].lower, infos[i].upper);
  Model result = model;
  result.setValues(values);
  return result;
}

}  // namespace ground::detail
