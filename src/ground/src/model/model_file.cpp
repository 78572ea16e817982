#include "ground/model/model_file.h"

#include <fcntl.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <map>
#include <sstream>
#include <stdexcept>

#include "ground/model/effect_registry.h"
#include "ground/model/expression_effect.h"
#include "ground/model/learned_wrench.h"
#include "ground/model/plausibility.h"
#include "ground/model/shortened.h"
#include "ground/model/text_file.h"
#include "yaml_reader.h"

namespace ground {
namespace {

constexpr char kSchema[] = "ground/model/1";
constexpr std::size_t kLargestFile = 1000000;  // [bytes]; a typical model has some thousand

ParameterInfo inputMaxInfo() {
  ParameterInfo info;
  info.name = "input_max";
  info.unit = "-";
  info.lower = std::numeric_limits<double>::min();
  info.neutral = 1;
  return info;
}

std::string names(const std::vector<ParameterInfo>& parameters) {
  std::string list;
  for (const ParameterInfo& parameter : parameters) list += parameter.name + ", ";
  return list;
}

/// Line of each value of the body in its file, counted from 1.
using BodyLines = std::map<std::string, int>;

/// Numbers in a list of so many.
std::vector<double> readNumbers(const YamlReader& reader, const YAML::Node& node, const std::string& what,
                                std::size_t count) {
  if (!node.IsSequence() || node.size() != count)
    reader.fail(node, what + " must be a list of " + std::to_string(count) + " numbers");
  std::vector<double> numbers;
  for (const auto& one : node) numbers.push_back(reader.number(one, what));
  return numbers;
}

ForceCurve readCurve(const YamlReader& reader, const YAML::Node& node, const std::string& what) {
  ForceCurve curve;
  bool power = false;
  reader.each(node, what, [&](const std::string& key, const YAML::Node& value) {
    if (key == "power") {
      curve.power = reader.number(value, key);
      power = true;
    } else if (key == "table") {
      if (!value.IsSequence())
        reader.fail(value, "table must be a list of [input, force over that at input 1]");
      for (const auto& row : value) {
        const std::vector<double> pair = readNumbers(reader, row, "a row of table", 2);
        curve.table.push_back({pair[0], pair[1]});
      }
    } else {
      reader.unknown(value, key, what, "power, table");
    }
  });
  if (power == !curve.table.empty()) reader.fail(node, what + " must have either power or table");
  return curve;
}

Thruster readThruster(const YamlReader& reader, const YAML::Node& node) {
  Thruster one;
  bool has_position = false, has_direction = false;
  const std::string what = "a thruster";
  reader.each(node, what, [&](const std::string& key, const YAML::Node& value) {
    if (key == "name") {
      one.name = reader.text(value, key);
    } else if (key == "position") {
      const std::vector<double> place = readNumbers(reader, value, key, 2);
      one.position = {place[0], place[1]};
      has_position = true;
    } else if (key == "direction") {
      one.direction = reader.number(value, key);
      has_direction = true;
    } else if (key == "channel") {
      one.channel = reader.text(value, key);
    } else if (key == "range") {
      const std::vector<double> range = readNumbers(reader, value, key, 2);
      one.least = range[0];
      one.most = range[1];
    } else if (key == "gain") {
      one.gain = reader.number(value, key);
    } else if (key == "curve") {
      one.curve = readCurve(reader, value, "the curve of a thruster");
    } else {
      reader.unknown(value, key, what, "name, position, direction, channel, range, gain, curve");
    }
  });
  if (one.name.empty()) reader.fail(node, "a thruster has no name");
  if (!has_position)
    reader.fail(node, "thruster " + shortened(one.name) + " has no position ([forward, to starboard] in m)");
  if (!has_direction)
    reader.fail(node, "thruster " + shortened(one.name) +
                          " has no direction (of its force in degrees: 0 forward, 90 starboard)");
  if (one.channel.empty()) one.channel = one.name;
  try {
    validate(one);
  } catch (const std::invalid_argument& error) {
    reader.fail(node, error.what());
  }
  return one;
}

std::string readLift(const YamlReader& reader, const YAML::Node& node) {
  std::string channel = "lift";
  reader.each(node, "lift", [&](const std::string& key, const YAML::Node& value) {
    if (key != "channel") reader.unknown(value, key, "lift", "channel");
    channel = reader.text(value, key);
  });
  return channel;
}

/// The thrusters that a body lists; those of the short form when it lists none.
ThrusterLayoutPtr readThrusters(const YamlReader& reader, const YAML::Node& body) {
  const YAML::Node list = body["thrusters"];
  if (!list) {
    if (body["lift"]) reader.fail(body["lift"], "lift needs a list of thrusters beside it");
    return thrusterPair();
  }
  if (!list.IsSequence()) reader.fail(list, "thrusters must be a list");
  for (const char* key : {"l", "input_max"})
    if (body[key])
      reader.fail(body[key], std::string("a body with thrusters has no ") + key +
                                 ": positions and ranges of the thrusters say it");
  std::vector<Thruster> thrusters;
  for (const auto& one : list) thrusters.push_back(readThruster(reader, one));
  try {
    return std::make_shared<const ThrusterLayout>(std::move(thrusters),
                                                  body["lift"] ? readLift(reader, body["lift"]) : "lift");
  } catch (const std::invalid_argument& error) {
    reader.fail(list, error.what());
  }
}

void readBody(const YamlReader& reader, const YAML::Node& node, Model& model, BodyLines& lines) {
  if (!node.IsMap()) reader.fail(node, "body must be a map of key: value");
  model.thrusters = readThrusters(reader, node);
  std::vector<double> values(bodyParameters().size(), NAN);
  bool has_input_max = !model.thrusters->isPair();
  if (has_input_max) {
    values[1] = model.thrusters->lever();
    lines["l"] = lines["input_max"] = node["thrusters"].Mark().line + 1;
  }
  reader.each(node, "body", [&](const std::string& key, const YAML::Node& value) {
    if (key == "thrusters" || key == "lift") return;
    lines[key] = value.Mark().line + 1;
    if (key == "input_max") {
      model.body.input_max = reader.number(value, inputMaxInfo());
      has_input_max = true;
      return;
    }
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (bodyParameters()[i].name != key) continue;
      values[i] = reader.number(value, bodyParameters()[i]);
      return;
    }
    reader.unknown(value, key, "body", names(bodyParameters()) + "input_max, thrusters, lift");
  });
  for (std::size_t i = 0; i < values.size(); ++i)
    if (std::isnan(values[i]))
      reader.fail(node, "body has no " + bodyParameters()[i].name + " (" + bodyParameters()[i].doc + ", " +
                            bodyParameters()[i].unit + ")");
  if (!has_input_max) reader.fail(node, "body has no input_max (largest input of a thruster)");
  model.setValues(values);
}

ParameterInfo readExpressionParameter(const YamlReader& reader, const std::string& name,
                                      const YAML::Node& node, double& value, double& scale) {
  ParameterInfo info;
  info.name = name;
  bool has_value = false;
  scale = NAN;
  reader.each(node, "parameter " + name, [&](const std::string& key, const YAML::Node& entry) {
    if (key == "value") {
      value = reader.number(entry, name);
      has_value = true;
    } else if (key == "unit") {
      info.unit = reader.text(entry, key);
    } else if (key == "doc") {
      info.doc = reader.text(entry, key);
    } else if (key == "neutral") {
      info.neutral = reader.number(entry, key);
    } else if (key == "lower") {
      info.lower = reader.number(entry, key);
    } else if (key == "upper") {
      info.upper = reader.number(entry, key);
    } else if (key == "scale") {
      scale = reader.number(entry, key);
      if (!(scale > 0) || std::isinf(scale)) reader.fail(entry, "scale must be positive");
    } else {
      reader.unknown(entry, key, "parameter " + name, "value, unit, doc, neutral, lower, upper, scale");
    }
  });
  if (!has_value) reader.fail(node, "parameter " + name + " has no value");
  if (info.unit.empty()) reader.fail(node, "parameter " + name + " has no unit");
  const std::string wrong = checkValue(info, info.neutral);
  if (!wrong.empty()) reader.fail(node, "neutral value of " + wrong);
  if (std::isnan(scale)) {
    const double away = std::abs(value - info.neutral);
    scale = away > 0 ? away : 1.0;
  }
  return info;
}

/// Reads the formulas of an effect's components. Crafts that list their thrusters have thrust_NAME in
/// place of thrust_L and thrust_R.
void readComponents(const YamlReader& reader, const YAML::Node& node, const ThrusterLayout& layout,
                    ExpressionDefinition& definition) {
  std::string allowed = "X, Y, N";
  if (layout.isPair()) allowed += ", thrust_L, thrust_R";
  for (const Thruster& one : layout.thrusters()) allowed += ", thrust_" + one.name;
  const std::string what = "expression of " + definition.name;
  reader.each(node, what, [&](const std::string& key, const YAML::Node& value) {
    const std::pair<const char*, std::string*> known[] = {{"X", &definition.X},
                                                          {"Y", &definition.Y},
                                                          {"N", &definition.N},
                                                          {"thrust_L", &definition.thrust_L},
                                                          {"thrust_R", &definition.thrust_R}};
    for (const auto& [name, formula] : known)
      if (key == name && (layout.isPair() || key.size() == 1)) {
        *formula = reader.text(value, key);
        return;
      }
    for (const Thruster& one : layout.thrusters())
      if (key == "thrust_" + one.name) {
        definition.thrusts.emplace_back(one.name, reader.text(value, key));
        return;
      }
    reader.unknown(value, key, what, allowed);
  });
}

/// Reads a state: the formula of its derivative, or a map with that formula and the initial value.
ExpressionDefinition::State readState(const YamlReader& reader, const std::string& name,
                                      const YAML::Node& node) {
  if (!node.IsMap()) return {name, reader.text(node, name), 0};
  ExpressionDefinition::State state{name, "", 0};
  const std::string what = "state " + shortened(name);
  reader.each(node, what, [&](const std::string& key, const YAML::Node& value) {
    if (key == "derivative") {
      state.rate = reader.text(value, key);
    } else if (key == "initial") {
      state.initial = reader.number(value, key);
    } else {
      reader.unknown(value, key, what, "derivative, initial");
    }
  });
  return state;
}

/// Whether the axes of X and Y are those of the world.
bool readFrame(const YamlReader& reader, const YAML::Node& node) {
  const std::string frame = reader.text(node, "frame");
  if (frame != "world" && frame != "body")
    reader.fail(node, "frame must be world or body, not '" + shortened(frame) + "'");
  return frame == "world";
}

void readExpression(const YamlReader& reader, const std::string& name, const YAML::Node& node, Model& model) {
  ExpressionDefinition definition;
  definition.name = name;
  std::vector<double> values;
  reader.each(node, "effect " + name, [&](const std::string& key, const YAML::Node& value) {
    if (key == "expression") {
      readComponents(reader, value, *model.thrusters, definition);
    } else if (key == "frame") {
      definition.world = readFrame(reader, value);
    } else if (key == "states") {
      reader.each(value, "states of " + name, [&](const std::string& state, const YAML::Node& n) {
        definition.states.push_back(readState(reader, state, n));
      });
    } else if (key == "parameters") {
      reader.each(value, "parameters of " + name, [&](const std::string& p, const YAML::Node& n) {
        if (p.size() > kLongestName)
          reader.fail(n, "a parameter's name is longer than " + std::to_string(kLongestName) + " characters");
        double number = 0, scale = 0;
        definition.parameters.push_back(readExpressionParameter(reader, p, n, number, scale));
        definition.typical.push_back(scale);
        values.push_back(number);
        const std::string wrong = checkValue(definition.parameters.back(), number);
        if (!wrong.empty()) reader.fail(n, wrong);
      });
    } else if (key != "name") {
      reader.unknown(value, key, "effect " + name, "name, expression, frame, states, parameters");
    }
  });
  try {
    model.addEffect(makeExpressionEffect(definition, *model.thrusters));
    requireFiniteRates(*model.effects.back().effect, values);
  } catch (const std::invalid_argument& error) {
    reader.fail(node, error.what());
  }
  model.effects.back().values = values;
}

/// Reads the values of an effect's parameters. The effect may have one other key than its name.
void readParameters(const YamlReader& reader, const YAML::Node& node, Model::Entry& entry,
                    const std::string& other = "name") {
  const EffectInfo& info = entry.effect->info();
  const auto& parameters = info.parameters;
  std::vector<bool> given(parameters.size(), false);
  reader.each(node, "effect " + info.name, [&](const std::string& key, const YAML::Node& value) {
    if (key == "name" || key == other) return;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
      if (parameters[i].name != key) continue;
      entry.values[i] = reader.number(value, parameters[i]);
      given[i] = true;
      return;
    }
    reader.unknown(value, key, "effect " + info.name,
                   names(parameters) + (other == "name" ? "" : other + ", ") + "name");
  });
  for (std::size_t i = 0; i < given.size(); ++i)
    if (!given[i])
      reader.fail(node, "effect " + info.name + " has no " + parameters[i].name + " (" + parameters[i].doc +
                            ", " + parameters[i].unit + ")");
}

