// Measures the time from a pose to the UDP packet that it causes.
#include <geometry_msgs/PoseStamped.h>
#include <ground_msgs/ControllerStatus.h>
#include <ros/ros.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <thread>
#include <vector>

#include "ground/estimation/axis_mapping.h"
#include "ground/link/protocol.h"
#include "ground/link/udp_socket.h"
#include "ground/nodelets/real_time_threads.h"

namespace {

using Clock = std::chrono::steady_clock;

/// Stands for the mocap, which sees a slowly circling craft, and for the craft, which gets packets.
class Probe {
 public:
  Probe(int port, double rate)
      : socket_(ground::UdpAddress()),
        sender_(ground::UdpAddress::parse("127.0.0.1", static_cast<std::uint16_t>(port))),
        rate_(rate) {
    publisher_ = nh_.advertise<geometry_msgs::PoseStamped>("vrpn_client_node/hovercraft/pose", 1);
    status_ = nh_.subscribe("controller/status", 1, &Probe::onStatus, this);
  }

  /// Collects `count` latencies [s], or fewer if the craft is not driven any more.
  std::vector<double> measure(std::size_t count) {
    std::vector<double> latencies;
    std::string datagram;
    ground::UdpAddress from;
    auto due = Clock::now();
    const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / rate_));
    const ros::Time start = ros::Time::now();
    while (ros::ok() && latencies.size() < count && !stopped_) {
      socket_.send(ground::encodeTelemetry({}), sender_);
      while (socket_.receive(0, datagram, from)) {
      }
      const auto sent = Clock::now();
      publishPose((ros::Time::now() - start).toSec());
      due += period;
      // A running controller answers each state with one command, and the sender answers each
      // command with one packet. Its keepalive is slower than the poses and therefore never sent.
      const double left = std::chrono::duration<double>(due - Clock::now()).count();
      if (socket_.receive(left, datagram, from) && running_)
        latencies.push_back(std::chrono::duration<double>(Clock::now() - sent).count());
      std::this_thread::sleep_until(due);
    }
    return latencies;
  }

 private:
  void onStatus(const ground_msgs::ControllerStatus::ConstPtr& status) {
    running_ = status->state == ground_msgs::ControllerStatus::RUNNING;
    if (status->state != ground_msgs::ControllerStatus::STOPPED) return;
    std::printf("the controller has stopped: %s\n", status->reason.c_str());
    stopped_ = true;
  }

  void publishPose(double t) {
    Eigen::Vector3d p;
    Eigen::Quaterniond q;
    mapping_.toMocap({std::cos(0.3 * t), std::sin(0.3 * t), 0.5 * std::sin(0.7 * t)}, 0.04, p, q);
    geometry_msgs::PoseStamped pose;
    pose.header.stamp = ros::Time::now();
    pose.pose.position.x = p.x();
    pose.pose.position.y = p.y();
    pose.pose.position.z = p.z();
    pose.pose.orientation.w = q.w();
    pose.pose.orientation.x = q.x();
    pose.pose.orientation.y = q.y();
    pose.pose.orientation.z = q.z();
    publisher_.publish(pose);
  }

  ros::NodeHandle nh_;
  ros::Publisher publisher_;
  ros::Subscriber status_;
  std::atomic<bool> running_{false}, stopped_{false};
  ground::AxisMapping mapping_;
  ground::UdpSocket socket_;
  ground::UdpAddress sender_;
  double rate_;
};

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "latency_probe");
  ros::NodeHandle private_nh("~");
  const int port = private_nh.param("port", 33999);
  const double rate = private_nh.param("rate", 100.0);
  const int count = private_nh.param("count", 2000);
  // Otherwise it would also measure how late this program sends and receives.
  if (ground::wantsRealTime(private_nh)) ground::prioritise(ground::RealTimePriority::kSend);
  ros::AsyncSpinner spinner(1);
  spinner.start();
  Probe probe(port, rate);
  std::vector<double> latencies = probe.measure(static_cast<std::size_t>(count));
  if (latencies.size() < static_cast<std::size_t>(count)) return 1;
  std::sort(latencies.begin(), latencies.end());
  const auto at = [&](double q) {
    return 1e3 * latencies[static_cast<std::size_t>(q * static_cast<double>(latencies.size() - 1))];
  };
  std::printf(
      "pose to packet at %.0f Hz, %zu poses: median %.2f ms, 99%% %.2f ms, 99.9%% %.2f ms, most "
      "%.2f ms\n",
      rate, latencies.size(), at(0.5), at(0.99), at(0.999), at(1.0));
  return 0;
}
