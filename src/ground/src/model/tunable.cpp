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

}  // namespace

std::string TunableInfo::rangeError(const Setting& setting) const {
  const double* const value = std::get_if<double>(&setting);
  if (!value || (*value >= low && *value <= high)) return "";
  char range[100];
  std::snprintf(range, sizeof range, " must be between %g and %g", low, high);
  char given[40];
  std::snprintf(given, sizeof given, ", not %g", *value);
  const bool is_range = unit.find("..") != std::string::npos;
  return name + range + (unit.empty() || unit == "-" || is_range ? "" : " " + unit) + given;
}

namespace detail {

Setting settingOf(double value) { return value; }
Setting settingOf(int value) { return static_cast<double>(value); }
Setting settingOf(bool value) { return value; }
Setting settingOf(const std::string& value) { return value; }

void assign(double& value, const Setting& setting, const std::string& name) {
  value = held<double>(setting, name, "a number");
}
void assign(int& value, const Setting& setting, const std::string& name) {
  const double given = held<double>(setting, name, "a whole number");
  if (!(std::abs(given) <= std::numeric_limits<int>::max()) || given != std::floor(given))
    throw std::invalid_argument(name + " must be a whole number");
  value = static_cast<int>(given);
}
void assign(bool& value, const Setting& setting, const std::string& name) {
  value = held<bool>(setting, name, "true or false");
}
void assign(std::string& value, const Setting& setting, const std::string& name) {
  value = held<std::string>(setting, name, "a string");
}

}  // namespace detail
}  // namespace ground