/// Reads rows of so many numbers.
Eigen::MatrixXd readRows(const YamlReader& reader, const YAML::Node& node, const std::string& what,
                         std::size_t columns) {
  if (!node.IsSequence()) reader.fail(node, what + " must be a list");
  if (node.size() > kMaxCentres)
    reader.fail(node, what + " has more than " + std::to_string(kMaxCentres) + " rows");
  Eigen::MatrixXd rows(node.size(), columns);
  Eigen::Index next = 0;
  for (const auto& row : node)
    rows.row(next++) = Eigen::RowVectorXd::Map(readNumbers(reader, row, "a row of " + what, columns).data(),
                                               static_cast<Eigen::Index>(columns));
  return rows;
}

LearnedTerm readTerm(const YamlReader& reader, const YAML::Node& node, const ThrusterLayout& layout) {
  const std::string what = "a term of a learned wrench";
  std::map<std::string, YAML::Node> given;
  reader.each(node, what, [&](const std::string& key, const YAML::Node& value) {
    for (const char* known : {"arguments", "widths", "frame", "centres", "weights"})
      if (key == known) given[key] = value;
    if (!given.count(key)) reader.unknown(value, key, what, "arguments, widths, frame, centres, weights");
  });
  for (const char* key : {"arguments", "widths", "centres", "weights"})
    if (!given.count(key)) reader.fail(node, what + " has no " + key);
  LearnedTerm term;
  if (!given["arguments"].IsSequence() || given["arguments"].size() == 0 ||
      given["arguments"].size() > kMaxArguments)
    reader.fail(given["arguments"], "arguments must be a list of one to " + std::to_string(kMaxArguments) +
                                        " names, such as [x, y]");
  for (const auto& name : given["arguments"]) term.arguments.push_back(reader.text(name, "an argument"));
  const std::size_t arguments = term.arguments.size();
  term.widths = readNumbers(reader, given["widths"], "widths", arguments);
  if (given.count("frame")) term.world = readFrame(reader, given["frame"]);
  term.centres = readRows(reader, given["centres"], "centres", arguments);
  const auto centres = static_cast<std::size_t>(term.centres.rows());
  reader.each(given["weights"], "weights", [&](const std::string& key, const YAML::Node& value) {
    const std::size_t channel = std::string("XYN").find(key);
    if (key.size() != 1 || channel == std::string::npos) reader.unknown(value, key, "weights", "X, Y, N");
    term.weights[channel] = readNumbers(reader, value, "weights " + key + " (one for each centre)", centres);
  });
  try {
    validate(term, layout);
  } catch (const std::invalid_argument& error) {
    reader.fail(node, error.what());
  }
  return term;
}

