#include "ground/model/model_file.h"

#include <algorithm>
#include <regex>
#include <stdexcept>

#include "effect_keys.h"
#include "ground/model/expression_effect.h"
#include "ground/model/plausibility.h"
#include "ground/model/text_file.h"
#include "ground/model/yaml_keys.h"

namespace ground {

static YamlKeys keysOf(const YamlReader& reader, ForceCurve& curve) {
  YamlKeys keys(reader, "the curve of a thruster", true);
  keys.value("power", curve.power).silentIf(!curve.table.empty());
  keys.value("table", curve.table).silentIf(curve.table.empty());
  return keys;
}

static YamlKeys keysOf(const YamlReader& reader, Foil& foil) {
  YamlKeys keys(reader, "the foil of a thruster list", true);
  keys.word("stream", foil.stream).silentIf(foil.stream.empty());
  keys.value("force", foil.force).required("N s^2/m^2, normal force per square of the inflow");
  keys.value("jet", foil.jet).silentIf(foil.jet == 0);
  keys.value("own_speed", foil.own_speed).silentIf(foil.own_speed == 1);
  keys.value("own_sway", foil.own_sway).silentIf(foil.own_sway == 1);
  keys.value("drag", foil.drag).silentIf(foil.drag == 1);
  return keys;
}

/// Of a foil, or of the angle of a thruster that turns.
static YamlKeys angleKeys(const YamlReader& reader, Thruster& one) {
  const bool foil = one.kind == Thruster::Kind::kFoil;
  YamlKeys keys(reader, foil ? "a foil" : "the angle of a thruster", true);
  keys.word("name", one.name).required("");
  if (foil) {
    keys.pair("position", one.position.x(), one.position.y()).required("[forward, to starboard] in m");
    keys.value("foil", one.foil).required("");
  } else {
    keys.word("turns", one.turns).required("the thruster that it turns");
  }
  keys.value("angle", one.angle).required("at input 1 in degrees");
  keys.value("offset", one.offset).silentIf(one.offset == 0);
  keys.value("channel", one.channel).silentIf(one.channel == one.name);
  keys.pair("range", one.least, one.most).silentIf(one.least == -1 && one.most == 1);
  return keys;
}

static YamlKeys keysOf(const YamlReader& reader, Thruster& one) {
  if (one.isAngle()) return angleKeys(reader, one);
  YamlKeys keys(reader, "a thruster", true);
  keys.word("name", one.name).required("");
  keys.pair("position", one.position.x(), one.position.y()).required("[forward, to starboard] in m");
  keys.value("direction", one.direction).required("of its force in degrees: 0 forward, 90 starboard");
  keys.value("channel", one.channel).silentIf(one.channel == one.name);
  keys.pair("range", one.least, one.most).silentIf(one.least == 0 && one.most == 1);
  keys.value("gain", one.gain).silentIf(one.gain == 1);
  keys.value("curve", one.curve).silentIf(one.curve.linear());
  keys.choice("command", "continuous", "on_off", one.on_off).silentIf(!one.on_off);
  keys.word("supply", one.supply).silentIf(one.supply.empty());
  return keys;
}

/// The kind of a thruster, which its keys say, comes first.
static void readValue(const YamlReader& reader, const YAML::Node& node, const std::string&, Thruster& one) {
  if (node.IsMap() && node["foil"]) one.kind = Thruster::Kind::kFoil;
  if (node.IsMap() && node["turns"]) one.kind = Thruster::Kind::kTurn;
  if (one.isAngle()) one.least = -1;
  keysOf(reader, one).read(node);
}

namespace {

constexpr char kSchema[] = "ground/model/1";
constexpr std::size_t kLargestFile = 1000000;  // [bytes]; a typical model has some thousand

const ParameterInfo kInputMax{"input_max", "-", "", 1, std::numeric_limits<double>::min()};
const ParameterInfo kHullLength{"length", "m", "", 1, std::numeric_limits<double>::min()};
const ParameterInfo kVolts{"volts", "V", "", 0, 0};

/// A body as its keys see it. `listed`: its thrusters are listed, which gives l and the range of inputs.
struct BodyText {
  std::vector<double> values;  ///< of bodyParameters()
  double input_max = 1, volts = 0;
  bool listed = false;
  std::vector<Thruster> thrusters{};  ///< positions [m]
  std::string lift = "lift";          ///< channel of the lift
  double hull_length = 0;             ///< [m]
};

YamlKeys bodyKeys(const YamlReader& reader, BodyText& body) {
  YamlKeys keys(reader, body.listed ? "body with thrusters" : "body");
  for (std::size_t i = 0; i < bodyParameters().size(); ++i)
    if (!body.listed || bodyParameters()[i].name != "l") keys.parameter(bodyParameters()[i], body.values[i]);
  if (!body.listed) keys.parameter(kInputMax, body.input_max).required("largest input of a thruster");
  keys.parameter(kVolts, body.volts)
      .optional()
      .silentIf(body.volts == 0)
      .comment("V, voltage of the battery at which k holds");
  keys.value("thrusters", body.thrusters)
      .silentIf(!body.listed)
      .comment(
          "position [m]: forward, to starboard; direction of the force [deg]: 0 forward, 90 to starboard",
          true);
  YamlKeys hull(reader, "hull", true);
  hull.parameter(kHullLength, body.hull_length).required("length of the hull at the water [m]");
  keys.map("hull", hull).silentIf(body.hull_length == 0).comment("m, of a craft on water");
  if (!body.listed) return keys;
  YamlKeys lift(reader, "lift", true);
  lift.value("channel", body.lift);
  keys.map("lift", lift).silentIf(body.lift == "lift");
  return keys;
}

void readBody(const YamlReader& reader, const YAML::Node& node, Model& model) {
  if (!node.IsMap()) reader.fail(node, "body must be a map of key: value");
  BodyText body{std::vector<double>(bodyParameters().size())};
  const YAML::Node list = node["thrusters"];
  body.listed = bool(list);
  bodyKeys(reader, body).read(node);
  for (Thruster& one : body.thrusters)
    if (one.channel.empty()) one.channel = one.name;
  try {
    if (body.listed) model.thrusters = std::make_shared<const ThrusterLayout>(body.thrusters, body.lift);
  } catch (const std::invalid_argument& error) {
    reader.fail(list, error.what());
  }
  if (body.listed) body.values[1] = model.thrusters->lever();
  model.body.input_max = body.input_max;
  model.body.hull_length = body.hull_length;
  model.body.volts = body.volts;
  model.setValues(body.values);
}

void writeBody(YAML::Emitter& out, const Model& model) {
  const ThrusterLayout& layout = *model.thrusters;
  BodyText body{model.values(),     model.body.input_max, model.body.volts,      !layout.isPair(),
                layout.thrusters(), layout.liftChannel(), model.body.hull_length};
  for (Thruster& one : body.thrusters) one.position *= model.body.l / layout.lever();
  bodyKeys(YamlReader(""), body).write(out);
}

YamlKeys disturbanceKeys(const YamlReader& reader, Disturbance& disturbance) {
  YamlKeys keys(reader, "disturbance");
  const auto channels = [&](const std::string& name, Vector3<double>& values, double* thrust,
                            const char* remark) {
    YamlKeys one(reader, name + " of disturbance", true);
    for (int i = 0; i < 3; ++i) one.value(std::string(1, "XYN"[i]), values(i));
    if (thrust) one.value("thrust", *thrust).silentIf(*thrust == 0);
    keys.map(name, one).silentIf(values.isZero(0) && !(thrust && *thrust != 0)).comment(remark);
  };
  channels("sigma", disturbance.sigma, nullptr, "N, N, N m, standard deviation of a random wrench, body");
  channels("time", disturbance.time, nullptr, "s, its correlation time");
  channels("white", disturbance.white, nullptr, "N sqrt(s), N sqrt(s), N m sqrt(s), white wrench");
  channels("trim", disturbance.trim, &disturbance.trim_thrust,
           "N, N, N m, -, standard deviation from run to run: constant wrench, thrust's factor");
  return keys;
}

YamlKeys provenanceKeys(const YamlReader& reader, Provenance& provenance) {
  YamlKeys keys(reader, "provenance");
  keys.value("date", provenance.date);
  keys.value("command", provenance.command);
  keys.value("bags", provenance.bags);
  keys.value("digests", provenance.digests).silentIf(provenance.digests.empty());
  keys.value("error_before", provenance.error_before).silentIf(provenance.error_before.empty());
  keys.value("error_after", provenance.error_after).silentIf(provenance.error_after.empty());
  keys.value("confidence_95", provenance.confidence_95).silentIf(provenance.confidence_95.empty());
  keys.value("not_identified", provenance.not_identified)
      .silentIf(provenance.not_identified.empty())
      .comment("kept at their start values, or known only in combination", true);
  return keys;
}

/// The body comes before the effects, which depend on its thrusters.
YamlKeys modelKeys(const YamlReader& reader, Model& model, std::string& schema) {
  YamlKeys keys(reader, "the model file");
  keys.word("schema", schema);
  keys.value("name", model.name);
  keys.add(
          "body", [&model, reader](const YAML::Node& node) { readBody(reader, node, model); },
          [&model](YAML::Emitter& out) { writeBody(out, model); })
      .required("");
  keys.add(
      "effects",
      [&model, reader](const YAML::Node& node) {
        if (!node.IsSequence() && !node.IsNull()) reader.fail(node, "effects must be a list");
        for (const auto& one : node) readEffect(reader, one, model);
      },
      [&model](YAML::Emitter& out) {
        out << YAML::BeginSeq;
        for (const Model::Entry& entry : model.effects) writeEffect(out, entry, *model.thrusters);
        out << YAML::EndSeq;
      });
  keys.map("disturbance", disturbanceKeys(reader, model.disturbance)).silentIf(model.disturbance.empty());
  keys.map("provenance", provenanceKeys(reader, model.provenance)).silentIf(model.provenance.empty());
  return keys;
}

/// Whether a formula of an effect has the voltage of the battery.
bool usesVoltage(const Effect& effect) {
  const ExpressionDefinition* const formulas = expressionDefinition(effect);
  if (!formulas) return false;
  static const std::regex voltage("(^|[^A-Za-z0-9_.])volt([^A-Za-z0-9_]|$)");
  std::vector<std::string> texts;
  for (const auto& [name, text] : formulas->components()) texts.push_back(text);
  for (const auto& state : formulas->states) texts.push_back(state.rate);
  return std::any_of(texts.begin(), texts.end(),
                     [](const std::string& text) { return std::regex_search(text, voltage); });
}

/// Where no voltage is recorded, formulas have the one at which k holds.
void requireVoltage(const YamlReader& reader, const YAML::Node& node, const Model& model) {
  for (const Model::Entry& entry : model.effects)
    if (model.body.volts == 0 && usesVoltage(*entry.effect))
      reader.fail(node, "effect '" + entry.effect->info().name +
                            "' uses volt: give body the key volts, the voltage at which k holds, which acts "
                            "where none is recorded");
}

Model parse(const YamlReader& reader, const YAML::Node& root) {
  std::string schema = reader.requireSchema(root, kSchema, "model file");
  Model model;
  modelKeys(reader, model, schema).read(root);
  const std::string wrong = model.disturbance.validate();
  if (!wrong.empty()) reader.fail(root["disturbance"], "disturbance: " + wrong);
  requireVoltage(reader, root["effects"], model);
  const Provenance& provenance = model.provenance;
  if (!provenance.digests.empty() && provenance.digests.size() != provenance.bags.size())
    reader.fail(root["provenance"], "provenance must have one digest for each of its bags, or none");
  return model;
}

}  // namespace

Model parseModel(const std::string& yaml, const std::string& source) {
  const YamlReader reader(source);
  return parse(reader, reader.parse(yaml));
}

Model loadModel(const std::string& path, std::vector<std::string>* warnings) {
  const YamlReader reader(path);
  const YAML::Node root = reader.parse(readTextFile(path, kLargestFile));
  Model model = parse(reader, root);
  const YAML::Node body = root["body"];
  for (const Implausibility& found : implausibilities(model.body, *model.thrusters)) {
    const int line = body[body[found.key] ? found.key : "thrusters"].Mark().line + 1;
    std::string text = path + ", line " + std::to_string(line) + ": " + found.message;
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
  const bool is_craft = model.body.m > 0;  // otherwise only the effect matters
  if (is_craft) requireVoltage(reader, node, model);
  return model;
}

std::string readEffectFile(const std::string& path) { return readTextFile(path, kLargestFile); }

std::string formatModel(const Model& model) {
  Model copy = model;
  std::string schema = kSchema;
  YAML::Emitter out;
  modelKeys(YamlReader(""), copy, schema).write(out);
  return std::string(out.c_str()) + '\n';
}

}  // namespace ground
