// A nodelet manager with a sender and a controller of a user, whose code throws an exception after 3 s.
#include <nodelet/loader.h>
#include <ros/ros.h>

#include <boost/make_shared.hpp>
#include <pluginlib/class_loader.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "ground/nodelets/controller.h"

namespace {

class ThrowingPilot : public ground::Pilot {
 public:
  ground::LifecycleParams load(ros::NodeHandle&) {
    ground::LifecycleParams params;
    params.lift_time = 0.2;
    return params;
  }
  ground::Inputs update(double elapsed, double, const ground::RigidState<double>&, double lift) override {
    const std::vector<double> thrust(300, 0.3);  // for 3 s, a row every 10 ms
    return {thrust.at(static_cast<std::size_t>(100 * elapsed)), 0.3, lift};
  }
};

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "manager");
  ros::NodeHandle node;
  pluginlib::ClassLoader<nodelet::Nodelet> plugins("nodelet", "nodelet::Nodelet");
  nodelet::Loader loader([&](const std::string& kind) -> boost::shared_ptr<nodelet::Nodelet> {
    if (kind == "ThrowingController") return boost::make_shared<ground::ControllerOf<ThrowingPilot>>();
    return plugins.createInstance(kind);
  });
  if (!loader.load("/sender", "ground/Sender", {}, {})) return 1;
  if (!loader.load("/controller", "ThrowingController", {}, {})) return 1;
  ros::spin();
  return 0;
}
