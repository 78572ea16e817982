#include "ground/model/lane_simulation.h"

#include <algorithm>
#include <stdexcept>

namespace ground {
namespace {

/// Step `number` of a plan, which grows to it.
LanePlan::Step& at(std::vector<LanePlan::Step>& steps, std::size_t number) {
  if (number >= steps.size())
    steps.resize(number + 1, {0.0, 0.0, {Lanes(0.0), Lanes(0.0)}, 0.0, false});
  return steps[number];
}

void set(LanePlan::Step& step, int lane, double h, double by_delay,
         const Vector2<double>& thrusters, double lift) {
  step.h[lane] = h;
  step.by_delay[lane] = by_delay;
  for (int side = 0; side < 2; ++side) step.command(side)[lane] = thrusters(side);
  step.lift[lane] = lift;
}

}  // namespace

LanePlan::LanePlan(const std::vector<Lane>& lanes, double delay, bool varies, double max_step)
    : varies_(varies) {
  if (lanes.empty() || lanes.size() > Lanes::kCount)
    throw std::invalid_argument("a plan has one to eight lanes");
  std::vector<std::vector<Sample>> after;  // each step
  std::vector<std::vector<Stepping::Held>> before;
  std::size_t longest = 0;
  for (std::size_t i = 0; i < lanes.size(); ++i) {
    const int lane = static_cast<int>(i);
    const InputSequence& inputs = *lanes[i].inputs;
    start_[lane] = lanes[i].samples[0];
    Stepping stepping(inputs, lanes[i].samples[0], delay, varies, max_step);
    before.push_back(stepping.before(kActuatorMemory));
    longest = std::max(longest, before.back().size());
    std::size_t taken = 0;
    for (int sample = 0; sample < lanes[i].count; ++sample) {
      Stretch stretch;
      while (stepping.next(lanes[i].samples[sample], stretch))
        for (int s = 0; s < stretch.steps; ++s)
          set(at(steps_, taken++), lane, stretch.h, stretch.by_delay, stepping.thrusters(),
              stepping.lift());
      if (after.size() <= taken) after.resize(taken + 1);
      after[taken].push_back({lane, sample});
    }
  }
  // Actuators settle until the start; lanes with fewer commands have been off before.
  for (std::size_t i = 0; i < lanes.size(); ++i)
    for (std::size_t k = 0; k < before[i].size(); ++k) {
      const Stepping::Held& held = before[i][k];
      set(at(settling_, longest - before[i].size() + k), static_cast<int>(i), held.duration,
          held.by_delay, lanes[i].inputs->thrusters[held.command],
          lanes[i].inputs->lift[held.command]);
    }
  for (std::size_t k = 0; k < after.size(); ++k) {
    if (after[k].empty()) continue;
    if (k > 0) steps_[k - 1].measured = true;
    samples_.insert(samples_.end(), after[k].begin(), after[k].end());
    behind_.push_back(static_cast<int>(samples_.size()));
  }
}

template <typename T>
LaneRun<T>::LaneRun(const Dynamics<T>& dynamics, const RigidState<T>& state, const Lanes& start,
                    bool pose)
    : dynamics_(dynamics),
      state_(state),
      time_(start),
      actuators_(static_cast<std::size_t>(dynamics.stateCount()), T(0.0)),
      pose_(pose) {}

template <typename T>
void LaneRun<T>::settle(const LanePlan::Step& step) {
  dynamics_.actuate(step.command.template cast<T>(), step.lift,
                    dynamics_.withDelay(step.h, step.by_delay), actuators_.data());
}

template <typename T>
void LaneRun<T>::take(const LanePlan::Step& step, bool varies) {
  varies ? takeOf<T>(step, dynamics_.withDelay(step.h, step.by_delay))
         : takeOf<Lanes>(step, step.h);
}

template <typename T>
template <typename H>
void LaneRun<T>::takeOf(const LanePlan::Step& step, const H& h) {
  if (!dynamics_.hasActuators()) {
    pose_ ? dynamics_.template hold<true>(time_, state_, step.command, step.lift, h)
          : dynamics_.template hold<false>(time_, state_, step.command, step.lift, h);
    return;
  }
  const Vector2<T> held = {T(step.command(0)), T(step.command(1))};
  const StepInputs<T> acting = dynamics_.actuate(held, step.lift, T(h), actuators_.data());
  pose_ ? dynamics_.template step<true>(time_, state_, acting, h)
        : dynamics_.template step<false>(time_, state_, acting, h);
}

template class LaneRun<Lanes>;
template class LaneRun<LanesJet>;

}  // namespace ground
