#include "ground/model/lane_simulation.h"

#include <algorithm>
#include <stdexcept>

namespace ground {
namespace {

/// What a lane does, one after the other.
struct Part {
  Stretch stretch;
  Vector2<double> thrusters;
  double lift;
  int sample;  ///< measured at the end, or negative
};

std::vector<Part> partsOf(const Lane& lane, Stepping stepping) {
  std::vector<Part> parts;
  parts.reserve(2 * static_cast<std::size_t>(lane.count));
  for (int sample = 1; sample < lane.count; ++sample) {
    const std::size_t before = parts.size();
    Stretch stretch;
    while (stepping.next(lane.samples[sample], stretch))
      parts.push_back({stretch, stepping.thrusters(), stepping.lift(), -1});
    // Two samples of one instant are two visits.
    if (parts.size() == before)
      parts.push_back({{1, 0, 0, stepping.t()}, stepping.thrusters(), stepping.lift(), -1});
    parts.back().sample = sample;
  }
  return parts;
}

LanePlan::Step nothing() { return {0.0, 0.0, {Lanes(0.0), Lanes(0.0)}, 0.0, 0.0, 1, false}; }

void set(LanePlan::Step& step, int lane, double h, double by_delay,
         const Vector2<double>& thrusters, double lift) {
  step.h[lane] = h;
  step.by_delay[lane] = by_delay;
  for (int side = 0; side < 2; ++side) step.command(side)[lane] = thrusters(side);
  step.lift[lane] = lift;
}

}  // namespace

LanePlan::LanePlan(const std::vector<Lane>& lanes, double delay, bool varies,
                   const Settling& settling, double max_step)
    : varies_(varies) {
  if (lanes.empty() || lanes.size() > Lanes::kCount)
    throw std::invalid_argument("a plan has one to eight lanes");
  const int count = static_cast<int>(lanes.size());
  std::vector<std::vector<Part>> parts;
  std::vector<std::vector<Stepping::Held>> before;
  std::size_t longest = 0, most = 0;
  for (const Lane& lane : lanes) {
    const Stepping stepping(*lane.inputs, lane.samples[0], delay, varies, max_step);
    before.push_back(stepping.before(settling));
    parts.push_back(partsOf(lane, stepping));
    longest = std::max(longest, before.back().size());
    most = std::max(most, parts.back().size());
  }
  // Effects settle until the start; lanes with fewer commands have been off before.
  settling_.assign(longest, nothing());
  for (int lane = 0; lane < count; ++lane) {
    const std::vector<Stepping::Held>& all = before[lane];
    for (std::size_t k = 0; k < all.size(); ++k) {
      Step& settled = settling_[longest - all.size() + k];
      set(settled, lane, all[k].duration, all[k].by_delay,
          lanes[lane].inputs->thrusters[all[k].command], lanes[lane].inputs->lift[all[k].command]);
      settled.t[lane] = all[k].t;
    }
  }
  std::size_t at[Lanes::kCount] = {};  // part of each lane
  int left[Lanes::kCount] = {};        // steps of it
  Step step = nothing();
  steps_.reserve(most);
  const auto begin = [&](int lane) {
    if (at[lane] == parts[lane].size()) {
      step.h[lane] = step.by_delay[lane] = 0;
      return;
    }
    const Part& part = parts[lane][at[lane]];
    left[lane] = part.stretch.steps;
    set(step, lane, part.stretch.h, part.stretch.by_delay, part.thrusters, part.lift);
    step.t[lane] = part.stretch.t;
  };
  for (int lane = 0; lane < count; ++lane) {
    samples_.push_back({lane, 0});
    begin(lane);
  }
  behind_.push_back(count);
  while (true) {
    step.count = 0;
    for (int lane = 0; lane < count; ++lane)
      if (left[lane] > 0 && (step.count == 0 || left[lane] < step.count)) step.count = left[lane];
    if (step.count == 0) break;
    steps_.push_back(step);
    for (int lane = 0; lane < count; ++lane) {
      if (left[lane] == 0) continue;
      for (int i = 0; i < step.count; ++i) step.t[lane] += step.h[lane];  // rounded as the run's
      if ((left[lane] -= step.count) > 0) continue;
      const int sample = parts[lane][at[lane]++].sample;
      if (sample >= 0) {
        samples_.push_back({lane, sample});
        steps_.back().measured = true;
      }
      begin(lane);
    }
    if (steps_.back().measured) behind_.push_back(static_cast<int>(samples_.size()));
  }
}

template <typename T>
LaneRun<T>::LaneRun(const Dynamics<T>& dynamics, const RigidState<T>& state, bool pose)
    : dynamics_(dynamics),
      state_(state),
      effect_states_(dynamics.initialStates()),
      pose_(pose) {}

template <typename T>
void LaneRun<T>::settle(const LanePlan::Step& step) {
  dynamics_.settle(T(step.t), state_, step.command.template cast<T>(), step.lift,
                   dynamics_.withDelay(step.h, step.by_delay), effect_states_.data());
}

template <typename T>
void LaneRun<T>::take(const LanePlan::Step& step, bool varies) {
  valueIn(t_) = step.t;
  varies ? takeOf<T>(step, dynamics_.withDelay(step.h, step.by_delay))
         : takeOf<Lanes>(step, step.h);
}

template <typename T>
template <typename H>
void LaneRun<T>::takeOf(const LanePlan::Step& step, const H& h) {
  if (!dynamics_.hasMemory()) {
    pose_ ? dynamics_.template hold<true>(t_, state_, step.command, step.lift, h, step.count)
          : dynamics_.template hold<false>(t_, state_, step.command, step.lift, h, step.count);
    return;
  }
  const Vector2<T> held = {T(step.command(0)), T(step.command(1))};
  for (int i = 0; i < step.count; ++i) {
    const StepInputs<T> acting = dynamics_.actuate(held, step.lift, T(h), effect_states_.data());
    pose_ ? dynamics_.template step<true>(t_, state_, acting, h)
          : dynamics_.template step<false>(t_, state_, acting, h);
  }
}

template class LaneRun<Lanes>;
template class LaneRun<LanesJet>;

}  // namespace ground
