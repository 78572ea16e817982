#include "window_plans.h"

#include <algorithm>
#include <numeric>

namespace ground {

WindowPlans::Groups WindowPlans::get(const std::vector<RunData>& runs,
                                     const std::vector<Window>& windows, double delay,
                                     bool varies) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (groups_ && delay_ == delay && varies_ == varies) return groups_;
  std::vector<int> order(windows.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return windows[a].last - windows[a].first > windows[b].last - windows[b].first;
  });
  auto groups = std::make_shared<std::vector<Group>>();
  for (std::size_t first = 0; first < order.size(); first += Lanes::kCount) {
    const std::size_t last = std::min(order.size(), first + Lanes::kCount);
    const std::vector<int> members(order.begin() + first, order.begin() + last);
    std::vector<Lane> lanes;
    for (const int w : members) {
      const RunData& run = runs[windows[w].run];
      lanes.push_back(
          {&run.inputs, &run.times[windows[w].first], windows[w].last - windows[w].first + 1});
    }
    groups->push_back({members, LanePlan(lanes, delay, varies)});
  }
  groups_ = groups;
  delay_ = delay;
  varies_ = varies;
  return groups_;
}

std::unique_ptr<GroupResiduals> WindowPlans::borrow() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (spare_.empty()) return std::make_unique<GroupResiduals>(Lanes::kCount);
  std::unique_ptr<GroupResiduals> results = std::move(spare_.back());
  spare_.pop_back();
  return results;
}

void WindowPlans::giveBack(std::unique_ptr<GroupResiduals> results) {
  const std::lock_guard<std::mutex> lock(mutex_);
  spare_.push_back(std::move(results));
}

}  // namespace ground
