#pragma once

#include <vector>

#include "ground/model/simulation.h"

namespace ground {

/// One of up to eight simulations that run in parallel, one in each lane of a Lanes.
struct Lane {
  const InputSequence* inputs;
  const double*
      samples;  ///< ascending times of measurements [s]; the simulation starts at the first
  int count;    ///< number of samples, at least one
  /// Measured before the start, the same for all lanes or absent in all: see Simulation.
  const Motion* measured = nullptr;
};

/// The steps of up to eight simulations, planned beforehand for one input delay. Each lane has its
/// own steps (see Stepping) and does not wait for the others: one Step advances all lanes, each by
/// its own length h. Example: if lane 0 needs steps of 5, 5, 2 ms and lane 1 of 4, 4 ms, the plan
/// has two steps with h = (5, 4) ms and one with h = (2, 0) ms.
class LanePlan {
 public:
  /// An instant's measurement of one lane.
  struct Sample {
    int lane, index;
  };
  struct Step {
    Lanes h, by_delay;         ///< length and its derivative by the delay; 0 in finished lanes
    Thrusters<Lanes> command;  ///< held thruster command
    Lanes lift;
    Lanes t;        ///< time since the drive began, at the first of these steps [s]
    int count;      ///< number of equal steps
    bool measured;  ///< some lanes are measured after the last of these steps
  };

  /// `varies`: h has a derivative by the delay. `settling`: how the states of effects settle to the
  /// commands and motion before the start.
  LanePlan(const std::vector<Lane>& lanes, double delay, bool varies, const Settling& settling,
           double max_step = kDefaultStep);

  /// Number of visits: instants at which some lanes, one sample each, are measured. The first visit
  /// is the start.
  int visits() const { return static_cast<int>(behind_.size()); }
  const Sample* begin(int visit) const { return visit == 0 ? samples_.data() : end(visit - 1); }
  const Sample* end(int visit) const { return samples_.data() + behind_[visit]; }

  /// Settles the effects, simulates all lanes from `state` and calls take(visit, eta, nu) with the
  /// measurement of each visit. Without `pose` only velocities are integrated.
  template <typename T, class Take>
  void run(const Dynamics<T>& dynamics, RigidState<T> state, bool pose, const Take& take) const;

 private:
  void settle(const std::vector<Lane>& lanes,
              const std::vector<std::vector<Stepping::Held>>& before);

  std::vector<Step> settling_, steps_;
  std::vector<RigidState<Lanes>> measured_;  ///< at each step of settling_, if it was measured
  std::vector<Sample> samples_;
  std::vector<int> behind_;  ///< end of each visit's samples in samples_
  int thruster_count_;
  bool varies_ = false;
};

/// State of the simulations while a plan runs.
template <typename T>
class LaneRun {
 public:
  LaneRun(const Dynamics<T>& dynamics, const RigidState<T>& state, bool pose);
  /// Settles to a motion, or to the initial state without one.
  void settle(const LanePlan::Step& step, const RigidState<Lanes>* measured);
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
  Rotation<Lanes> heading_;
  T t_{0.0};  ///< time since the drive began [s]
  std::vector<T> effect_states_;
  bool pose_;
};

extern template class LaneRun<Lanes>;
extern template class LaneRun<LanesJet>;

template <typename T, class Take>
void LanePlan::run(const Dynamics<T>& dynamics, RigidState<T> state, bool pose,
                   const Take& take) const {
  dynamics.requireThrusters(thruster_count_);
  LaneRun<T> run(dynamics, state, pose);
  if (dynamics.hasMemory())
    for (std::size_t i = 0; i < settling_.size(); ++i)
      run.settle(settling_[i], measured_.empty() ? nullptr : &measured_[i]);
  int visit = 0;
  run.measure(visit++, take);
  for (const Step& step : steps_) {
    run.take(step, varies_);
    if (step.measured) run.measure(visit++, take);
  }
}

}  // namespace ground
