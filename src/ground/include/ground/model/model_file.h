#pragma once

#include <string>
#include <vector>

#include "ground/model/model.h"

namespace ground {

/// Reads a model file. Throws std::runtime_error that names file, line, key and allowed range on
/// any unknown, missing, repeated, out-of-range or non-finite entry, and on a craft whose thrusters
/// could not move it (implausibilities). What else is implausible is added to `warnings`, a line
/// each with file, line, key and the probable unit.
Model loadModel(const std::string& path, std::vector<std::string>* warnings = nullptr);
/// The same from YAML text, however implausible; `source` names it in messages.
Model parseModel(const std::string& yaml, const std::string& source);
/// The model with one effect more, of YAML text that has this effect as model files list it (a map,
/// or a list of one). `source` names the text in messages; their lines are those of the text.
/// Throws std::runtime_error on anything wrong with it, and when the model has the effect already.
Model withEffect(Model model, const std::string& yaml, const std::string& source);
/// The text of a file with an effect, for withEffect. Throws std::runtime_error when it cannot be
/// read or is too large for one.
std::string readEffectFile(const std::string& path);
/// The model as commented YAML, with units beside each value; parseModel gives it back.
std::string formatModel(const Model& model);
/// Writes formatModel atomically. Throws std::runtime_error when the file exists and overwrite is
/// false, or when it cannot be written; an existing file is then left as it was.
void saveModel(const Model& model, const std::string& path, bool overwrite = false);

}  // namespace ground
