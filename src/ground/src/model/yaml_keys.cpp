#include "ground/model/yaml_keys.h"

#include <cmath>
#include <cstdlib>
#include <sstream>

#include "ground/model/did_you_mean.h"
#include "ground/model/shortened.h"

namespace ground {

std::string shortest(double value) {
  if (std::isinf(value)) return value > 0 ? ".inf" : "-.inf";
  for (int digits = 6;; ++digits) {
    std::ostringstream text;
    text.precision(digits);
    text << value;
    if (digits >= 17 || std::strtod(text.str().c_str(), nullptr) == value) return text.str();
  }
}

void readPair(const YamlReader& reader, const YAML::Node& node, const std::string& what, double& first,
              double& second) {
  if (!node.IsSequence() || node.size() != 2) reader.fail(node, what + " must be a list of 2 numbers");
  first = reader.number(node[0], what);
  second = reader.number(node[1], what);
}

void writePair(YAML::Emitter& out, double first, double second) {
  writeValue(out, std::vector<double>{first, second});
}

YamlKey& YamlKeys::add(const std::string& name, std::function<void(const YAML::Node&)> read,
                       std::function<void(YAML::Emitter&)> write) {
  keys_.push_back({name, std::move(read), std::move(write)});
  return keys_.back();
}

YamlKey& YamlKeys::parameter(const ParameterInfo& info, double& at) {
  YamlKey& key = value(info.name, at);
  key.read = [info, &at, reader = reader_](const YAML::Node& node) { at = reader.number(node, info); };
  return key.required(info.doc.empty() ? info.unit : info.unit + ", " + info.doc);
}

YamlKey& YamlKeys::choice(const std::string& name, const std::string& off, const std::string& on,
                          bool& is_on) {
  return add(
      name,
      [=, &is_on, reader = reader_](const YAML::Node& node) {
        const std::string given = reader.text(node, name);
        if (given != off && given != on)
          reader.fail(node, name + " must be " + on + " or " + off + ", not '" + shortened(given) + "'");
        is_on = given == on;
      },
      [=, &is_on](YAML::Emitter& out) { out << (is_on ? on : off); });
}

YamlKey& YamlKeys::map(const std::string& name, YamlKeys keys) {
  return add(
      name, [keys](const YAML::Node& node) { keys.read(node); },
      [keys](YAML::Emitter& out) { keys.write(out); });
}

void YamlKeys::read(const YAML::Node& node) const {
  std::map<std::string, YAML::Node> given;
  reader_.each(node, what_, [&](const std::string& name, const YAML::Node& value) {
    std::string known;
    std::vector<std::string> names;
    for (const YamlKey& key : keys_) {
      if (key.name == name) given[name] = value;
      known += (known.empty() ? "" : ", ") + key.name;
      names.push_back(key.name);
    }
    if (!given.count(name))
      reader_.fail(value, "unknown key '" + shortened(name) + "' in " + what_ + didYouMean(name, names) +
                              "; allowed are " + known);
  });
  for (const YamlKey& key : keys_) {
    const auto found = given.find(key.name);
    if (found != given.end())
      key.read(found->second);
    else if (key.is_required)
      reader_.fail(node, what_ + " has no " + key.name + (key.remark.empty() ? "" : " (" + key.remark + ")"));
  }
}

void YamlKeys::write(YAML::Emitter& out) const {
  if (one_line_) out << YAML::Flow;
  out << YAML::BeginMap;
  for (const YamlKey& key : keys_) {
    if (key.is_silent) continue;
    const bool remarks = !one_line_ && !key.remark.empty();
    out << YAML::Key << key.name;
    if (remarks && key.has_head) out << YAML::Comment(key.remark);
    out << YAML::Value;
    key.write(out);
    if (remarks && !key.has_head) out << YAML::Comment(key.remark);
  }
  out << YAML::EndMap;
}

}  // namespace ground
