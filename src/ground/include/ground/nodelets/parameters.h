#pragma once

#include <dynamic_reconfigure/server.h>
#include <ros/ros.h>

#include <algorithm>
#include <boost/any.hpp>
#include <boost/thread/recursive_mutex.hpp>
#include <cmath>
#include <functional>
#include <iomanip>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
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

/// The field with this name in a dynamic_reconfigure class, or null.
template <class Config>
auto findField(const std::string& name) {
  const auto& fields = Config::__getParamDescriptions__();
  const auto found =
      std::find_if(fields.begin(), fields.end(), [&](const auto& field) { return field->name == name; });
  return found == fields.end() ? typename std::decay_t<decltype(*found)>() : *found;
}

/// Sets `params` from the fields with the same names in a dynamic_reconfigure class; throws
/// std::logic_error if one is missing.
template <class Params, class Config>
void takeFields(Params& params, const Tunables<Params>& table, const Config& config) {
  for (const Tunable<Params>& one : table) {
    const auto field = findField<Config>(one.name);
    if (!field) throw std::logic_error("the .cfg file has no parameter " + one.name);
    boost::any value;
    field->getValue(config, value);
    if (field->type == "double") one.set(params, boost::any_cast<double>(value));
    if (field->type == "int") one.set(params, static_cast<double>(boost::any_cast<int>(value)));
    if (field->type == "bool") one.set(params, boost::any_cast<bool>(value));
    if (field->type == "str") one.set(params, boost::any_cast<std::string>(value));
  }
}

/// Parameters that a user tunes while the nodelet runs: a dynamic_reconfigure server that refuses
/// bad values with a reason and keeps the old ones, instead of clamping them. Accepted changes are
/// logged and published (LiveChanges). It has its own thread, so that a slow validation does not
/// block the nodelet.
template <class Config>
class LiveParameters {
 public:
  /// Error message for values that are finite and inside the ranges of the .cfg file; empty if they
  /// are valid.
  using Validate = std::function<std::string(const Config&)>;
  /// Applies valid values; called once from the constructor and at every accepted change. Values at
  /// which it throws are refused.
  using Apply = std::function<void(const Config&)>;

  /// Throws std::runtime_error if the values on the parameter server are bad.
  LiveParameters(const ros::NodeHandle& nh, Validate validate, Apply apply)
      : name_(nh.getNamespace()), changes_(nh), validate_(std::move(validate)), apply_(std::move(apply)) {
    checkTypes(nh);
    using Server = dynamic_reconfigure::Server<Unclamped>;
    server_ = std::make_unique<Server>(mutex_, callbacks_.handle(nh));
    server_->setCallback([this](Unclamped& config, uint32_t) { change(config); });
    const boost::recursive_mutex::scoped_lock lock(mutex_);
    if (!refusal_.empty()) throw std::runtime_error(refusal_);
    live_ = true;
  }
  ~LiveParameters() { callbacks_.stop(); }

 private:
  /// Config whose values reach the callback without clamping.
  struct Unclamped : Config {
    Unclamped() = default;
    Unclamped(const Config& config) : Config(config) {}  // NOLINT: Server assigns one to the other
    void __clamp__() {}
  };

  static void checkTypes(const ros::NodeHandle& nh) {
    using XmlRpc::XmlRpcValue;
    for (const auto& parameter : Config::__getParamDescriptions__()) {
      XmlRpcValue value;
      if (!nh.getParam(parameter->name, value)) continue;
      const auto type = value.getType();
      const bool fits = parameter->type == "str"    ? type == XmlRpcValue::TypeString
                        : parameter->type == "bool" ? type == XmlRpcValue::TypeBoolean
                        : parameter->type == "int"
                            ? type == XmlRpcValue::TypeInt
                            : type == XmlRpcValue::TypeDouble || type == XmlRpcValue::TypeInt;
      if (!fits)
        throw std::runtime_error("parameter " + nh.resolveName(parameter->name) + " must be of type " +
                                 parameter->type);
    }
  }

  std::string wrong(const Config& config) const {
    dynamic_reconfigure::Config value, lower, upper;
    config.__toMessage__(value);
    Config::__getMin__().__toMessage__(lower);
    Config::__getMax__().__toMessage__(upper);
    const auto outside = [](const auto& values, const auto& lows, const auto& highs) {
      for (std::size_t i = 0; i < values.size(); ++i) {
        const double x = values[i].value;
        if (!std::isfinite(x) || x < lows[i].value || x > highs[i].value) {
          std::ostringstream text;
          text << values[i].name << " = " << x << " is outside [" << lows[i].value << ", " << highs[i].value
               << "]";
          return text.str();
        }
      }
      return std::string();
    };
    std::string reason = outside(value.doubles, lower.doubles, upper.doubles);
    if (reason.empty()) reason = outside(value.ints, lower.ints, upper.ints);
    return reason.empty() && validate_ ? validate_(config) : reason;
  }

  /// The differences between two configurations, values as text.
  static std::vector<LiveChanges::Change> differences(const Config& from, const Config& to) {
    dynamic_reconfigure::Config before, after;
    from.__toMessage__(before);
    to.__toMessage__(after);
    std::vector<LiveChanges::Change> found;
    const auto compare = [&found](const auto& olds, const auto& news) {
      const auto text = [](const auto& value) {
        std::ostringstream stream;
        stream << std::setprecision(10) << value;
        return stream.str();
      };
      for (std::size_t i = 0; i < news.size(); ++i)
        if (olds[i].value != news[i].value)
          found.push_back({news[i].name, text(olds[i].value), text(news[i].value)});
    };
    compare(before.doubles, after.doubles);
    compare(before.ints, after.ints);
    compare(before.strs, after.strs);
    const auto word = [](bool value) { return value ? "true" : "false"; };
    for (std::size_t i = 0; i < after.bools.size(); ++i)
      if (before.bools[i].value != after.bools[i].value)
        found.push_back({after.bools[i].name, word(before.bools[i].value), word(after.bools[i].value)});
    return found;
  }

  void change(Config& config) {
    refusal_ = wrong(config);
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
  Validate validate_;
  Apply apply_;
  Config current_ = Config::__getDefault__();  ///< guarded by mutex_
  std::string refusal_;  ///< why the last change was refused, or empty; guarded by mutex_
  bool live_ = false;    ///< false until the constructor has applied the first values
  boost::recursive_mutex mutex_;
  CallbackThread callbacks_;
  std::unique_ptr<dynamic_reconfigure::Server<Unclamped>> server_;
};

}  // namespace ground
