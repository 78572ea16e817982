// Maps in a model file: each key with its value, which is read and written in the same way everywhere.
#pragma once

#include <yaml-cpp/yaml.h>

#include <array>
#include <deque>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "ground/model/yaml_reader.h"

namespace ground {

class YamlKeys;

/// Shortest text that parses as the same number.
std::string shortest(double value);

// How values are read and written: numbers, strings, lists, maps by name, rows of numbers, and structs
// with a function keysOf(reader, struct). `what` names the value in messages.
inline void readValue(const YamlReader& reader, const YAML::Node& node, const std::string& what,
                      double& value) {
  value = reader.number(node, what);
}
inline void readValue(const YamlReader& reader, const YAML::Node& node, const std::string& what,
                      std::string& value) {
  value = reader.text(node, what);
}
void readPair(const YamlReader& reader, const YAML::Node& node, const std::string& what, double& first,
              double& second);
inline void readValue(const YamlReader& reader, const YAML::Node& node, const std::string& what,
                      std::pair<double, double>& value) {
  readPair(reader, node, what, value.first, value.second);
}
inline void readValue(const YamlReader& reader, const YAML::Node& node, const std::string& what,
                      std::array<double, 2>& value) {
  readPair(reader, node, what, value[0], value[1]);
}
template <class Struct>
void readValue(const YamlReader& reader, const YAML::Node& node, const std::string& what, Struct& value);
template <class Item>
void readValue(const YamlReader& reader, const YAML::Node& node, const std::string& what,
               std::vector<Item>& list) {
  if (!node.IsSequence()) reader.fail(node, what + " must be a list");
  for (const auto& one : node) readValue(reader, one, what, list.emplace_back());
}
template <class Item>
void readValue(const YamlReader& reader, const YAML::Node& node, const std::string& what,
               std::map<std::string, Item>& items) {
  reader.each(node, what, [&](const std::string& name, const YAML::Node& one) {
    readValue(reader, one, name, items[name]);
  });
}

inline void writeValue(YAML::Emitter& out, double value) { out << shortest(value); }
inline void writeValue(YAML::Emitter& out, const std::string& value) { out << YAML::DoubleQuoted << value; }
void writePair(YAML::Emitter& out, double first, double second);
inline void writeValue(YAML::Emitter& out, const std::pair<double, double>& value) {
  writePair(out, value.first, value.second);
}
inline void writeValue(YAML::Emitter& out, const std::array<double, 2>& value) {
  writePair(out, value[0], value[1]);
}
template <class Struct>
void writeValue(YAML::Emitter& out, const Struct& value);
template <class Item>
void writeValue(YAML::Emitter& out, const std::vector<Item>& list) {
  if (std::is_arithmetic<Item>::value) out << YAML::Flow;  // in one line
  out << YAML::BeginSeq;
  for (const Item& one : list) writeValue(out, one);
  out << YAML::EndSeq;
}
template <class Item>
void writeValue(YAML::Emitter& out, const std::map<std::string, Item>& items) {
  out << YAML::BeginMap;
  for (const auto& [name, one] : items) {
    out << YAML::Key << name << YAML::Value;
    writeValue(out, one);
  }
  out << YAML::EndMap;
}

/// A key of a map.
struct YamlKey {
  std::string name;
  std::function<void(const YAML::Node&)> read;
  std::function<void(YAML::Emitter&)> write;
  bool is_required = false, is_silent = false, has_head = false;
  std::string remark{};

  /// Is an error when it is missing; `remark` says what it is, there and as a comment.
  YamlKey& required(const std::string& what) {
    is_required = true;
    remark = what;
    return *this;
  }
  /// May be missing.
  YamlKey& optional() {
    is_required = false;
    return *this;
  }
  /// Is not written when it has its standard value.
  YamlKey& silentIf(bool standard) {
    is_silent = standard;
    return *this;
  }
  /// A comment beside the value, or before one that has lines of its own.
  YamlKey& comment(const std::string& text, bool before = false) {
    remark = text;
    has_head = before;
    return *this;
  }
};

/// The keys of one map, in the order in which they are written. They refer to the values that they read
/// and write.
class YamlKeys {
 public:
  /// `what` names the map in messages. A map in one line has no comments.
  YamlKeys(YamlReader reader, std::string what, bool one_line = false)
      : reader_(std::move(reader)), what_(std::move(what)), one_line_(one_line) {}

  YamlKey& add(const std::string& name, std::function<void(const YAML::Node&)> read,
               std::function<void(YAML::Emitter&)> write);
  template <class Value>
  YamlKey& value(const std::string& name, Value& at) {
    return add(
        name, [name, &at, reader = reader_](const YAML::Node& node) { readValue(reader, node, name, at); },
        [&at](YAML::Emitter& out) { writeValue(out, at); });
  }
  YamlKey& pair(const std::string& name, double& first, double& second) {
    return add(
        name,
        [name, &first, &second, reader = reader_](const YAML::Node& node) {
          readPair(reader, node, name, first, second);
        },
        [&first, &second](YAML::Emitter& out) { writePair(out, first, second); });
  }
  YamlKey& word(const std::string& name, std::string& at) {  ///< a string without quotes
    YamlKey& key = value(name, at);
    key.write = [&at](YAML::Emitter& out) { out << at; };
    return key;
  }
  /// One of two words.
  YamlKey& choice(const std::string& name, const std::string& off, const std::string& on, bool& is_on);
  /// A number in a parameter's range.
  YamlKey& parameter(const ParameterInfo& info, double& at);
  /// A map with keys of its own.
  YamlKey& map(const std::string& name, YamlKeys keys);

  /// Reads a map, in the order of the keys. Complains of an unknown, missing or repeated key.
  void read(const YAML::Node& node) const;
  void write(YAML::Emitter& out) const;

 private:
  YamlReader reader_;
  std::string what_;
  bool one_line_;
  std::deque<YamlKey> keys_;
};

template <class Struct>
void readValue(const YamlReader& reader, const YAML::Node& node, const std::string&, Struct& value) {
  keysOf(reader, value).read(node);
}
template <class Struct>
void writeValue(YAML::Emitter& out, const Struct& value) {
  Struct copy = value;
  keysOf(YamlReader(""), copy).write(out);
}

}  // namespace ground
