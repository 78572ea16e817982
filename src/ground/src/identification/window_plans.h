// Windows that are simulated side by side.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "ground/identification/simulation_error.h"
#include "ground/model/lane_simulation.h"

namespace ground {

/// Residuals of the windows of a group, kept from one evaluation to the next: they are large.
using GroupResiduals = std::vector<WindowResiduals>;

/// Groups of windows, of about the same length each, and the steps of their simulations. They stay
/// the same from one evaluation to the next unless the delay of the inputs changes.
class WindowPlans {
 public:
  struct Group {
    std::vector<int> windows;  ///< one a lane
    LanePlan plan;
  };
  using Groups = std::shared_ptr<const std::vector<Group>>;

  /// Whether the delay `varies` as in Stepping.
  Groups get(const std::vector<RunData>& runs, const std::vector<Window>& windows, double delay,
             bool varies);

  /// Memory for a thread's results, to be given back.
  std::unique_ptr<GroupResiduals> borrow();
  void giveBack(std::unique_ptr<GroupResiduals> results);

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<GroupResiduals>> spare_;
  Groups groups_;
  double delay_ = 0;
  bool varies_ = false;
};

}  // namespace ground
