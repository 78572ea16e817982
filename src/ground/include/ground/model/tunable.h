#pragma once

#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace ground {

/// The value of a parameter that users set; integers are stored as doubles.
using Setting = std::variant<double, bool, std::string>;

/// Description of a parameter, for documentation and the command line.
struct TunableInfo {
  std::string name, unit, text;
  double low = 0, high = 0;  ///< range of a number, both ends allowed
  std::string type = {};     ///< as in dynamic_reconfigure: double, int, bool or str
  Setting standard = {};     ///< the default

  /// Error such as "k_e must be between 1e-06 and 100 kg/s, not -1"; empty if `value` is in the
  /// range or is not a number.
  std::string rangeError(const Setting& value) const;
};

namespace detail {

Setting settingOf(double value);
Setting settingOf(int value);
Setting settingOf(bool value);
Setting settingOf(const std::string& value);
/// These throw std::invalid_argument that names the parameter if `setting` has another type or is
/// not an integer that fits.
void assign(double& value, const Setting& setting, const std::string& name);
void assign(int& value, const Setting& setting, const std::string& name);
void assign(bool& value, const Setting& setting, const std::string& name);
void assign(std::string& value, const Setting& setting, const std::string& name);

template <class Value>
const char* typeName() {
  if (std::is_same<Value, bool>::value) return "bool";
  if (std::is_integral<Value>::value) return "int";
  return std::is_same<Value, double>::value ? "double" : "str";
}

}  // namespace detail

/// A parameter in a struct: its description and its member, so that code can list, check, get and
/// set it by its name. Its default is the default of the struct's member.
///
///   struct Gains { double k = 2; };
///   const Tunables<Gains> table = {{{"k", "kg/s", "Position error", 0, 10}, &Gains::k}};
///   table[0].set(gains, 3.0);
template <class Params>
struct Tunable : TunableInfo {
  using Get = std::function<Setting(const Params&)>;
  /// Throws std::invalid_argument on a value of another type; does not check the range.
  using Set = std::function<void(Params&, const Setting&)>;

  template <class Value>
  Tunable(TunableInfo info, Value Params::*member) : TunableInfo(std::move(info)) {
    get = [member](const Params& params) { return detail::settingOf(params.*member); };
    set = [member, name = name](Params& params, const Setting& setting) {
      detail::assign(params.*member, setting, name);
    };
    type = detail::typeName<Value>();
    standard = get(Params());
  }
  /// For a parameter whose type is known; the default is the member's in Params.
  Tunable(TunableInfo info, Get get_it, Set set_it)
      : TunableInfo(std::move(info)), get(std::move(get_it)), set(std::move(set_it)) {
    standard = get(Params());
  }

  Get get;
  Set set;
};

template <class Params>
using Tunables = std::vector<Tunable<Params>>;

/// The parameters of the bases `Parts` of a struct.
template <class Params, class... Parts>
Tunables<Params> joined(const Tunables<Parts>&... tables) {
  Tunables<Params> found;
  const auto add = [&found](const auto& table) {
    for (const auto& one : table) found.emplace_back(one, one.get, one.set);
  };
  (add(tables), ...);
  return found;
}

/// Error for the first number that is outside its range; empty if there is none.
template <class Params>
std::string rangeError(const Tunables<Params>& table, const Params& params) {
  for (const Tunable<Params>& one : table) {
    const std::string wrong = one.rangeError(one.get(params));
    if (!wrong.empty()) return wrong;
  }
  return "";
}

/// Names of all parameters, such as "k_e, k_z".
template <class Infos>
std::string namesOf(const Infos& infos) {
  std::string names;
  for (const auto& info : infos) names += (names.empty() ? "" : ", ") + info.name;
  return names;
}

/// The entry with this name, or nullptr.
template <class Infos>
auto findNamed(const Infos& infos, const std::string& name) -> decltype(&infos.front()) {
  for (const auto& info : infos)
    if (info.name == name) return &info;
  return nullptr;
}

}  // namespace ground
