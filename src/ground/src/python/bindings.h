// Declarations shared by the files of the Python module.
#pragma once

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <Eigen/Core>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "ground/identification/simulation_error.h"
#include "ground/model/tunable.h"

namespace ground {

using pybind11::literals::operator""_a;

/// Each adds the classes and functions of a library to the module. Call them in this order, because
/// libraries use classes of earlier ones.
void bindModel(pybind11::module_& module);
void bindEquations(pybind11::module_& module);
void bindEstimation(pybind11::module_& module);
void bindControl(pybind11::module_& module);
void bindSimulation(pybind11::module_& module);
void bindIdentification(pybind11::module_& module);
void bindGreyBox(pybind11::module_& module);

/// Inputs from rows of time [s], an input for each thruster in the order of the model, lift;
/// ascending in time. Throws std::invalid_argument on other columns and on values that are not
/// finite.
/// battery: rows of time [s], voltage [V]; none by default.
InputSequence toInputs(const Eigen::Ref<const Eigen::MatrixXd>& rows,
                       const std::optional<Eigen::MatrixX2d>& battery = std::nullopt);

/// A row of inputs.
Eigen::RowVectorXd inputRow(double time, const Thrusters<double>& thrusters, double lift);

/// A dictionary for each parameter: name, unit, start, value, ci95, deviation, at_bound,
/// identified.
pybind11::list toList(const std::vector<FittedParameter>& parameters);

/// A matrix that need not be given. Its default is None, because an array as default would load numpy
/// with the module, and launch files start programs that do not need it.
using OptionalMatrix = std::optional<Eigen::MatrixXd>;
inline Eigen::MatrixXd orEmpty(const OptionalMatrix& matrix) { return matrix.value_or(Eigen::MatrixXd()); }

inline Eigen::Map<const Eigen::VectorXd> asColumn(const std::vector<double>& values) {
  return {values.data(), static_cast<Eigen::Index>(values.size())};
}

/// Throws std::invalid_argument if a number is not finite; `what` names it.
template <class Numbers>
void requireFinite(const Eigen::DenseBase<Numbers>& numbers, const std::string& what) {
  if (!numbers.allFinite()) throw std::invalid_argument(what + " is not finite");
}

/// Matrix with one row fill(entry) for each entry.
template <typename Entry, typename Fill>
Eigen::MatrixXd toRows(const std::vector<Entry>& entries, int columns, Fill fill) {
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(entries.size()), columns);
  for (Eigen::Index i = 0; i < rows.rows(); ++i) rows.row(i) = fill(entries[static_cast<std::size_t>(i)]);
  return rows;
}

/// Calls compute() without Python's global lock and returns its result.
template <class Compute>
auto withoutGil(const Compute& compute) {
  const pybind11::gil_scoped_release release;
  return compute();
}

/// How a struct passes to other processes: by its members, in the order of its initialiser.
template <class Struct, class... Members>
auto pickledBy(Members Struct::*... members) {
  return pybind11::pickle([=](const Struct& s) { return std::tuple<Members...>(s.*members...); },
                          [](std::tuple<Members...> all) {
                            return std::apply([](auto&... each) { return Struct{std::move(each)...}; }, all);
                          });
}

/// Defines a property for each parameter in the table of a class or its base.
template <class Class, class Params>
void defFields(Class& type, const Tunables<Params>& table) {
  using Type = typename Class::type;
  for (const Tunable<Params>& one : table)
    type.def_property(
        one.name.c_str(), [get = one.get](const Type& params) { return get(params); },
        [set = one.set](Type& params, const Setting& value) { set(params, value); });
}

}  // namespace ground
