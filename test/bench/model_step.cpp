// Computing time of a model step: velocities alone, with pose, with five sensitivities, with
// effects.
#include <benchmark/benchmark.h>

#include <map>
#include <string>

#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"

namespace ground {
namespace {

constexpr double kStep = 0.005;  // [s]

Model craft(const std::string& effects) {
  Model model = loadModel(std::string(GROUND_WORKSPACE) + "/cfg/hovercraft/tiny_whoover.yaml");
  const auto add = [&](const std::string& name, const std::map<std::string, double>& values) {
    model.addEffect(makeEffect(name));
    for (const auto& [parameter, value] : values) model.setValue(name + "." + parameter, value);
  };
  if (effects == "drag") add("quadratic_drag", {{"cx", 0.002}, {"cy", 0.002}, {"cr", 1e-6}});
  if (effects == "lag") add("motor_lag", {{"tau", 0.05}});
  if (effects == "three") {
    add("motor_lag", {{"tau", 0.05}});
    add("floor_tilt", {{"sx", 0.01}, {"sy", -0.01}});
    add("quadratic_drag", {{"cx", 0.002}, {"cy", 0.002}, {"cr", 1e-6}});
  }
  return model;
}

/// Coordinates of the model, with derivatives by I_z, X_u, Y_v, N_r and k if T has derivatives.
template <typename T>
std::vector<T> coordinates(const Model& model) {
  const std::vector<double> values = model.coordinates();
  std::vector<T> result(values.begin(), values.end());
  if constexpr (!std::is_same_v<T, double>) {
    int at = 0;
    for (const char* name : {"I_z", "X_u", "Y_v", "N_r", "k"})
      result[static_cast<std::size_t>(model.index(name))].v[at++] = 1.0;
  }
  return result;
}

constexpr int kSteps = 1000;

/// Inputs that change every tenth step.
InputSequence makeInputs() {
  InputSequence inputs;
  for (int i = 0; i < kSteps; i += 10) inputs.add(i * kStep, (i / 10) % 2, (i / 20) % 2, 1);
  return inputs;
}

void count(benchmark::State& state, int steps) {
  state.counters["per step"] =
      benchmark::Counter(static_cast<double>(steps) * static_cast<double>(state.iterations()),
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

/// One simulation of kSteps steps.
template <typename T>
void step(benchmark::State& state, const std::string& effects, bool pose) {
  const Model model = craft(effects);
  const Dynamics<T> dynamics(model, coordinates<T>(model));
  const InputSequence inputs = makeInputs();
  for (auto _ : state) {
    Simulation<T> simulation(dynamics, inputs, {}, 0);
    if (!pose) simulation.forgetPose();
    simulation.advance(kSteps * kStep);
    benchmark::DoNotOptimize(simulation.state());
  }
  count(state, kSteps);
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  struct Case {
    const char *name, *effects;
    bool pose;
  };
  for (const Case c :
       {Case{"velocities", "", false}, Case{"velocities and pose", "", true},
        Case{"velocities, quadratic drag", "drag", false}, Case{"velocities, motor lag", "lag", false},
        Case{"velocities and pose, three effects", "three", true}}) {
    const std::string name = c.name;
    const auto add = [&](const char* what, auto function) {
      benchmark::RegisterBenchmark((name + what).c_str(), [c, function](benchmark::State& state) {
        function(state, c.effects, c.pose);
      });
    };
    add(": state", ground::step<double>);
    add(": five sensitivities", ground::step<ground::Jet>);
  }
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
