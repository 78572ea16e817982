// Effects in a model file.
#pragma once

#include "ground/model/model.h"
#include "ground/model/yaml_reader.h"

namespace ground {

/// Adds the effect at a node to a model, whose thrusters are known.
void readEffect(const YamlReader& reader, const YAML::Node& node, Model& model);
void writeEffect(YAML::Emitter& out, const Model::Entry& entry, const ThrusterLayout& layout);

}  // namespace ground