void readLearnedWrench(const YamlReader& reader, const std::string& name, const YAML::Node& node,
                       Model& model) {
  LearnedWrench definition{name, {}};
  const YAML::Node terms = node["terms"];
  if (!terms || !terms.IsSequence()) reader.fail(node, "effect " + name + " must have a list of terms");
  for (const auto& term : terms) definition.terms.push_back(readTerm(reader, term, *model.thrusters));
  try {
    model.addEffect(makeLearnedWrench(definition, *model.thrusters));
  } catch (const std::invalid_argument& error) {
    reader.fail(node, error.what());
  }
  readParameters(reader, node, model.effects.back(), "terms");
}

void readEffect(const YamlReader& reader, const YAML::Node& node, Model& model) {
  if (!node.IsMap() || !node["name"]) reader.fail(node, "an effect must be a map with its name");
  const std::string name = reader.text(node["name"], "name");
  if (name.size() > kLongestName)
    reader.fail(node, "the effect's name is longer than " + std::to_string(kLongestName) + " characters");
  if (node["expression"]) return readExpression(reader, name, node, model);
  if (node["terms"] || name == LearnedWrench().name) return readLearnedWrench(reader, name, node, model);
  try {
    model.addEffect(makeEffect(name, *model.thrusters));
  } catch (const std::invalid_argument& error) {
    reader.fail(node, error.what());
  }
  readParameters(reader, node, model.effects.back());
}

