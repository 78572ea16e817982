#include "ground/model/lane_simulation.h"

#include <algorithm>
#include <stdexcept>

namespace ground {
namespace {

/// Steps of one lane under one command, and the sample measured at their end.
struct Part {
  Stretch stretch;
  Thrusters<double> thrusters;
  double lift;
  int sample;  ///< sample measured at the end; negative if there is none
};

std::vector<Part> partsOf(const Lane& lane, Stepping stepping) {
  std::vector<Part> parts;
  parts.reserve(2 * static_cast<std::size_t>(lane.count));
  for (int sample = 1; sample < lane.count; ++sample) {
    const std::size_t before = parts.size();
    Stretch stretch;
    while (stepping.next(lane.samples[sample], stretch))
      parts.push_back({stretch, stepping.thrusters(), stepping.lift(), -1});
    // Two samples at the same time are two visits.
    if (parts.size() == before)
      parts.push_back({{1, 0, 0, stepping.t()}, stepping.thrusters(), stepping.lift(), -1});
    parts.back().sample = sample;
  }
  return parts;
}

LanePlan::Step nothing(int thrusters) {
  return {0.0, 0.0, Thrusters<Lanes>::zero(thrusters), 0.0, 0.0, 1, false};
}

void set(LanePlan::Step& step, int lane, double h, double by_delay,
         const Thrusters<double>& thrusters, double lift) {
  step.h[lane] = h;
  step.by_delay[lane] = by_delay;
  for (int i = 0; i < thrusters.size(); ++i) step.command(i)[lane] = thrusters(i);
  step.lift[lane] = lift;
}

/// The current part of each lane.
class Progress {
 public:
  Progress(const std::vector<std::vector<Part>>& parts, int thrusters)
      : parts_(parts), lanes_(static_cast<int>(parts.size())), step_(nothing(thrusters)) {
    for (int lane = 0; lane < lanes_; ++lane) begin(lane);
  }

  /// Plans the steps until the next end of a part in any lane; false if all lanes are finished.
  bool next() {
    step_.count = 0;
    for (int lane = 0; lane < lanes_; ++lane)
      if (left_[lane] > 0 && (step_.count == 0 || left_[lane] < step_.count))
        step_.count = left_[lane];
    return step_.count > 0;
  }
  const LanePlan::Step& step() const { return step_; }

  /// Advances all lanes by these steps, and adds the samples measured at the end.
  void advance(std::vector<LanePlan::Sample>& measured) {
    for (int lane = 0; lane < lanes_; ++lane) {
      if (left_[lane] == 0) continue;
      // Step by step, so that t is rounded as in the simulation.
      for (int i = 0; i < step_.count; ++i) step_.t[lane] += step_.h[lane];
      if ((left_[lane] -= step_.count) > 0) continue;
      const int sample = parts_[lane][at_[lane]++].sample;
      if (sample >= 0) measured.push_back({lane, sample});
      begin(lane);
    }
  }

 private:
  void begin(int lane) {
    if (at_[lane] == parts_[lane].size()) {
      step_.h[lane] = step_.by_delay[lane] = 0;
      return;
    }
    const Part& part = parts_[lane][at_[lane]];
    left_[lane] = part.stretch.steps;
    set(step_, lane, part.stretch.h, part.stretch.by_delay, part.thrusters, part.lift);
    step_.t[lane] = part.stretch.t;
  }

