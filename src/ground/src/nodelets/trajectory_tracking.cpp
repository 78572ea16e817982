#include <ground/TrajectoryTrackingConfig.h>

#include <pluginlib/class_list_macros.hpp>

#include "ground/control/tracking_law.h"
#include "ground/nodelets/reference_tracking.h"

namespace ground {

/// Tracks a reference by backstepping (thesis 4.2); parameters as ReferenceTracking, and the gains.
class TrajectoryTracking : public ReferenceTracking<TrajectoryTrackingConfig> {
 public:
  ~TrajectoryTracking() override { shutdown(); }

 private:
  using Config = TrajectoryTrackingConfig;

  static TrackingGains gains(const Config& c) {
    return {c.k_e, c.k_z, c.k_phi_1, c.k_phi_2, c.delta_1, c.delta_2};
  }

  const char* kind() const override { return "TrajectoryTracking"; }
  std::unique_ptr<TrackingController> make(const Model& model, const Config& c) override {
    return std::make_unique<BacksteppingControl>(model, gains(c));
  }
  std::string check(const Config& c) const override { return gains(c).validate(); }
  void tune(TrackingController& controller, const Config& c) override {
    static_cast<BacksteppingControl&>(controller).setGains(gains(c));
  }
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::TrajectoryTracking, nodelet::Nodelet)
