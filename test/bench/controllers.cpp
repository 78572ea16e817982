// Computing time of one iteration of each controller while a craft follows a circle at 50 Hz.
#include <benchmark/benchmark.h>

#include <string>

#include "ground/control/predictive_control.h"
#include "ground/control/reference_trajectory.h"
#include "ground/control/tracking_law.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"

namespace ground {
namespace {

constexpr double kPeriod = 0.02;  // [s]

void iterate(benchmark::State& state, const Model& model, TrackingController& controller) {
  ReferenceParams params;
  params.kind = "circle";
  params.size = 1.5;
  params.rate_of_turn = 0.4;
  const ReferencePtr reference = makeReference(params);
  const Dynamics<double> dynamics(model);
  Observation seen{0, 0, {}, nullptr, 0, {1, std::nullopt}, 0};
  seen.reference = reference.get();
  double t = 0;
  for (auto _ : state) {
    seen.stamp = seen.now = t;
    seen.pose = poseMeasurement(seen.state.eta, 3e-4, 5e-3);
    const Thrusters<double> inputs = controller.decide(seen);
    controller.commanded(t, inputs, 1);
    dynamics.step(t, seen.state, {{inputs, inputs, inputs}, {1, std::nullopt}, true}, kPeriod / 4, 4);
    benchmark::DoNotOptimize(seen.state);
  }
}

Model craft() { return loadModel(std::string(GROUND_WORKSPACE) + "/cfg/hovercraft/tiny_whoover.yaml"); }

void backstepping(benchmark::State& state) {
  const Model model = craft();
  BacksteppingControl controller(model, {});
  iterate(state, model, controller);
}
BENCHMARK(backstepping)->Name("TrajectoryTracking (backstepping)");

void predictive(benchmark::State& state) {
  const Model model = craft();
  PredictiveControl controller(model, {});
  iterate(state, model, controller);
}
BENCHMARK(predictive)->Name("ModelPredictive");

}  // namespace
}  // namespace ground

BENCHMARK_MAIN();
