// Bindings of a model's equations, for those who write them in another language.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <string>
#include <vector>

#include "bindings.h"
#include "ground/model/dynamics.h"
#include "ground/model/expression_effect.h"
#include "ground/model/symbol.h"

namespace py = pybind11;

namespace ground {
namespace {

/// The model without effects whose values change nothing: a Dynamics never computes them.
Model acting(const Model& model) {
  Model reduced = model;
  for (const Model::Entry& entry : model.effects)
    if (entry.isNeutral()) reduced.removeEffect(entry.effect->info().name);
  return reduced;
}

std::vector<std::string> stateNames(const Model& model) {
  std::vector<std::string> names;
  for (const Model::Entry& entry : model.effects) {
    const EffectInfo& info = entry.effect->info();
    const ExpressionDefinition* const formulas = expressionDefinition(*entry.effect);
    for (int i = 0; i < info.states; ++i)
      names.push_back(
          info.name + "." +
          (formulas ? formulas->states[static_cast<std::size_t>(i)].name : std::to_string(i + 1)));
    for (int k = 0; k < info.states_per_thruster; ++k)
      for (const Thruster& one : model.thrusters->thrusters())
        names.push_back(info.name + "." + one.name + (k ? std::to_string(k + 1) : ""));
  }
  return names;
}

/// Places of symbols in the Trace.
template <class Symbols>
py::list placesOf(const Symbols& symbols) {
  py::list places;
  for (const Symbol& x : symbols) places.append(Trace::current().placeOf(x));
  return places;
}

/// A model with everything that it depends on as a Symbol.
struct SymbolicModel {
  Trace trace;
  Dynamics<Symbol> dynamics;
  RigidState<Symbol> state;
  std::vector<Symbol> states;
  Thrusters<Symbol> input;
  Symbol lift, volts, t, dt;

  explicit SymbolicModel(const Model& model)
      : dynamics(model, coordinates(model)),
        input(Thrusters<Symbol>::zero(model.thrusters->size())),
        lift(trace.variable("input lift")),
        volts(trace.variable("voltage")),
        t(trace.variable("t")),
        dt(trace.variable("dt")) {
    for (int i = 0; i < 3; ++i) {
      state.eta(i) = trace.variable(std::string("state ") + kNames[i]);
      state.nu(i) = trace.variable(std::string("state ") + kNames[3 + i]);
    }
    for (const std::string& name : stateNames(model)) states.push_back(trace.variable("state " + name));
    for (int i = 0; i < input.size(); ++i) input(i) = trace.variable("input " + (*model.thrusters)[i].name);
  }

  /// Time derivatives of the pose, of the velocity and of those states that have rates, at inputs that act.
  py::list motion() {
    std::vector<Symbol> rates(states.size(), Symbol(0.0));
    const RigidState<Symbol> dot =
        dynamics.derivative(t, state, input, {lift, volts}, states.data(), rates.data());
    std::vector<Symbol> all(dot.eta.data(), dot.eta.data() + 3);
    all.insert(all.end(), dot.nu.data(), dot.nu.data() + 3);
    all.insert(all.end(), rates.begin(), rates.end());
    return placesOf(all);
  }
  /// What the actuators make of a command: the inputs that act at three nodes of a step and the states after
  /// it; the inputs that act at an instant and the rates of the states.
  void actuate(py::dict& outputs) {
    std::vector<Symbol> after = states;
    const StepInputs<Symbol> inputs = dynamics.actuate(input, {lift, volts}, dt, after.data());
    if (inputs.held) return;
    py::list nodes;
    for (const Thrusters<Symbol>& node : inputs.thrusters) {
      std::vector<Symbol> all(node.begin(), node.end());
      all.push_back(lift);
      nodes.append(placesOf(all));
    }
    outputs["nodes"] = nodes;
    outputs["after"] = placesOf(after);
    std::vector<Symbol> now, rates(6, Symbol(0.0));
    for (const Symbol& x : inputs.thrusters[0]) now.push_back(trace.at(x, dt, 0));
    now.push_back(lift);
    for (const Symbol& x : after) rates.push_back(trace.at(trace.derivative(x, dt), dt, 0));
    outputs["now"] = placesOf(now);
    outputs["rates"] = placesOf(rates);
  }
  py::list measured() {
    const Measurement<Symbol> measurement = dynamics.measure(state);
    std::vector<Symbol> all(measurement.eta.data(), measurement.eta.data() + 3);
    all.insert(all.end(), measurement.nu.data(), measurement.nu.data() + 3);
    return placesOf(all);
  }

  /// Throws std::invalid_argument if something depends on the voltage.
  void requireNoVoltage() const {
    for (const Operation& one : trace.operations())
      for (const int place : one.arguments)
        if (place == volts.place)
          throw std::invalid_argument(
              "it depends on the voltage of the battery, which the code has no input for; without this "
              "effect the "
              "thrust is that at the voltage `volts` of the body");
  }

  static constexpr const char* kNames[] = {"x", "y", "psi", "u", "v", "r"};