/// Reads numbers by channel; missing ones stay zero. `thrust`: if not null, "thrust" is a channel.
void readChannels(const YamlReader& reader, const std::string& what, const YAML::Node& node,
                  Vector3<double>& channels, double* thrust = nullptr) {
  reader.each(node, what, [&](const std::string& key, const YAML::Node& value) {
    const std::size_t channel = std::string("XYN").find(key);
    if (key.size() == 1 && channel != std::string::npos) {
      channels(static_cast<Eigen::Index>(channel)) = reader.number(value, key);
    } else if (thrust && key == "thrust") {
      *thrust = reader.number(value, key);
    } else {
      reader.unknown(value, key, what, thrust ? "X, Y, N, thrust" : "X, Y, N");
    }
  });
}

void readDisturbance(const YamlReader& reader, const YAML::Node& node, Disturbance& disturbance) {
  reader.each(node, "disturbance", [&](const std::string& key, const YAML::Node& value) {
    const std::string what = key + " of disturbance";
    if (key == "sigma") {
      readChannels(reader, what, value, disturbance.sigma);
    } else if (key == "time") {
      readChannels(reader, what, value, disturbance.time);
    } else if (key == "white") {
      readChannels(reader, what, value, disturbance.white);
    } else if (key == "trim") {
      readChannels(reader, what, value, disturbance.trim, &disturbance.trim_thrust);
    } else {
      reader.unknown(value, key, "disturbance", "sigma, time, white, trim");
    }
  });
  const std::string wrong = disturbance.validate();
  if (!wrong.empty()) reader.fail(node, "disturbance: " + wrong);
}

