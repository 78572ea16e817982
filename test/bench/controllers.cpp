// Computing time of one iteration of each controller while a craft follows a circle at 50 Hz.
#include <benchmark/benchmark.h>

#include <cstdio>
#include <random>
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
  Observation seen;
  seen.reference = reference.get();
  double t = 0;
  for (auto _ : state) {
    seen.stamp = seen.now = t;
    const Thrusters<double> inputs = controller.decide(seen);
    controller.commanded(t, inputs, 1);
    dynamics.step(t, seen.state, {{inputs, inputs, inputs}, 1, true}, kPeriod / 4, 4);
    benchmark::DoNotOptimize(seen.state);
  }
}

Model craft() {
  return loadModel(std::string(GROUND_WORKSPACE) + "/cfg/hovercraft/tiny_whoover.yaml");
}

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

/// Prints body and gains, then cases for a peer: states, references and the inputs of the law.
void printCases() {
  const Model model = craft();
  const Body<double>& b = model.body;
  const TrackingGains g;
  std::printf("%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n", b.m, b.l, b.I_z, b.Y_v, b.N_r, b.k);
  std::printf("%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n", g.k_e, g.k_z, g.k_phi_1, g.k_phi_2,
              g.delta_1, g.delta_2);
  const TrackingLaw law(model);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int i = 0; i < 500; ++i) {
    RigidState<double> state;
    ReferencePoint reference;
    for (int c = 0; c < 3; ++c) state.eta(c) = uniform(random);
    for (int c = 0; c < 3; ++c) state.nu(c) = uniform(random);
    for (Vector2<double>* of :
         {&reference.p, &reference.p_dot, &reference.p_ddot, &reference.p_dddot})
      *of = {uniform(random), uniform(random)};
    const Thrusters<double> inputs = law.run(state, reference, g).inputs;
    for (const double x : state.eta) std::printf("%.17g,", x);
    for (const double x : state.nu) std::printf("%.17g,", x);
    for (const Vector2<double>* of :
         {&reference.p, &reference.p_dot, &reference.p_ddot, &reference.p_dddot})
      std::printf("%.17g,%.17g,", of->x(), of->y());
    std::printf("%.17g,%.17g\n", inputs(0), inputs(1));
  }
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "--cases") {
    ground::printCases();
    return 0;
  }
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
