// Windows that are simulated side by side.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "ground/identification/simulation_error.h"
#include "ground/model/lane_simulation.h"

namespace ground {

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

 private:
  std::mutex mutex_;
  Groups groups_;
  double delay_ = 0;
  bool varies_ = false;
};

}  // namespace ground
