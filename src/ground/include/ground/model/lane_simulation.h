#pragma once

#include <vector>

#include "ground/model/simulation.h"

namespace ground {

/// One of the simulations that run side by side.
struct Lane {
  const InputSequence* inputs;
  const double*
      samples;  ///< ascending instants to measure at [s]; the simulation starts at the first
  int count;    ///< of samples, at least one
};

/// The steps of up to eight simulations, known beforehand: each takes its own (see Stepping), none
/// waits for the others. Holds for one delay of the inputs.
class LanePlan {
 public:
  /// Of the instant after a step, or of the start.
  struct Sample {
    int lane, index;
  };
  struct Step {
    Lanes h, by_delay;       ///< length and its derivative by the delay; nothing in lanes that wait
    Vector2<Lanes> command;  ///< held
    Lanes lift;
    int samples;  ///< index behind the last of the samples after this step
  };

  LanePlan(const std::vector<Lane>& lanes, double delay, bool varies,
           double max_step = kDefaultStep);

  /// Runs all lanes from `state`, the actuators settled, and calls visit(samples, count,
  /// measurement) whenever some lanes, one sample each, are to be measured. Without `pose` only
  /// velocities are integrated.
  template <typename T, class Visit>
  void run(const Dynamics<T>& dynamics, RigidState<T> state, bool pose, const Visit& visit) const;

 private:
  Lanes start_;
  std::vector<Step> settling_, steps_;
  std::vector<Sample> samples_;
  int first_samples_ = 0;  ///< those of the start
  bool varies_ = false;
};

/// The instant of a plan's run.
template <typename T>
class LaneRun {
 public:
  LaneRun(const Dynamics<T>& dynamics, const RigidState<T>& state, const Lanes& start, bool pose);
  void settle(const LanePlan::Step& step);
  void take(const LanePlan::Step& step, bool varies);
  Measurement<T> measure() const { return dynamics_.measure(state_); }

 private:
  template <typename H>
  void takeOf(const LanePlan::Step& step, const H& h);

  const Dynamics<T>& dynamics_;
  RigidState<T> state_;
  T time_;
  std::vector<T> actuators_;
  bool pose_;
};

extern template class LaneRun<Lanes>;
extern template class LaneRun<LanesJet>;

template <typename T, class Visit>
void LanePlan::run(const Dynamics<T>& dynamics, RigidState<T> state, bool pose,
                   const Visit& visit) const {
  LaneRun<T> run(dynamics, state, start_, pose);
  if (dynamics.hasActuators())
    for (const Step& step : settling_) run.settle(step);
  int sample = 0;
  const auto show = [&](int end) {
    if (sample < end)
      visit(&samples_[static_cast<std::size_t>(sample)], end - sample, run.measure());
    sample = end;
  };
  show(first_samples_);
  for (const Step& step : steps_) {
    run.take(step, varies_);
    show(step.samples);
  }
}

}  // namespace ground