void readProvenance(const YamlReader& reader, const YAML::Node& node, Provenance& provenance) {
  const auto numbers = [&](const YAML::Node& map, const std::string& what) {
    std::map<std::string, double> result;
    reader.each(map, what, [&](const std::string& key, const YAML::Node& value) {
      result[key] = reader.number(value, key);
    });
    return result;
  };
  const auto texts = [&](const YAML::Node& list, const std::string& what) {
    if (!list.IsSequence()) reader.fail(list, what + " must be a list");
    std::vector<std::string> result;
    for (const auto& item : list) result.push_back(reader.text(item, what));
    return result;
  };
  reader.each(node, "provenance", [&](const std::string& key, const YAML::Node& value) {
    if (key == "date") {
      provenance.date = reader.text(value, key);
    } else if (key == "command") {
      provenance.command = reader.text(value, key);
    } else if (key == "bags") {
      provenance.bags = texts(value, key);
    } else if (key == "digests") {
      provenance.digests = texts(value, key);
    } else if (key == "error_before") {
      provenance.error_before = numbers(value, key);
    } else if (key == "error_after") {
      provenance.error_after = numbers(value, key);
    } else if (key == "confidence_95") {
      reader.each(value, key, [&](const std::string& parameter, const YAML::Node& interval) {
        if (!interval.IsSequence() || interval.size() != 2)
          reader.fail(interval, parameter + " must be [lower, upper]");
        provenance.confidence_95[parameter] = {reader.number(interval[0], parameter),
                                               reader.number(interval[1], parameter)};
      });
    } else if (key == "not_identified") {
      provenance.not_identified = texts(value, key);
    } else {
      reader.unknown(value, key, "provenance",
                     "date, command, bags, digests, error_before, error_after, confidence_95, "
                     "not_identified");
    }
  });
  if (!provenance.digests.empty() && provenance.digests.size() != provenance.bags.size())
    reader.fail(node, "provenance must have one digest for each of its bags, or none");
}

/// Shortest text that parses as the same number.
std::string format(double value) {
  if (std::isinf(value)) return value > 0 ? ".inf" : "-.inf";
  for (int digits = 6;; ++digits) {
    std::ostringstream text;
    text.precision(digits);
    text << value;
    if (digits >= 17 || std::strtod(text.str().c_str(), nullptr) == value) return text.str();
  }
}

void emitNumber(YAML::Emitter& out, const std::string& key, double value, const std::string& comment) {
  out << YAML::Key << key << YAML::Value << format(value);
  if (!comment.empty()) out << YAML::Comment(comment);
}

std::string comment(const ParameterInfo& parameter) {
  return parameter.doc.empty() ? parameter.unit : parameter.unit + ", " + parameter.doc;
}

/// A list in one line.
template <class Numbers>
void emitNumbers(YAML::Emitter& out, const Numbers& numbers) {
  out << YAML::Flow << YAML::BeginSeq;
  for (const double number : numbers) out << format(number);
  out << YAML::EndSeq;
}

void emitPair(YAML::Emitter& out, const char* key, double first, double second) {
  out << YAML::Key << key << YAML::Value;
  emitNumbers(out, std::array<double, 2>{first, second});
}

/// A thruster; positions are multiplied by `scale`.
void emitThruster(YAML::Emitter& out, const Thruster& one, double scale) {
  out << YAML::Flow << YAML::BeginMap << YAML::Key << "name" << YAML::Value << one.name;
  emitPair(out, "position", scale * one.position.x(), scale * one.position.y());
  emitNumber(out, "direction", one.direction, "");
  if (one.channel != one.name)
    out << YAML::Key << "channel" << YAML::Value << YAML::DoubleQuoted << one.channel;
  if (one.least != 0 || one.most != 1) emitPair(out, "range", one.least, one.most);
  if (one.gain != 1) emitNumber(out, "gain", one.gain, "");
  if (!one.curve.linear()) {
    out << YAML::Key << "curve" << YAML::Value << YAML::Flow << YAML::BeginMap;
    if (one.curve.table.empty()) emitNumber(out, "power", one.curve.power, "");
    if (!one.curve.table.empty()) {
      out << YAML::Key << "table" << YAML::Value << YAML::Flow << YAML::BeginSeq;
      for (const auto& row : one.curve.table) emitNumbers(out, row);
      out << YAML::EndSeq;
    }
    out << YAML::EndMap;
  }
  out << YAML::EndMap;
}