 private:
  static std::vector<Symbol> coordinates(const Model& model) {
    std::vector<Symbol> all;
    const std::vector<double> values = model.values();
    for (const ParameterInfo& info : model.parameters()) {
      const Symbol value = Trace::current().parameter("parameter " + info.name, values[all.size()]);
      all.push_back(info.coordinate == Coordinate::kReciprocal ? 1.0 / value : value);
    }
    return all;
  }
};

py::dict outputsOf(const Model& model, py::dict& result) {
  SymbolicModel symbolic(model);
  py::dict outputs;
  outputs["motion"] = symbolic.motion();
  symbolic.actuate(outputs);
  outputs["measured"] = symbolic.measured();
  symbolic.requireNoVoltage();
  outputs["delay"] = symbolic.trace.placeOf(symbolic.dynamics.inputDelay());
  py::list operations;
  for (const Operation& one : symbolic.trace.operations())
    operations.append(py::make_tuple(one.name, one.label, one.arguments, one.value));
  result["operations"] = operations;
  return outputs;
}

/// The model with one of its effects, or without any.
Model withOnly(const Model& model, const std::string& name) {
  Model one = model;
  for (const Model::Entry& entry : model.effects)
    if (entry.effect->info().name != name) one.removeEffect(entry.effect->info().name);
  return one;
}

py::dict equations(const Model& given) {
  const Model model = acting(given);
  py::dict result;
  try {
    result["outputs"] = outputsOf(model, result);
  } catch (const std::invalid_argument&) {
    for (const Model::Entry& entry : model.effects) {
      const std::string name = entry.effect->info().name;
      try {
        outputsOf(withOnly(model, name), result);
      } catch (const std::invalid_argument& error) {
        throw std::invalid_argument("effect " + name + " cannot be exported: " + error.what());
      }
    }
    throw;
  }
  result["model"] = model;
  result["states"] = stateNames(model);
  result["initial"] = Dynamics<double>(model).initialStates();
  return result;
}

/// One row of evaluate().
struct Row {
  RigidState<double> state;
  std::vector<double> states;
  Thrusters<double> input;
  double lift, t, dt;
};

Eigen::VectorXd joined(const RigidState<double>& state, const std::vector<double>& states) {
  Eigen::VectorXd all(6 + static_cast<Eigen::Index>(states.size()));
  all << state.eta, state.nu, asColumn(states);
  return all;
}

Eigen::VectorXd derivativeAt(const Dynamics<double>& dynamics, const Dynamics<Jet>& exact, const Row& row) {
  std::vector<double> rates(row.states.size(), 0.0), states = row.states;
  const Thrusters<double> now =
      dynamics.actuate(row.input, {row.lift, std::nullopt}, 0.0, states.data()).thrusters[0];
  const RigidState<double> dot =
      dynamics.derivative(row.t, row.state, now, {row.lift, std::nullopt}, row.states.data(), rates.data());
  std::vector<Jet> after(row.states.begin(), row.states.end());
  exact.actuate(row.input.cast<Jet>(), {row.lift, std::nullopt}, Jet(0.0, 0), after.data());
  for (std::size_t i = 0; i < rates.size(); ++i) rates[i] += after[i].v[0];
  return joined(dot, rates);
}

Eigen::VectorXd stepFrom(const Dynamics<double>& dynamics, Row row) {
  const StepInputs<double> inputs =
      dynamics.actuate(row.input, {row.lift, std::nullopt}, row.dt, row.states.data());
  dynamics.step(row.t, row.state, inputs, row.dt);
  return joined(row.state, row.states);
}

py::dict evaluate(const Model& given, const Eigen::MatrixXd& states, const Eigen::MatrixXd& inputs,
                  const std::vector<double>& t, const std::vector<double>& dt) {
  const Model model = acting(given);
  const Dynamics<double> dynamics(model);
  const Dynamics<Jet> exact(model);
  const Eigen::Index count = states.rows(), width = 6 + dynamics.stateCount(), thrusters = inputs.cols() - 1;
  dynamics.requireThrusters(static_cast<int>(thrusters));
  if (states.cols() != width || inputs.rows() != count || static_cast<Eigen::Index>(t.size()) != count ||
      static_cast<Eigen::Index>(dt.size()) != count)
    throw std::invalid_argument("states, inputs, t and dt do not go together");
  Eigen::MatrixXd derivative(count, width), step(count, width), measured(count, 6);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::VectorXd own = states.row(i).tail(width - 6);
    const Row row{{states.row(i).head<3>().transpose(), states.row(i).segment<3>(3).transpose()},
                  {own.data(), own.data() + own.size()},
                  Thrusters<double>(inputs.row(i).head(thrusters).transpose()),
                  inputs(i, thrusters),
                  t[static_cast<std::size_t>(i)],
                  dt[static_cast<std::size_t>(i)]};
    derivative.row(i) = derivativeAt(dynamics, exact, row);
    step.row(i) = stepFrom(dynamics, row);
    const Measurement<double> seen = dynamics.measure(row.state);
    measured.row(i) << seen.eta.transpose(), seen.nu.transpose();
  }
  return py::dict("derivative"_a = derivative, "step"_a = step, "measure"_a = measured,
                  "delay"_a = dynamics.inputDelay());
}

}  // namespace

void bindEquations(py::module_& module) {
  module.def(
      "equations", &equations, "model"_a,
      "The equations of a model, effect by effect, as straight-line code. `operations`: name, label, places "
      "of the arguments, value (ground/model/symbol.h); `outputs`: places of what the equations give; "
      "`states`: names of the effects' states, and their `initial` values; `model`: with the effects that "
      "act. Raises ValueError for an effect that cannot be written down.");
  module.def(
      "evaluate", &evaluate, "model"_a, "states"_a, "inputs"_a, "t"_a, "dt"_a,
      "What equations() describes, computed by the core: `derivative` and `step` (n, 6 + k), `measure` "
      "(n, 6), `delay` [s]. A row of `states` has x, y, psi, u, v, r and the states of the effects that "
      "act; one of `inputs` the thrusters and the lift.");
}

}  // namespace ground
