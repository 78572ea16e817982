#include "ground/model/model.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace ground {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::string effectName(const Model::Entry& entry) { return entry.effect->info().name; }

}  // namespace

const std::vector<ParameterInfo>& bodyParameters() {
  using B = Body<double>;
  const auto entry = [](const char* name, const char* unit, const char* doc, double lower,
                        double B::*member) {
    ParameterInfo info;
    info.name = name;
    info.unit = unit;
    info.doc = doc;
    info.neutral = std::numeric_limits<double>::quiet_NaN();
    info.lower = lower;
    info.upper = kInfinity;
    info.scale = [member](const B& b) { return b.*member; };
    return info;
  };
  const double positive = std::numeric_limits<double>::min();
  // Accelerations are linear in 1/I_z, so fits converge from far away.
  ParameterInfo inertia =
      entry("I_z", "kg m^2", "moment of inertia about the centre of mass", positive, &B::I_z);
  inertia.coordinate = Coordinate::kReciprocal;
  inertia.scale = [](const B& b) { return 1 / b.I_z; };
  static const std::vector<ParameterInfo> infos = {
      entry("m", "kg", "mass", positive, &B::m),
      entry("l", "m", "lever arm of the thrusters", positive, &B::l),
      inertia,
      entry("X_u", "N s/m", "surge damping", 0, &B::X_u),
      entry("Y_v", "N s/m", "sway damping", 0, &B::Y_v),
      entry("N_r", "N m s", "yaw damping", 0, &B::N_r),
      entry("k", "N", "thrust of one thruster per unit input", positive, &B::k)};
  return infos;
}

std::string checkValue(const ParameterInfo& parameter, double value) {
  if (value >= parameter.lower && value <= parameter.upper &&
      (std::isfinite(value) || value == parameter.neutral))
    return "";
  std::ostringstream text;
  text << parameter.name << " = " << value << ' ' << parameter.unit << " is outside ";
  if (parameter.lower == std::numeric_limits<double>::min()) {
    text << "(0, ";
  } else {
    text << '[' << parameter.lower << ", ";
  }
  text << parameter.upper
       << (parameter.upper == parameter.neutral ? "]"
           : std::isinf(parameter.upper)        ? ")"
                                                : "]");
  return text.str();
}

bool Model::Entry::isNeutral() const {
  const auto& all = effect->info().parameters;
  const auto neutral = [](double value, const ParameterInfo& one) { return value == one.neutral; };
  return !all.empty() && std::equal(values.begin(), values.end(), all.begin(), all.end(), neutral);
}

void Model::addEffect(EffectPtr effect) {
  const EffectInfo& info = effect->info();
  if (hasEffect(info.name)) throw std::invalid_argument("the model has effect '" + info.name + "' already");
  if (effects.size() >= kMaxEffects)
    throw std::invalid_argument("a model has at most " + std::to_string(kMaxEffects) + " effects");
  std::vector<double> values;
  for (const ParameterInfo& parameter : info.parameters) values.push_back(parameter.neutral);
  effects.push_back({std::move(effect), std::move(values)});
}

void Model::removeEffect(const std::string& effect) {
  const auto found =
      std::find_if(effects.begin(), effects.end(), [&](const Entry& e) { return effectName(e) == effect; });
  if (found == effects.end()) throw std::invalid_argument("the model has no effect '" + effect + "'");
  effects.erase(found);
}

bool Model::hasEffect(const std::string& effect) const {
  return std::any_of(effects.begin(), effects.end(), [&](const Entry& e) { return effectName(e) == effect; });
}

std::vector<ParameterInfo> Model::parameters() const {
  std::vector<ParameterInfo> all = bodyParameters();
  for (const Entry& entry : effects) {
    for (ParameterInfo parameter : entry.effect->info().parameters) {
      parameter.name = effectName(entry) + '.' + parameter.name;
      all.push_back(std::move(parameter));
    }
  }
  return all;
}

int Model::index(const std::string& parameter) const {
  const std::vector<ParameterInfo> all = parameters();
  std::ostringstream known;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].name == parameter) return static_cast<int>(i);
    known << ' ' << all[i].name;
  }
  throw std::invalid_argument("the model has no parameter '" + parameter + "'; it has" + known.str());
}

std::vector<double> Model::values() const {
  std::vector<double> all = {body.m, body.l, body.I_z, body.X_u, body.Y_v, body.N_r, body.k};
  for (const Entry& entry : effects) all.insert(all.end(), entry.values.begin(), entry.values.end());
  return all;
}

void Model::setValues(const std::vector<double>& all) {
  const std::vector<ParameterInfo> infos = parameters();
  if (all.size() != infos.size())
    throw std::invalid_argument("expected " + std::to_string(infos.size()) + " parameters, got " +
                                std::to_string(all.size()));
  for (std::size_t i = 0; i < all.size(); ++i) {
    const std::string wrong = checkValue(infos[i], all[i]);
    if (!wrong.empty()) throw std::invalid_argument(wrong);
  }
  auto next = all.begin();
  for (double* value : {&body.m, &body.l, &body.I_z, &body.X_u, &body.Y_v, &body.N_r, &body.k})
    *value = *next++;
  for (Entry& entry : effects)
    for (double& value : entry.values) value = *next++;
}

double Model::value(const std::string& parameter) const { return values()[index(parameter)]; }

void Model::setValue(const std::string& parameter, double value) {
  std::vector<double> all = values();
  all[index(parameter)] = value;
  setValues(all);
}

std::vector<double> Model::coordinates() const {
  const std::vector<ParameterInfo> infos = parameters();
  std::vector<double> all = values();
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = infos[i].toCoordinate(all[i]);
  return all;
}

Eigen::MatrixXd Model::penalty(const std::vector<std::string>& names) const {
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(parameterCount(), parameterCount());
  auto first = static_cast<Eigen::Index>(bodyParameters().size());
  for (const Entry& entry : effects) {
    const EffectInfo& info = entry.effect->info();
    const auto count = static_cast<Eigen::Index>(info.parameters.size());
    if (info.penalty) all.block(first, first, count, count) = info.penalty(body);
    first += count;
  }
  std::vector<int> places;
  places.reserve(names.size());
  for (const std::string& wanted : names) places.push_back(index(wanted));
  return all(places, places);
}

int Model::parameterCount() const { return static_cast<int>(values().size()); }

int Model::stateCount() const {
  int count = 0;
  for (const Entry& entry : effects) count += entry.effect->info().stateCount(thrusters->size());
  return count;
}

}  // namespace ground
