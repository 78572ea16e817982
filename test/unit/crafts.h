// Crafts that tests change, and what a refusal says.
#pragma once

#include <exception>
#include <string>
#include <utility>
#include <vector>

#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"

namespace ground {

inline Model tinyWhoover() { return loadModel("cfg/hovercraft/tiny_whoover.yaml"); }

/// The model with other values of parameters, such as {"k", 0.1} or {"motor_lag.tau", 0.05}. It gets the
/// effects that it does not have.
inline Model withValues(Model model, const std::vector<std::pair<std::string, double>>& values) {
  for (const auto& [name, value] : values) {
    const std::string effect = name.substr(0, name.find('.'));
    if (effect != name && !model.hasEffect(effect)) model.addEffect(makeEffect(effect, *model.thrusters));
    model.setValue(name, value);
  }
  return model;
}

/// Without damping the speed is what the thrusters have given.
inline Model undamped() { return withValues(tinyWhoover(), {{"X_u", 0}, {"Y_v", 0}, {"N_r", 0}}); }

/// What an exception of act() says; empty without one.
template <class Act>
std::string refusal(const Act& act) {
  try {
    act();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

}  // namespace ground
