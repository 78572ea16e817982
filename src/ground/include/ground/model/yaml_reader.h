#pragma once

#include <yaml-cpp/yaml.h>

#include <functional>
#include <string>

#include "ground/model/effect.h"

namespace ground {

/// Reads YAML strictly: every error is a std::runtime_error that names source, line and key.
class YamlReader {
 public:
  using Visit = std::function<void(const std::string& key, const YAML::Node& value)>;

  explicit YamlReader(std::string source) : source_(std::move(source)) {}

  /// The root of a document. An empty document is an error.
  YAML::Node parse(const std::string& yaml) const;
  /// The root's schema, which must be `schema`; `what` names such files, as in "model file".
  std::string requireSchema(const YAML::Node& root, const std::string& schema, const std::string& what) const;
  [[noreturn]] void fail(const YAML::Node& node, const std::string& message) const;

  /// Visits the entries of the map `what`; a duplicate key is an error.
  void each(const YAML::Node& map, const std::string& what, const Visit& visit) const;
  /// A number, which may be infinite but not NaN.
  double number(const YAML::Node& node, const std::string& key) const;
  /// A number inside the parameter's range.
  double number(const YAML::Node& node, const ParameterInfo& parameter) const;
  std::string text(const YAML::Node& node, const std::string& key) const;

 private:
  std::string source_;
};

}  // namespace ground
