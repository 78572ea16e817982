// Groups of windows that are simulated together, one in each lane.
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

/// Groups of windows of similar length, and the steps of their simulations. They are reused until
/// the delay of the inputs changes.
class WindowPlans {
 public:
  struct Group {
    std::vector<int> windows;  ///< window of each lane
    LanePlan plan;
    /// Measurement and weight of its error at each visit of the plan; both are 0 in lanes without a
    /// measurement.
    std::vector<std::array<Lanes, 3>> measured, weight;

    /// Whether simulation in lanes is faster than one simulation after the other.
    bool together() const { return windows.size() >= kMinLanes; }

   private:
    static constexpr std::size_t kMinLanes = 4;
  };
  using Groups = std::shared_ptr<const std::vector<Group>>;

  /// Groups of windows of `runs`. `measured`, `weight`: measurements of each run and weights of
  /// their errors. For `delay`, `varies` and `settling` see LanePlan.
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