void emitBody(YAML::Emitter& out, const Model& model) {
  const ThrusterLayout& layout = *model.thrusters;
  const std::vector<double> values = model.values();
  out << YAML::Key << "body" << YAML::Value << YAML::BeginMap;
  for (std::size_t i = 0; i < bodyParameters().size(); ++i)
    if (layout.isPair() || bodyParameters()[i].name != "l")
      emitNumber(out, bodyParameters()[i].name, values[i], comment(bodyParameters()[i]));
  if (layout.isPair()) {
    emitNumber(out, "input_max", model.body.input_max, "largest input of a thruster");
  } else {
    out << YAML::Key << "thrusters"
        << YAML::Comment(
               "position [m]: forward, to starboard; direction of the force [deg]: 0 "
               "forward, 90 to starboard")
        << YAML::Value << YAML::BeginSeq;
    for (const Thruster& one : layout.thrusters()) emitThruster(out, one, model.body.l / layout.lever());
    out << YAML::EndSeq;
    if (layout.liftChannel() != "lift")
      out << YAML::Key << "lift" << YAML::Value << YAML::Flow << YAML::BeginMap << YAML::Key << "channel"
          << YAML::Value << YAML::DoubleQuoted << layout.liftChannel() << YAML::EndMap;
  }
  out << YAML::EndMap;
}

void emitStates(YAML::Emitter& out, const std::vector<ExpressionDefinition::State>& states) {
  if (states.empty()) return;
  out << YAML::Key << "states" << YAML::Value << YAML::BeginMap;
  for (const ExpressionDefinition::State& state : states) {
    out << YAML::Key << state.name << YAML::Value;
    if (state.initial == 0) {
      out << YAML::DoubleQuoted << state.rate;
      continue;
    }
    out << YAML::Flow << YAML::BeginMap;
    out << YAML::Key << "derivative" << YAML::Value << YAML::DoubleQuoted << state.rate;
    emitNumber(out, "initial", state.initial, "");
    out << YAML::EndMap;
  }
  out << YAML::EndMap;
}

void emitExpression(YAML::Emitter& out, const ExpressionDefinition& definition,
                    const std::vector<double>& values) {
  out << YAML::Key << "expression" << YAML::Value << YAML::BeginMap;
  for (const auto& [name, formula] : definition.components())
    if (!formula.empty()) out << YAML::Key << name << YAML::Value << YAML::DoubleQuoted << formula;
  out << YAML::EndMap;
  if (definition.world) out << YAML::Key << "frame" << YAML::Value << "world";
  emitStates(out, definition.states);
  if (definition.parameters.empty()) return;
  out << YAML::Key << "parameters" << YAML::Value << YAML::BeginMap;
  for (std::size_t i = 0; i < definition.parameters.size(); ++i) {
    const ParameterInfo& parameter = definition.parameters[i];
    out << YAML::Key << parameter.name << YAML::Value << YAML::Flow << YAML::BeginMap;
    emitNumber(out, "value", values[i], "");
    out << YAML::Key << "unit" << YAML::Value << YAML::DoubleQuoted << parameter.unit;
    if (!parameter.doc.empty())
      out << YAML::Key << "doc" << YAML::Value << YAML::DoubleQuoted << parameter.doc;
    emitNumber(out, "neutral", parameter.neutral, "");
    if (std::isfinite(parameter.lower)) emitNumber(out, "lower", parameter.lower, "");
    if (std::isfinite(parameter.upper)) emitNumber(out, "upper", parameter.upper, "");
    emitNumber(out, "scale", definition.typical[i], "");
    out << YAML::EndMap;
  }
  out << YAML::EndMap;
}

void emitTerm(YAML::Emitter& out, const LearnedTerm& term) {
  out << YAML::BeginMap << YAML::Key << "arguments" << YAML::Value << YAML::Flow << term.arguments;
  out << YAML::Key << "widths" << YAML::Value;
  emitNumbers(out, term.widths);
  out << YAML::Key << "frame" << YAML::Value << (term.world ? "world" : "body");
  out << YAML::Key << "centres" << YAML::Value << YAML::Flow << YAML::BeginSeq;
  for (Eigen::Index i = 0; i < term.centres.rows(); ++i) {
    const Eigen::VectorXd centre = term.centres.row(i);
    emitNumbers(out, std::vector<double>(centre.data(), centre.data() + centre.size()));
  }
  out << YAML::EndSeq << YAML::Key << "weights" << YAML::Comment("N, N, N m") << YAML::Value
      << YAML::BeginMap;
  for (std::size_t channel = 0; channel < 3; ++channel) {
    if (term.weights[channel].empty()) continue;
    out << YAML::Key << std::string(1, "XYN"[channel]) << YAML::Value;
    emitNumbers(out, term.weights[channel]);
  }
  out << YAML::EndMap << YAML::EndMap;
}

