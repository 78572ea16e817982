#pragma once

#include <string>
#include <vector>

#include "ground/model/model.h"

namespace ground {

/// Reads a model file. Throws std::runtime_error that names file, line, key and allowed range on
/// any unknown, missing, repeated, out-of-range or non-finite entry, and on a craft whose thrusters
/// could not move it (implausibilities). Each other implausible value adds a line with file, line,
/// key and probable unit to `warnings`.
Model loadModel(const std::string& path, std::vector<std::string>* warnings = nullptr);
/// Like loadModel from YAML text, without checks of plausibility; `source` names it in messages.
Model parseModel(const std::string& yaml, const std::string& source);
/// Adds an effect to a model. `yaml` is the effect as in a model file (a map, or a list with one
/// map); `source` names it in messages. Throws std::runtime_error if the text is invalid or the
/// model already has the effect.
Model withEffect(Model model, const std::string& yaml, const std::string& source);
/// The text of a file with an effect, for withEffect. Throws std::runtime_error if the file cannot
/// be read or is too large.
std::string readEffectFile(const std::string& path);
/// The model as commented YAML, with units beside each value; parseModel gives it back.
std::string formatModel(const Model& model);

}  // namespace ground
