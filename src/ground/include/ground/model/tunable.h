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

/// Range in which `tune` searches a parameter: sign * 10^low .. sign * 10^high. If sign is 0, it
/// does not search.
struct SearchRange {
  int sign = 0;
  double low = 0, high = 0;
};

/// Description of a parameter, for documentation, dynamic_reconfigure and the command line.
struct TunableInfo {
  std::string name, unit, text;
  double low = 0, high = 0;  ///< range of a number, both ends allowed
  SearchRange search = {};
  std::string type = {};  ///< as in dynamic_reconfigure: double, int, bool or str
  Setting standard = {};  ///< the default

  /// Error such as "k_e must be between 1e-06 and 100 kg/s, not -1"; empty if `value` is in the
  /// range or is not a number.
  std::string rangeError(const Setting& value) const;
};

namespace detail {

/// Whether values of a type are stored as a double.
template <class Value>
constexpr bool isNumber = std::is_arithmetic<Value>::value && !std::is_same<Value, bool>::value;

template <class Value>
Setting settingOf(const Value& value) {
  if constexpr (isNumber<Value>) return static_cast<double>(value);
  if constexpr (!isNumber<Value>) return value;
}

/// Throws std::invalid_argument that names the parameter if `setting` has another type or is not an
/// integer that fits.
template <class Value>
void assign(Value& value, const Setting& setting, const std::string& name) {
  using Stored = std::conditional_t<isNumber<Value>, double, Value>;
  constexpr bool whole = std::is_integral<Value>::value && isNumber<Value>;
  const Stored* const stored = std::get_if<Stored>(&setting);
  bool fits = stored;
  if constexpr (whole)
    fits = fits && *stored >= static_cast<double>(std::numeric_limits<Value>::min()) &&
           *stored <= std::numeric_limits<int>::max() && *stored == std::floor(*stored);
  if (!fits)
    throw std::invalid_argument(name + " must be " +
                                (whole                              ? "a whole number"
                                 : isNumber<Value>                  ? "a number"
                                 : std::is_same<Value, bool>::value ? "true or false"
                                                                    : "a string"));
  value = static_cast<Value>(*stored);
}

template <class Value>
const char* typeName() {
  if (std::is_same<Value, bool>::value) return "bool";
  if (std::is_integral<Value>::value) return "int";
  return std::is_same<Value, double>::value ? "double" : "str";
}

}  // namespace detail

/// A parameter in a struct: its description and its member, so that code can list, check, get and
/// set it by its name. Its default is that of the struct's member.
///
///   struct Gains { double k = 2; };
///   const Tunables<Gains> table = {{{"k", "kg/s", "Position error", 0, 10}, &Gains::k}};
///   table[0].set(gains, 3.0);
template <class Params>
struct Tunable : TunableInfo {
  using Get = std::function<Setting(const Params&)>;
  /// Throws std::invalid_argument on a value of another type; does not check the range.
  using Set = std::function<void(Params&, const Setting&)>;

  /// access: a member of Params, or a function that returns a reference to a part of it.
  template <class Access>
  Tunable(TunableInfo info, Access access) : TunableInfo(std::move(info)) {
    using Value = std::decay_t<std::invoke_result_t<Access, Params&>>;
    get = [access](const Params& params) { return detail::settingOf(std::invoke(access, params)); };
    set = [access, name = name](Params& params, const Setting& setting) {
      detail::assign(std::invoke(access, params), setting, name);
    };
    type = detail::typeName<Value>();
    standard = get(Params());
  }
  /// For a parameter whose type is known; the default is that of Params.
  Tunable(TunableInfo info, Get get_it, Set set_it)
      : TunableInfo(std::move(info)), get(std::move(get_it)), set(std::move(set_it)) {
    standard = get(Params());
  }

  Get get;
  Set set;
};

template <class Params>
using Tunables = std::vector<Tunable<Params>>;

/// The parameters of `Part` as parameters of a struct that has `Part` as a member.
template <class Params, class Part>
Tunables<Params> lifted(Part Params::*part, const Tunables<Part>& table) {
  Tunables<Params> found;
  for (const Tunable<Part>& one : table)
    found.emplace_back(
        one, [part, get = one.get](const Params& params) { return get(params.*part); },
        [part, set = one.set](Params& params, const Setting& s) { set(params.*part, s); });
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