void emitDisturbance(YAML::Emitter& out, const Disturbance& disturbance) {
  const auto channels = [&](const char* key, const Vector3<double>& values, double thrust,
                            const char* remark) {
    if (values.isZero(0) && thrust == 0) return;
    out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginMap;
    for (int i = 0; i < 3; ++i) emitNumber(out, std::string(1, "XYN"[i]), values(i), "");
    if (thrust != 0) emitNumber(out, "thrust", thrust, "");
    out << YAML::EndMap << YAML::Comment(remark);
  };
  out << YAML::Key << "disturbance" << YAML::Value << YAML::BeginMap;
  channels("sigma", disturbance.sigma, 0, "N, N, N m, standard deviation of a random wrench, body");
  channels("time", disturbance.time, 0, "s, its correlation time");
  channels("white", disturbance.white, 0, "N sqrt(s), N sqrt(s), N m sqrt(s), white wrench");
  channels("trim", disturbance.trim, disturbance.trim_thrust,
           "N, N, N m, -, standard deviation from run to run: constant wrench, thrust's factor");
  out << YAML::EndMap;
}

void emitProvenance(YAML::Emitter& out, const Provenance& provenance) {
  const auto numbers = [&out](const char* key, const std::map<std::string, double>& map) {
    if (map.empty()) return;
    out << YAML::Key << key << YAML::Value << YAML::BeginMap;
    for (const auto& entry : map) emitNumber(out, entry.first, entry.second, "");
    out << YAML::EndMap;
  };
  out << YAML::Key << "provenance" << YAML::Value << YAML::BeginMap;
  out << YAML::Key << "date" << YAML::Value << YAML::DoubleQuoted << provenance.date;
  out << YAML::Key << "command" << YAML::Value << YAML::DoubleQuoted << provenance.command;
  const auto texts = [&out](const char* key, const std::vector<std::string>& list) {
    out << YAML::Key << key << YAML::Value << YAML::BeginSeq;
    for (const std::string& text : list) out << YAML::DoubleQuoted << text;
    out << YAML::EndSeq;
  };
  texts("bags", provenance.bags);
  if (!provenance.digests.empty()) texts("digests", provenance.digests);
  numbers("error_before", provenance.error_before);
  numbers("error_after", provenance.error_after);
  if (!provenance.confidence_95.empty()) {
    out << YAML::Key << "confidence_95" << YAML::Value << YAML::BeginMap;
    for (const auto& entry : provenance.confidence_95)
      out << YAML::Key << entry.first << YAML::Value << YAML::Flow << YAML::BeginSeq
          << format(entry.second.first) << format(entry.second.second) << YAML::EndSeq;
    out << YAML::EndMap;
  }
  if (!provenance.not_identified.empty()) {
    out << YAML::Key << "not_identified" << YAML::Value << YAML::Flow << YAML::BeginSeq;
    for (const std::string& name : provenance.not_identified) out << name;
    out << YAML::EndSeq << YAML::Comment("kept at their start values, or known only in combination");
  }
  out << YAML::EndMap;
}

std::runtime_error systemError(const std::string& path, const std::string& what) {
  return std::runtime_error(path + ": " + what + ": " + std::strerror(errno));
}

/// Opens a new file with the permissions that the user's umask leaves, and replaces the six X at the
/// end of its name. On failure returns -1 and sets errno.
int newFile(std::string& name) {
  const int unique = mkstemp(&name[0]);  // which only its owner may read
  if (unique < 0) return -1;
  close(unique);
  unlink(name.c_str());
  return open(name.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
}

/// Renames a file to a name that must not exist. On failure returns false and sets errno (EEXIST if
/// the name exists).
bool moveToNewName(const std::string& temporary, const std::string& path) {
  // link() fails when the path exists, so that nothing is overwritten even in a race.
  if (link(temporary.c_str(), path.c_str()) == 0) return true;
  if (errno == EEXIST) return false;
  // A file system without hard links: reserve the name, which fails if it exists, and rename over
  // the empty file.
  const int reserved = open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
  if (reserved < 0) return false;
  close(reserved);
  if (rename(temporary.c_str(), path.c_str()) == 0) return true;
  const int rename_error = errno;
  unlink(path.c_str());
  errno = rename_error;
  return false;
}

Model parse(const std::string& yaml, const std::string& source, BodyLines& lines) {
  const YamlReader reader(source);
  const YAML::Node root = reader.parse(yaml);
  Model model;
  const std::string top = "the model file";
  if (!root.IsMap()) reader.fail(root, top + " must be a map with schema, name, body, effects");
  if (!root["schema"] || !root["schema"].IsScalar() || root["schema"].Scalar() != kSchema)
    reader.fail(root, std::string("not a model file: it must say 'schema: ") + kSchema + "'");
  if (!root["body"]) reader.fail(root, top + " has no body");
  reader.each(root, top, [&](const std::string& key, const YAML::Node& value) {
    if (key == "name") {
      model.name = reader.text(value, key);
    } else if (key == "body") {
      readBody(reader, value, model, lines);
    } else if (key == "disturbance") {
      readDisturbance(reader, value, model.disturbance);
    } else if (key == "provenance") {
      readProvenance(reader, value, model.provenance);
    } else if (key == "effects") {
      if (!value.IsSequence() && !value.IsNull()) reader.fail(value, "effects must be a list");
    } else if (key != "schema") {
      reader.unknown(value, key, top, "schema, name, body, effects, disturbance, provenance");
    }
  });
  for (const auto& effect : root["effects"]) readEffect(reader, effect, model);
  return model;
}

}  // namespace

