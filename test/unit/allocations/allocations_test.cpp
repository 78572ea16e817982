// Iterations of the controllers do not allocate memory.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <new>

#include "ground/control/prbs.h"
#include "ground/control/predictive_control.h"
#include "ground/control/reference_trajectory.h"
#include "ground/control/tracking_law.h"
#include "ground/estimation/model_monitor.h"
#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"
#include "ground/safety/obedience_monitor.h"
#include "ground/simulation/model_craft.h"

namespace {
std::atomic<long> allocations{0};

void* allocate(std::size_t size, std::size_t alignment) {
  ++allocations;
  void* memory = nullptr;
  if (posix_memalign(&memory, alignment, size) != 0) throw std::bad_alloc();
  return memory;
}

// Not inlined: where only a delete is, gcc 12 warns that what `new` returned is freed.
[[gnu::noinline]] void release(void* memory) noexcept { std::free(memory); }
}  // namespace

void* operator new(std::size_t size) { return allocate(size, 16); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  return allocate(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* memory) noexcept { release(memory); }
void operator delete(void* memory, std::size_t) noexcept { release(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { release(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { release(memory); }

namespace ground {
namespace {

/// Number of allocations in `count` iterations on a circle, after 100 others.
long allocationsOf(TrackingController& controller, const Model& model, int count) {
  ReferenceParams params;
  params.kind = "circle";
  params.size = 1.5;
  params.rate_of_turn = 0.4;
  const ReferencePtr reference = makeReference(params);
  const Dynamics<double> dynamics(model);
  Observation seen{0, 0, {}, nullptr, 0, {1, std::nullopt}, 0};
  seen.reference = reference.get();
  std::vector<double> actuators(static_cast<std::size_t>(dynamics.stateCount()), 0.0);
  double t = 0;
  long before = 0;
  for (int i = -100; i < count; ++i) {
    seen.stamp = seen.now = t;
    seen.pose = poseMeasurement(seen.state.eta, 3e-4, 5e-3);
    if (i == 0) before = allocations;
    const Thrusters<double> inputs = controller.decide(seen);
    controller.commanded(t, inputs, 1);
    EXPECT_TRUE(asVector(inputs).allFinite());
    dynamics.step(t, seen.state, dynamics.actuate(inputs, {1, std::nullopt}, 0.02, actuators.data()), 0.02);
  }
  return allocations - before;
}

TEST(Allocations, NoneByTheTrackingLaw) {
  const Model model = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  BacksteppingControl controller(model, {});
  EXPECT_EQ(allocationsOf(controller, model, 200), 0);
}

TEST(Allocations, NoneByThePredictiveControllerWithEffects) {
  Model model = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  for (const char* effect : {"motor_lag", "input_delay", "quadratic_drag", "marker_offset"})
    model.addEffect(makeEffect(effect));
  model.setValue("motor_lag.tau", 0.05);
  model.setValue("input_delay.delay", 0.01);
  PredictiveControl controller(model, {});
  EXPECT_EQ(allocationsOf(controller, model, 200), 0);
}

TEST(Allocations, NoneByControllersOfEightThrusters) {
  const Model model = loadModel("cfg/craft/air_table.yaml");
  PredictiveControl predictive(model, {});
  EXPECT_EQ(allocationsOf(predictive, model, 50), 0);
  TrackingGains gains;
  gains.k_z = 0.1;
  BacksteppingControl backstepping(model, gains);
  EXPECT_EQ(allocationsOf(backstepping, model, 200), 0);
}

TEST(Allocations, NoneByCommandsAfterHours) {
  // What is kept for later is bounded: old commands make room for new ones.
  const Model model = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  ObedienceMonitor obedience(model);
  ModelMonitor comparison(model, {});
  ModelCraft craft(model, {});
  const auto play = [&](int from, int to) {
    for (int i = from; i < to; ++i) {
      const double time = 0.02 * i;
      obedience.command(time, {0.5, 0.4}, 1);
      comparison.command(time, {0.5, 0.4}, 1);
      if (i % 50 == 0) craft.advance(time);
      craft.command({0.5, 0.4}, 1);
    }
  };
  play(0, 50000);
  const long before = allocations;
  play(50000, 150000);
  EXPECT_EQ(allocations, before);
}

}  // namespace
}  // namespace ground
