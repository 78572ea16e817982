#include "ground/model/tunable.h"

#include <cmath>
#include <cstdio>
#include <limits>

namespace ground {
namespace {

template <class Value>
const Value& held(const Setting& setting, const std::string& name, const char* what) {
  const Value* const value = std::get_if<Value>(&setting);
  if (!value) throw std::invalid_argument(name + " must be " + what);
  return *value;
}

template <class Whole>
Whole wholeNumber(const Setting& setting, const std::string& name) {
  const double value = held<double>(setting, name, "a whole number");
  const auto low = static_cast<double>(std::numeric_limits<Whole>::min());
  const auto high = static_cast<double>(std::numeric_limits<int>::max());
  if (!(value >= low && value <= high) || value != std::floor(value))
    throw std::invalid_argument(name + " must be a whole number");
  return static_cast<Whole>(value);
}

}  // namespace

std::string TunableInfo::rangeError(const Setting& setting) const {
  const double* const value = std::get_if<double>(&setting);
  if (!value || (*value >= low && *value <= high)) return "";
  char range[100];
  std::snprintf(range, sizeof range, " must be between %g and %g", low, high);
  char given[40];
  std::snprintf(given, sizeof given, ", not %g", *value);
  return name + range + (unit.empty() || unit == "-" ? "" : " " + unit) + given;
}

namespace detail {

Setting settingOf(double value) { return value; }
Setting settingOf(int value) { return static_cast<double>(value); }
Setting settingOf(unsigned long value) { return static_cast<double>(value); }
Setting settingOf(bool value) { return value; }
Setting settingOf(const std::string& value) { return value; }

void assign(double& value, const Setting& setting, const std::string& name) {
  value = held<double>(setting, name, "a number");
}
void assign(int& value, const Setting& setting, const std::string& name) {
  value = wholeNumber<int>(setting, name);
}
void assign(unsigned long& value, const Setting& setting, const std::string& name) {
  value = wholeNumber<unsigned long>(setting, name);
}
void assign(bool& value, const Setting& setting, const std::string& name) {
  value = held<bool>(setting, name, "true or false");
}
void assign(std::string& value, const Setting& setting, const std::string& name) {
  value = held<std::string>(setting, name, "a string");
}

}  // namespace detail
}  // namespace ground