Model parseModel(const std::string& yaml, const std::string& source) {
  BodyLines lines;
  return parse(yaml, source, lines);
}

Model loadModel(const std::string& path, std::vector<std::string>* warnings) {
  BodyLines lines;
  Model model = parse(readTextFile(path, kLargestFile), path, lines);
  for (const Implausibility& found : implausibilities(model.body, *model.thrusters)) {
    std::string text = path + ", line " + std::to_string(lines[found.key]) + ": " + found.message;
    if (found.key == "l" && !model.thrusters->isPair())
      text += " (l is the root mean square of the levers of the thrusters' positions)";
    if (found.refused) throw std::runtime_error(text);
    if (warnings) warnings->push_back(text);
  }
  return model;
}

Model withEffect(Model model, const std::string& yaml, const std::string& source) {
  const YamlReader reader(source);
  const YAML::Node root = reader.parse(yaml);
  const YAML::Node node = root.IsSequence() && root.size() == 1 ? root[0] : root;
  if (!node.IsMap() || !node["name"] || node["body"])
    reader.fail(node, "it must be one effect with a name, as model files list them");
  readEffect(reader, node, model);
  return model;
}

std::string readEffectFile(const std::string& path) { return readTextFile(path, kLargestFile); }

std::string formatModel(const Model& model) {
  YAML::Emitter out;
  out << YAML::BeginMap;
  out << YAML::Key << "schema" << YAML::Value << kSchema;
  out << YAML::Key << "name" << YAML::Value << YAML::DoubleQuoted << model.name;
  emitBody(out, model);
  out << YAML::Key << "effects" << YAML::Value << YAML::BeginSeq;
  for (const Model::Entry& entry : model.effects) {
    const EffectInfo& info = entry.effect->info();
    out << YAML::BeginMap << YAML::Key << "name" << YAML::Value << info.name;
    if (const ExpressionDefinition* definition = expressionDefinition(*entry.effect)) {
      emitExpression(out, *definition, entry.values);
    } else {
      out << YAML::Comment(info.summary);
      for (std::size_t i = 0; i < info.parameters.size(); ++i)
        emitNumber(out, info.parameters[i].name, entry.values[i], comment(info.parameters[i]));
    }
    if (const LearnedWrench* learned = learnedWrench(*entry.effect)) {
      out << YAML::Key << "terms" << YAML::Value << YAML::BeginSeq;
      for (const LearnedTerm& term : learned->terms) emitTerm(out, term);
      out << YAML::EndSeq;
    }
    out << YAML::EndMap;
  }
  out << YAML::EndSeq;
  if (!model.disturbance.empty()) emitDisturbance(out, model.disturbance);
  if (!model.provenance.empty()) emitProvenance(out, model.provenance);
  out << YAML::EndMap;
  return std::string(out.c_str()) + '\n';
}

void saveModel(const Model& model, const std::string& path, bool overwrite) {
  const std::string text = formatModel(model);
  std::string temporary = path + ".XXXXXX";
  const int file = newFile(temporary);
  if (file < 0) throw systemError(path, "cannot write the model file");
  const bool written = write(file, text.data(), text.size()) == ssize_t(text.size()) && fsync(file) == 0;
  const int write_error = errno;
  close(file);
  const bool moved =
      written && (overwrite ? rename(temporary.c_str(), path.c_str()) == 0 : moveToNewName(temporary, path));
  const int move_error = errno;
  unlink(temporary.c_str());
  if (moved) return;
  if (written && move_error == EEXIST)
    throw std::runtime_error(path + " exists; choose another name or allow overwriting");
  errno = written ? move_error : write_error;
  throw systemError(path, "cannot write the model file");
}

}  // namespace ground
