#include "ground/model/craft_change.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "ground/model/effect_registry.h"

namespace ground {
namespace {

constexpr double kDeadThruster = -0.98;  // keeps the model's shares of thrust defined

constexpr double kWorthTaking = 0.04;  // smallest difference that a controller takes

/// The effect by which a channel does less or more.
std::string gainOf(const Thruster& one) {
  const bool foil = one.kind == Thruster::Kind::kFoil;
  return (foil ? "foil_gain_" : one.isAngle() ? "angle_gain_" : "thruster_gain_") + one.name;
}

}  // namespace

CraftChange::CraftChange(const Model& model) : model_(model) {
  const auto require = [&](const std::string& effect) {
    if (!model_.hasEffect(effect)) model_.addEffect(makeEffect(effect, *model_.thrusters));
    return effect;
  };
  const ThrusterLayout& layout = *model.thrusters;
  for (int i = 0; i < layout.size(); ++i) {
    parameters_.push_back({"thruster_" + layout[i].name, kDeadThruster, 0.5, true});
    if (layout.isPair()) continue;
    if (layout.forces() == 1 && layout.pushes(i)) {
      terms_.push_back({Term::kScaled, i, model_.index("k")});
      continue;
    }
    const std::string effect = require(gainOf(layout[i]));
    terms_.push_back({Term::kGain, i, model_.index(effect + ".a")});
  }
  thrust_ = model_.index("k");
  if (layout.isPair()) pair_ = model_.index(require("thrust_asymmetry") + ".a");
  require("com_offset");
  const double lever = model.body.l;
  parameters_.insert(parameters_.end(), {{"mass", -0.5, 1, true},
                                         {"inertia", -0.5, 2, true},
                                         {"centre_x", -lever, lever, false},
                                         {"centre_y", -lever, lever, false},
                                         {"drag", -0.9, 5, true}});
  terms_.push_back({Term::kScaled, mass(), model_.index("m")});
  terms_.push_back({Term::kDivided, inertia(), model_.index("I_z")});  // its coordinate is 1/I_z
  terms_.push_back({Term::kAdded, centre(), model_.index("com_offset.xg")});
  terms_.push_back({Term::kAdded, centre() + 1, model_.index("com_offset.yg")});
  for (const char* damping : {"X_u", "Y_v", "N_r"})
    terms_.push_back({Term::kScaled, drag(), model_.index(damping)});
  for (const char* effect : {"quadratic_drag", "momentum_drag", "sway_yaw_damping"}) scale(effect, drag());
  base_ = model_.coordinates();
}

/// All parameters of an effect, if the model has it, grow with a parameter of the change.
void CraftChange::scale(const std::string& effect, int parameter) {
  int coordinate = static_cast<int>(bodyParameters().size());
  for (const Model::Entry& entry : model_.effects) {
    const EffectInfo& info = entry.effect->info();
    for (std::size_t i = 0; i < info.parameters.size(); ++i, ++coordinate)
      if (info.name == effect) terms_.push_back({Term::kScaled, parameter, coordinate});
  }
}

Eigen::VectorXd CraftChange::bounded(Eigen::VectorXd change) const {
  if (change.size() != size()) throw std::invalid_argument("a change of another craft");
  for (int i = 0; i < size(); ++i) {
    const Parameter& parameter = parameters_[static_cast<std::size_t>(i)];
    change(i) = std::isfinite(change(i)) ? std::clamp(change(i), parameter.least, parameter.most) : 0;
  }
  return change;
}

bool CraftChange::differ(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const {
  for (int i = 0; i < size(); ++i) {
    const double unit = parameters_[static_cast<std::size_t>(i)].relative ? 1 : model_.body.l;
    if (std::abs(a(i) - b(i)) > kWorthTaking * unit) return true;
  }
  return false;
}

Model CraftChange::apply(const Eigen::VectorXd& change) const {
  const Eigen::VectorXd taken = bounded(change);
  std::vector<double> values = coordinates(std::vector<double>(taken.data(), taken.data() + taken.size()));
  const std::vector<ParameterInfo> infos = model_.parameters();
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = std::clamp(infos[i].fromCoordinate(values[i]), infos[i].lower, infos[i].upper);
  Model changed = model_;
  changed.setValues(values);
  return changed;
}

}  // namespace ground