  const std::vector<std::vector<Part>>& parts_;
  int lanes_;
  LanePlan::Step step_;
  std::size_t at_[Lanes::kCount] = {};  ///< current part of each lane
  int left_[Lanes::kCount] = {};        ///< remaining steps of that part
};

}  // namespace

LanePlan::LanePlan(const std::vector<Lane>& lanes, double delay, bool varies,
                   const Settling& settling, double max_step)
    : thruster_count_(lanes.empty() ? 0 : lanes.front().inputs->thruster_count), varies_(varies) {
  if (lanes.empty() || lanes.size() > Lanes::kCount)
    throw std::invalid_argument("a plan has one to eight lanes");
  for (const Lane& lane : lanes)
    if (lane.inputs->thruster_count != thruster_count_)
      throw std::invalid_argument("the lanes of a plan are of crafts with other thrusters");
  std::vector<std::vector<Part>> parts;
  std::vector<std::vector<Stepping::Held>> before;
  std::size_t most = 0;
  for (const Lane& lane : lanes) {
    const Stepping stepping(*lane.inputs, lane.samples[0], delay, varies, max_step);
    before.push_back(stepping.before(settling));
    parts.push_back(partsOf(lane, stepping));
    most = std::max(most, parts.back().size());
    samples_.push_back({static_cast<int>(samples_.size()), 0});
  }
  settle(lanes, before);
  behind_.push_back(static_cast<int>(samples_.size()));
  steps_.reserve(most);
  for (Progress progress(parts, thruster_count_); progress.next();) {
    steps_.push_back(progress.step());
    progress.advance(samples_);
    const auto behind = static_cast<int>(samples_.size());
    steps_.back().measured = behind > behind_.back();
    if (steps_.back().measured) behind_.push_back(behind);
  }
}

/// Plans the settling of effects before the start. Lanes with fewer commands begin with zeros.
void LanePlan::settle(const std::vector<Lane>& lanes,
                      const std::vector<std::vector<Stepping::Held>>& before) {
  std::size_t longest = 0;
  for (const auto& all : before) longest = std::max(longest, all.size());
  settling_.assign(longest, nothing(thruster_count_));
  if (lanes.front().measured) measured_.resize(longest);
  for (std::size_t lane = 0; lane < lanes.size(); ++lane) {
    const std::vector<Stepping::Held>& all = before[lane];
    const auto column = static_cast<int>(lane);
    for (std::size_t k = 0; k < all.size(); ++k) {
      Step& settled = settling_[longest - all.size() + k];
      const InputSequence& inputs = *lanes[lane].inputs;
      set(settled, column, all[k].duration, all[k].by_delay, inputs.thrusters[all[k].command],
          inputs.lift[all[k].command]);
      settled.t[column] = all[k].t;
      if (!lanes[lane].measured) continue;
      const RigidState<double> motion = lanes[lane].measured->at(all[k].time);
      RigidState<Lanes>& at = measured_[longest - all.size() + k];
      for (int c = 0; c < 3; ++c) {
        at.eta(c)[column] = motion.eta(c);
        at.nu(c)[column] = motion.nu(c);
      }
    }
  }
}

template <typename T>
LaneRun<T>::LaneRun(const Dynamics<T>& dynamics, const RigidState<T>& state, bool pose)
    : dynamics_(dynamics),
      state_(state),
      heading_(valueOf(state.eta.z())),
      effect_states_(dynamics.initialStates()),
      pose_(pose) {}

template <typename T>
void LaneRun<T>::settle(const LanePlan::Step& step, const RigidState<Lanes>* measured) {
  dynamics_.settle(T(step.t), measured ? cast<T>(*measured) : state_, step.command.template cast<T>(), step.lift,
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
    pose_ ? dynamics_.template hold<true>(t_, state_, step.command, step.lift, h, step.count,
                                          &heading_)
          : dynamics_.template hold<false>(t_, state_, step.command, step.lift, h, step.count,
                                           &heading_);
    return;
  }
  const Thrusters<T> held = step.command.template cast<T>();
  for (int i = 0; i < step.count; ++i) {
    const StepInputs<T> acting = dynamics_.actuate(held, step.lift, T(h), effect_states_.data());
    pose_ ? dynamics_.template step<true>(t_, state_, acting, h, 1, &heading_)
          : dynamics_.template step<false>(t_, state_, acting, h, 1, &heading_);
  }
}

template class LaneRun<Lanes>;
template class LaneRun<LanesJet>;

}  // namespace ground
