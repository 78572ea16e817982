#include "window_plans.h"

#include <algorithm>
#include <numeric>

namespace ground {
namespace {

std::vector<std::array<Lanes, 3>> gather(const LanePlan& plan, const std::vector<Window>& windows,
                                         const std::vector<Rows3>& measured,
                                         const std::vector<int>& lanes) {
  std::vector<std::array<Lanes, 3>> result(plan.visits());
  for (int visit = 0; visit < plan.visits(); ++visit)
    for (auto sample = plan.begin(visit); sample != plan.end(visit); ++sample) {
      const Window& window = windows[lanes[sample->lane]];
      for (int c = 0; c < 3; ++c)
        result[visit][c][sample->lane] = measured[window.run](window.first + sample->index, c);
    }
  return result;
}

Whitening<Lanes> gather(const LanePlan& plan, const std::vector<Whitening<double>>& whitening,
                        const std::vector<int>& lanes) {
  Whitening<Lanes> result;
  result.over_deviation.resize(plan.visits());
  for (const int window : lanes)
    if (!whitening[window].foresight.empty()) result.foresight.resize(plan.visits());
  for (int visit = 0; visit < plan.visits(); ++visit)
    for (auto sample = plan.begin(visit); sample != plan.end(visit); ++sample) {
      const int lane = sample->lane;
      const Whitening<double>& of = whitening[lanes[lane]];
      for (int c = 0; c < 3; ++c)
        result.over_deviation[visit][c][lane] = of.over_deviation[sample->index][c];
      if (of.foresight.empty()) continue;
      const Whitening<double>::Foresight& from = of.foresight[sample->index];
      Whitening<Lanes>::Foresight& to = result.foresight[visit];
      for (int c = 0; c < 3; ++c) {
        to.gain_position[c][lane] = from.gain_position[c];
        to.gain_rate[c][lane] = from.gain_rate[c];
      }
      to.step[lane] = from.step;
    }
  return result;
}

}  // namespace

WindowPlans::Groups WindowPlans::get(const std::vector<RunData>& runs,
                                     const std::vector<Window>& windows,
                                     const std::vector<Rows3>& measured,
                                     const std::vector<Whitening<double>>& whitening, double delay,
                                     bool varies, const Settling& settling) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (groups_ && delay_ == delay && varies_ == varies && settling_ == settling) return groups_;
  std::vector<int> order(windows.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return windows[a].last - windows[a].first > windows[b].last - windows[b].first;
  });
  auto groups = std::make_shared<std::vector<Group>>();
  for (std::size_t first = 0; first < order.size(); first += Lanes::kCount) {
    const std::size_t last = std::min(order.size(), first + Lanes::kCount);
    std::vector<int> members(order.begin() + first, order.begin() + last);
    std::vector<Lane> lanes;
    for (const int w : members) {
      const RunData& run = runs[windows[w].run];
      lanes.push_back(
          {&run.inputs, &run.times[windows[w].first], windows[w].last - windows[w].first + 1});
    }
    LanePlan plan(lanes, delay, varies, settling);
    auto targets = gather(plan, windows, measured, members);
    auto whitenings = gather(plan, whitening, members);
    groups->push_back(
        {std::move(members), std::move(plan), std::move(targets), std::move(whitenings)});
  }
  groups_ = groups;
  delay_ = delay;
  varies_ = varies;
  settling_ = settling;
  return groups_;
}

}  // namespace ground
