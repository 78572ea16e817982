#pragma once

#include <dynamic_reconfigure/server.h>
#include <ros/ros.h>

#include <boost/any.hpp>
#include <boost/thread/recursive_mutex.hpp>
#include <functional>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "ground/model/tunable.h"
#include "ground/nodelets/callback_thread.h"
#include "ground/nodelets/live_changes.h"

namespace ground {

/// Reads a required private parameter; throws std::runtime_error that names it if it is missing.
template <typename T>
T requiredParameter(const ros::NodeHandle& nh, const std::string& name) {
  T value;
  if (!nh.hasParam(name)) throw std::runtime_error("parameter " + nh.resolveName(name) + " is missing");
  if (!nh.getParam(name, value))
    throw std::runtime_error("parameter " + nh.resolveName(name) + " has the wrong type");
  return value;
}

/// Reads a private parameter that has a default; throws std::runtime_error if it has another type.
template <typename T>
T optionalParameter(const ros::NodeHandle& nh, const std::string& name, const T& fallback) {
  return nh.hasParam(name) ? requiredParameter<T>(nh, name) : fallback;
}

/// The fields of a dynamic_reconfigure class, with meanings, units and ranges of its .cfg file.
template <class Config>
const Tunables<Config>& fieldsOf() {
  static const Tunables<Config> fields = [] {
    Tunables<Config> found;
    for (const auto& field : Config::__getParamDescriptions__()) {
      const auto get = [field](const Config& config) -> Setting {
        boost::any value;
        field->getValue(config, value);
        if (const auto* number = boost::any_cast<double>(&value)) return *number;
        if (const auto* number = boost::any_cast<int>(&value)) return static_cast<double>(*number);
        if (const auto* flag = boost::any_cast<bool>(&value)) return *flag;
        return boost::any_cast<std::string>(value);
      };
      TunableInfo info;
      info.name = field->name;
      info.type = field->type;
      const std::string& text = field->description;
      const std::size_t unit = text.rfind('[');
      if (unit != std::string::npos) info.unit = text.substr(unit + 1, text.size() - unit - 2);
      const Setting low = get(Config::__getMin__()), high = get(Config::__getMax__());
      if (std::holds_alternative<double>(low)) {
        info.low = std::get<double>(low);
        info.high = std::get<double>(high);
      }
      found.emplace_back(info, get, nullptr);
    }
    return found;
  }();
  return fields;
}

/// Sets the parameters in `table` from the fields with the same names in a dynamic_reconfigure class.
template <class Params, class Table, class Config>
void setFields(Params& params, const Table& table, const Config& config) {
  for (const auto& one : table)
    if (const auto* field = findNamed(fieldsOf<Config>(), one.name)) one.set(params, field->get(config));
}

/// The parameters that a dynamic_reconfigure class has fields for; defaults for all others.
template <class Params, class Config>
Params paramsIn(const Config& config) {
  Params params;
  setFields(params, Params::table(), config);
  return params;
}

/// Parameters that a user tunes while the nodelet runs: a dynamic_reconfigure server that refuses
/// bad values with a reason and keeps the old ones, instead of clamping them. Accepted changes are
/// logged and published (LiveChanges). It has its own thread, so that a slow validation does not
/// block the nodelet.
template <class Config>
class LiveParameters {
 public:
  /// Applies values that are finite and inside the ranges of the .cfg file; called once from the constructor
  /// and at every accepted change. Values at which it throws are refused.
  using Apply = std::function<void(const Config&)>;

  /// Throws std::runtime_error if the values on the parameter server are bad.
  LiveParameters(const ros::NodeHandle& nh, Apply apply)
      : name_(nh.getNamespace()), changes_(nh), apply_(std::move(apply)) {
    checkTypes(nh);
    using Server = dynamic_reconfigure::Server<Unclamped>;
    server_ = std::make_unique<Server>(mutex_, callbacks_.handle(nh));
    server_->setCallback([this](Unclamped& config, uint32_t) { change(config); });
    const boost::recursive_mutex::scoped_lock lock(mutex_);
    if (!refusal_.empty()) throw std::runtime_error(refusal_);
    live_ = true;
  }
  ~LiveParameters() { callbacks_.stop(); }

  /// The thread that applies changes; no change is applied while another callback of it runs.
  CallbackThread& thread() { return callbacks_; }

 private:
  /// Config whose values reach the callback without clamping.
  struct Unclamped : Config {
    Unclamped() = default;
    Unclamped(const Config& config) : Config(config) {}  // NOLINT: Server assigns one to the other
    void __clamp__() {}
  };

  static void checkTypes(const ros::NodeHandle& nh) {
    using XmlRpc::XmlRpcValue;
    for (const TunableInfo& field : fieldsOf<Config>()) {
      XmlRpcValue value;
      if (!nh.getParam(field.name, value)) continue;
      const auto type = value.getType();
      const bool whole = type == XmlRpcValue::TypeInt, number = whole || type == XmlRpcValue::TypeDouble;
      const bool fits = field.type == "str"    ? type == XmlRpcValue::TypeString
                        : field.type == "bool" ? type == XmlRpcValue::TypeBoolean
                        : field.type == "int"  ? whole
                                               : number;
      if (!fits)
        throw std::runtime_error("parameter " + nh.resolveName(field.name) + " must be of type " +
                                 field.type);
    }
  }

  static std::string textOf(const Setting& value) {
    if (const auto* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
    if (const auto* text = std::get_if<std::string>(&value)) return *text;
    std::ostringstream text;
    text.precision(10);
    text << std::get<double>(value);
    return text.str();
  }

  /// The differences between two configurations, values as text.
  static std::vector<LiveChanges::Change> differences(const Config& before, const Config& after) {
    std::vector<LiveChanges::Change> found;
    for (const Tunable<Config>& field : fieldsOf<Config>())
      if (field.get(before) != field.get(after))
        found.push_back({field.name, textOf(field.get(before)), textOf(field.get(after))});
    return found;
  }

  void change(Config& config) {
    refusal_ = rangeError(fieldsOf<Config>(), config);
    try {
      if (refusal_.empty()) apply_(config);
    } catch (const std::exception& error) {
      refusal_ = error.what();
    }
    if (refusal_.empty()) {
      const auto changes = differences(current_, config);
      current_ = config;
      if (live_) changes_.report(changes);
    } else {
      if (live_) ROS_ERROR("%s: parameters refused, the old ones kept: %s", name_.c_str(), refusal_.c_str());
      config = current_;
    }
  }

  std::string name_;
  LiveChanges changes_;
  Apply apply_;
  Config current_ = Config::__getDefault__();  ///< guarded by mutex_
  std::string refusal_;  ///< why the last change was refused, or empty; guarded by mutex_
  bool live_ = false;    ///< false until the constructor has applied the first values
  boost::recursive_mutex mutex_;
  CallbackThread callbacks_;
  std::unique_ptr<dynamic_reconfigure::Server<Unclamped>> server_;
};

}  // namespace ground
