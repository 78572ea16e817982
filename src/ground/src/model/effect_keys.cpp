#include "effect_keys.h"

#include <cmath>
#include <stdexcept>

#include "ground/model/effect_registry.h"
#include "ground/model/expression_effect.h"
#include "ground/model/shortened.h"
#include "ground/model/yaml_keys.h"

namespace ground {

static YamlKeys keysOf(const YamlReader& reader, ExpressionDefinition::State& state) {
  YamlKeys keys(reader, "state " + shortened(state.name), true);
  keys.value("derivative", state.rate);
  keys.value("initial", state.initial);
  return keys;
}

namespace {

YamlKeys parameterKeys(const YamlReader& reader, ParameterInfo& info, double& value, double& scale) {
  YamlKeys keys(reader, "parameter " + shortened(info.name), true);
  keys.value("value", value).required("").read = [name = info.name, &value, reader](const YAML::Node& node) {
    value = reader.number(node, name);
  };
  keys.value("unit", info.unit).required("");
  keys.value("doc", info.doc).silentIf(info.doc.empty());
  keys.value("neutral", info.neutral);
  keys.value("lower", info.lower).silentIf(std::isinf(info.lower));
  keys.value("upper", info.upper).silentIf(std::isinf(info.upper));
  keys.value("scale", scale);
  return keys;
}

void readParameter(const YamlReader& reader, const std::string& name, const YAML::Node& node,
                   ExpressionDefinition& definition, std::vector<double>& values) {
  ParameterInfo info;
  info.name = name;
  double value = 0, scale = NAN;
  parameterKeys(reader, info, value, scale).read(node);
  const std::string neutral = checkValue(info, info.neutral), wrong = checkValue(info, value);
  if (!neutral.empty()) reader.fail(node, "neutral value of " + neutral);
  if (!wrong.empty()) reader.fail(node, wrong);
  if (std::isnan(scale)) scale = value != info.neutral ? std::abs(value - info.neutral) : 1;
  if (!(scale > 0) || std::isinf(scale)) reader.fail(node, "scale must be positive");
  definition.parameters.push_back(info);
  definition.typical.push_back(scale);
  values.push_back(value);
}

/// Formulas of the components; those of a left and a right thruster are also named thrust_L and thrust_R.
YamlKeys componentKeys(const YamlReader& reader, const ThrusterLayout& layout,
                       ExpressionDefinition& definition) {
  YamlKeys keys(reader, "expression of " + shortened(definition.name));
  keys.value("X", definition.X).silentIf(definition.X.empty());
  keys.value("Y", definition.Y).silentIf(definition.Y.empty());
  keys.value("N", definition.N).silentIf(definition.N.empty());
  for (const Thruster& one : layout.thrusters()) {
    if (one.isAngle()) continue;
    std::string& formula = definition.thrusts[one.name];
    if (layout.isPair()) keys.value(one.name == "left" ? "thrust_L" : "thrust_R", formula).silentIf(true);
    keys.value("thrust_" + one.name, formula).silentIf(formula.empty());
  }
  return keys;
}

YamlKeys expressionKeys(const YamlReader& reader, const ThrusterLayout& layout,
                        ExpressionDefinition& definition, std::vector<double>& values) {
  YamlKeys keys(reader, "effect " + shortened(definition.name));
  keys.word("name", definition.name);
  keys.map("expression", componentKeys(reader, layout, definition));
  keys.choice("frame", "body", "world", definition.world).silentIf(!definition.world);
  const auto read_state = [&, reader](const std::string& name, const YAML::Node& node) {
    ExpressionDefinition::State& state = definition.states.emplace_back();
    state.name = name;
    if (node.IsMap())
      keysOf(reader, state).read(node);
    else
      state.rate = reader.text(node, shortened(name));
  };
  const auto write_states = [&](YAML::Emitter& out) {
    out << YAML::BeginMap;
    for (const ExpressionDefinition::State& state : definition.states) {
      out << YAML::Key << state.name << YAML::Value;
      if (state.initial == 0)
        writeValue(out, state.rate);
      else
        writeValue(out, state);
    }
    out << YAML::EndMap;
  };
  const auto read_parameter = [&, reader](const std::string& name, const YAML::Node& node) {
    readParameter(reader, name, node, definition, values);
  };
  const auto write_parameters = [&, reader](YAML::Emitter& out) {
    out << YAML::BeginMap;
    for (std::size_t i = 0; i < values.size(); ++i) {
      out << YAML::Key << definition.parameters[i].name << YAML::Value;
      parameterKeys(reader, definition.parameters[i], values[i], definition.typical[i]).write(out);
    }
    out << YAML::EndMap;
  };
  const auto each = [&](const std::string& name, const YamlReader::Visit& visit) {
    return [=](const YAML::Node& node) { reader.each(node, name, visit); };
  };
  keys.add("states", each("states", read_state), write_states).silentIf(definition.states.empty());
  keys.add("parameters", each("parameters", read_parameter), write_parameters).silentIf(values.empty());
  return keys;
}

/// An effect of the library.
YamlKeys libraryKeys(const YamlReader& reader, const EffectInfo& info, std::string& name,
                     std::vector<double>& values) {
  YamlKeys keys(reader, "effect " + info.name);
  keys.word("name", name).comment(info.summary);
  for (std::size_t i = 0; i < values.size(); ++i) keys.parameter(info.parameters[i], values[i]);
  return keys;
}

}  // namespace

void readEffect(const YamlReader& reader, const YAML::Node& node, Model& model) {
  if (!node.IsMap() || !node["name"]) reader.fail(node, "an effect must be a map with its name");
  std::string name = reader.text(node["name"], "name");
  const ThrusterLayout& layout = *model.thrusters;
  try {
    if (node["expression"]) {
      ExpressionDefinition definition;
      definition.name = name;
      std::vector<double> values;
      expressionKeys(reader, layout, definition, values).read(node);
      model.addEffect(makeExpressionEffect(definition, layout));
      requireFiniteRates(*model.effects.back().effect, values);
      model.effects.back().values = values;
      return;
    }
    if (node["terms"] || name == "learned_wrench")
      reader.fail(node,
                  "learned wrenches ended with release 1: write a formula (expression: {X: ...}) instead");
    model.addEffect(makeEffect(name, layout));
    Model::Entry& entry = model.effects.back();
    libraryKeys(reader, entry.effect->info(), name, entry.values).read(node);
  } catch (const std::invalid_argument& error) {
    reader.fail(node, error.what());
  }
}

void writeEffect(YAML::Emitter& out, const Model::Entry& entry, const ThrusterLayout& layout) {
  const YamlReader reader("");
  std::vector<double> values = entry.values;
  if (const ExpressionDefinition* given = expressionDefinition(*entry.effect)) {
    ExpressionDefinition definition = *given;
    return expressionKeys(reader, layout, definition, values).write(out);
  }
  std::string name = entry.effect->info().name;
  libraryKeys(reader, entry.effect->info(), name, values).write(out);
}

}  // namespace ground
