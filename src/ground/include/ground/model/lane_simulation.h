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
  /// An instant's measurement of one lane.
  struct Sample {
    int lane, index;
  };
  struct Step {
    Lanes h, by_delay;       ///< length and its derivative by the delay; nothing in lanes that wait
    Vector2<Lanes> command;  ///< held
    Lanes lift;
    Lanes t;        ///< since the drive began, at the first of these steps [s]
    int count;      ///< of steps alike
    bool measured;  ///< some lanes are, after the last of these
  };

  /// The states of effects settle to the commands before the start.
  LanePlan(const std::vector<Lane>& lanes, double delay, bool varies, const Settling& settling,
           double max_step = kDefaultStep);

  /// Instants at which some lanes, one sample each, are measured; the first is the start.
  int visits() const { return static_cast<int>(behind_.size()); }
  const Sample* begin(int visit) const { return visit == 0 ? samples_.data() : end(visit - 1); }
  const Sample* end(int visit) const { return samples_.data() + behind_[visit]; }

  /// Runs all lanes from `state`, the effects settled, and calls take(visit, eta, nu) with what
  /// the mocap sees then. Without `pose` only velocities are integrated.
  template <typename T, class Take>
  void run(const Dynamics<T>& dynamics, RigidState<T> state, bool pose, const Take& take) const;

 private:
  void settle(const std::vector<Lane>& lanes,
              const std::vector<std::vector<Stepping::Held>>& before);

  std::vector<Step> settling_, steps_;
  std::vector<Sample> samples_;
  std::vector<int> behind_;  ///< a visit's samples
  bool varies_ = false;
};

/// The instant of a plan's run.
template <typename T>
class LaneRun {
 public:
  LaneRun(const Dynamics<T>& dynamics, const RigidState<T>& state, bool pose);
  void settle(const LanePlan::Step& step);
  void take(const LanePlan::Step& step, bool varies);
  template <class Take>
  void measure(int visit, const Take& take) const {
    if (!dynamics_.distorts()) return take(visit, state_.eta, state_.nu);
    const Measurement<T> seen = dynamics_.measure(state_);
    take(visit, seen.eta, seen.nu);
  }

 private:
  template <typename H>
  void takeOf(const LanePlan::Step& step, const H& h);

  const Dynamics<T>& dynamics_;
  RigidState<T> state_;
  T t_{0.0};  ///< since the drive began [s]
  std::vector<T> effect_states_;
  bool pose_;
};

extern template class LaneRun<Lanes>;
extern template class LaneRun<LanesJet>;

template <typename T, class Take>
void LanePlan::run(const Dynamics<T>& dynamics, RigidState<T> state, bool pose,
                   const Take& take) const {
  LaneRun<T> run(dynamics, state, pose);
  if (dynamics.hasMemory())
    for (const Step& step : settling_) run.settle(step);
  int visit = 0;
  run.measure(visit++, take);
  for (const Step& step : steps_) {
    run.take(step, varies_);
    if (step.measured) run.measure(visit++, take);
  }
}

}  // namespace ground
