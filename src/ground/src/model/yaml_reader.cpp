#include "ground/model/yaml_reader.h"

#include <cmath>
#include <set>
#include <sstream>
#include <stdexcept>

#include "ground/model/model.h"
#include "ground/model/shortened.h"

namespace ground {

YAML::Node YamlReader::parse(const std::string& yaml) const {
  YAML::Node root;
  try {
    root = YAML::Load(yaml);
  } catch (const YAML::ParserException& error) {
    throw std::runtime_error(source_ + ", line " + std::to_string(error.mark.line + 1) + ": " + error.msg +
                             " (a tab, or a missing colon or bracket, in this line or above it?)");
  }
  if (root.IsNull()) throw std::runtime_error(source_ + ": it is empty");
  return root;
}

std::string YamlReader::requireSchema(const YAML::Node& root, const std::string& schema,
                                      const std::string& what) const {
  if (!root.IsMap() || !root["schema"] || !root["schema"].IsScalar() || root["schema"].Scalar() != schema)
    fail(root, "not a " + what + ": it must say 'schema: " + schema + "'");
  return schema;
}

void YamlReader::fail(const YAML::Node& node, const std::string& message) const {
  std::ostringstream text;
  text << source_;
  if (node.Mark().line >= 0) text << ", line " << node.Mark().line + 1;
  text << ": " << message;
  throw std::runtime_error(text.str());
}

void YamlReader::each(const YAML::Node& map, const std::string& what, const Visit& visit) const {
  if (!map.IsMap()) fail(map, what + " must be a map of key: value");
  std::set<std::string> seen;
  for (const auto& entry : map) {
    if (!entry.first.IsScalar()) fail(entry.first, "a key in " + what + " is not a word");
    const std::string key = entry.first.Scalar();
    if (!seen.insert(key).second) fail(entry.first, "duplicate key '" + shortened(key) + "' in " + what);
    visit(key, entry.second);
  }
}

double YamlReader::number(const YAML::Node& node, const std::string& key) const {
  double value = 0;
  if (!node.IsScalar() || !YAML::convert<double>::decode(node, value)) {
    const bool comma = node.IsScalar() && node.Scalar().find(',') != std::string::npos;
    fail(node, key + " must be a number" + (comma ? ", with a point instead of the comma" : ""));
  }
  if (std::isnan(value)) fail(node, key + " must not be NaN");
  return value;
}

double YamlReader::number(const YAML::Node& node, const ParameterInfo& parameter) const {
  const double value = number(node, parameter.name);
  const std::string wrong = checkValue(parameter, value);
  if (!wrong.empty()) fail(node, wrong);
  return value;
}

std::string YamlReader::text(const YAML::Node& node, const std::string& key) const {
  if (!node.IsScalar()) fail(node, key + " must be a string");
  return node.Scalar();
}

}  // namespace ground
