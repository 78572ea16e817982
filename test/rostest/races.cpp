// Threads of a controller, as a user and a recorder would call them at once, for ThreadSanitizer
// (.ci/sanitize): drives begin while parameters change. It needs a ROS master, and takes a
// model and a room.
#include <dynamic_reconfigure/Reconfigure.h>
#include <ground/TrajectoryTrackingConfig.h>
#include <ground_msgs/ControllerStatus.h>
#include <ground_msgs/State.h>
#include <nodelet/loader.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <atomic>
#include <boost/make_shared.hpp>
#include <cstdio>
#include <thread>

#include "ground/nodelets/reference_tracking.h"

namespace {

constexpr int kDrives = 100;

class RacingController : public ground::ReferenceTracking<ground::TrajectoryTrackingConfig> {
 public:
  RacingController() : ReferenceTracking("TrajectoryTracking") {}
  ~RacingController() override { shutdown(); }
};

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "races");
  if (argc < 3) return 2;
  ros::NodeHandle node;
  node.setParam("controller/model", argv[1]);
  node.setParam("controller/room", argv[2]);
  node.setParam("controller/size", 0.5);
  node.setParam("controller/lift_time", 0.0);
  node.setParam("controller/require_armed", false);
  ros::AsyncSpinner spinner(1);
  spinner.start();
  const boost::function<boost::shared_ptr<nodelet::Nodelet>(const std::string&)> make = [](const auto&) {
    return boost::make_shared<RacingController>();
  };
  nodelet::Loader loader(make);
  if (!loader.load("/controller", "RacingController", {}, {})) return 2;
  std::atomic<bool> running{true};
  std::atomic<int> status{-1};
  const ros::Subscriber statuses = node.subscribe<ground_msgs::ControllerStatus>(
      "controller/status", 10, [&](const auto& message) { status = message->state; });
  std::thread states([&] {
    ros::Publisher publisher = node.advertise<ground_msgs::State>("state", 1);
    for (ros::WallRate rate(100); running; rate.sleep()) {
      ground_msgs::State state;
      state.header.stamp = ros::Time::now();
      state.valid = true;
      publisher.publish(state);
    }
  });
  std::thread changes([&] {
    dynamic_reconfigure::Reconfigure change;
    change.request.config.doubles.resize(1);
    change.request.config.doubles[0].name = "max_error";
    for (double error = 1; running; error = 3 - error) {
      change.request.config.doubles[0].value = error;
      ros::service::call("controller/set_parameters", change);
    }
  });
  int driven = 0;
  for (int i = 0; i < kDrives; ++i) {
    std_srvs::Trigger trigger;
    ros::service::call("controller/start", trigger);
    for (int wait = 0; wait < 500 && status != ground_msgs::ControllerStatus::RUNNING; ++wait)
      ros::WallDuration(0.01).sleep();
    driven += status == ground_msgs::ControllerStatus::RUNNING;
    ros::WallDuration(0.05).sleep();
    ros::service::call("controller/stop", trigger);
  }
  running = false;
  states.join();
  changes.join();
  std::printf("%d drives of %d\n", driven, kDrives);
  return 2 * driven > kDrives ? 0 : 1;  // a start right after a stop may be refused
}
