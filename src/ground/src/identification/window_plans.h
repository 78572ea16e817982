// Windows that are simulated side by side.
#pragma once

#include <Eigen/Core>
#include <array>
#include <memory>
#include <mutex>
#include <vector>

#include "ground/identification/run_data.h"
#include "ground/model/lane_simulation.h"

namespace ground::detail {

/// Measurements, a row each.
using Rows3 = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

/// Groups of windows, of about the same length each, and the steps of their simulations. They stay
/// the same from one evaluation to the next unless the delay of the inputs changes.
class WindowPlans {
 public:
  struct Group {
    std::vector<int> windows;  ///< one a lane
    LanePlan plan;
    /// Of each visit of the plan: measurement and weight of its error, both 0 in lanes that are not
    /// measured then.
    std::vector<std::array<Lanes, 3>> measured, weight;

    /// Whether the lanes are filled enough to be faster than one simulation after the other.
    bool together() const { return windows.size() >= kFewestLanes; }

   private:
    static constexpr std::size_t kFewestLanes = 4;
  };
  using Groups = std::shared_ptr<const std::vector<Group>>;

  /// Groups of windows of `runs`; `measured` is what each run is compared with, `weight` that of
  /// its errors. Delay, whether it `varies` and settling as in LanePlan.
  Groups get(const std::vector<RunData>& runs, const std::vector<Window>& windows,
             const std::vector<Rows3>& measured, const std::vector<Vector3<double>>& weight,
             double delay, bool varies, const Settling& settling);

 private:
  std::mutex mutex_;
  Groups groups_;
  double delay_ = 0;
  Settling settling_;
  bool varies_ = false;
};

}  // namespace ground::detail
