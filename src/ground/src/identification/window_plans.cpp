#include "window_plans.h"

#include <algorithm>
#include <numeric>

namespace ground::detail {
namespace {

/// Sets measurements and weights of a group from its windows and plan.
void gather(const std::vector<Window>& windows, const std::vector<Rows3>& measured,
            const std::vector<Vector3<double>>& weight, WindowPlans::Group& group) {
  const LanePlan& plan = group.plan;
  group.measured.resize(plan.visits());
  group.weight.resize(plan.visits());
  for (int visit = 0; visit < plan.visits(); ++visit)
    for (auto sample = plan.begin(visit); sample != plan.end(visit); ++sample) {
      const Window& window = windows[group.windows[sample->lane]];
      for (int c = 0; c < 3; ++c) {
        group.measured[visit][c][sample->lane] =
            measured[window.run](window.first + sample->index, c);
        group.weight[visit][c][sample->lane] = weight[window.run](c);
      }
    }
}

}  // namespace

WindowPlans::Groups WindowPlans::get(const std::vector<RunData>& runs,
                                     const std::vector<Window>& windows,
                                     const std::vector<Rows3>& measured,
                                     const std::vector<Vector3<double>>& weight, double delay,
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
    std::vector<Motion> motions;
    motions.reserve(members.size());
    for (const int w : members) {
      const RunData& run = runs[windows[w].run];
      motions.push_back(motionOf(run));
      lanes.push_back({&run.inputs, &run.times[windows[w].first],
                       windows[w].last - windows[w].first + 1, &motions.back()});
    }
    LanePlan plan(lanes, delay, varies, settling);
    groups->push_back({std::move(members), std::move(plan), {}, {}});
    gather(windows, measured, weight, groups->back());
  }
  groups_ = groups;
  delay_ = delay;
  varies_ = varies;
  settling_ = settling;
  return groups_;
}

}  // namespace ground::detail
