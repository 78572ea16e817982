#include <ground/SenderConfig.h>
#include <ground_msgs/Controls.h>
#include <ground_msgs/SenderStatus.h>
#include <ground_msgs/State.h>
#include <ground_msgs/Telemetry.h>
#include <nodelet/nodelet.h>
#include <std_srvs/SetBool.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <pluginlib/class_list_macros.hpp>
#include <thread>

#include "ground/link/ground_link.h"
#include "ground/nodelets/parameters.h"

namespace ground {

/// UDP link from the ROS graph to the craft.
///
/// Parameters: port (3333), bind_address (0.0.0.0), peer (HOST or HOST:PORT of the craft; learned
/// from its first datagram when empty), auto_arm (false; arms once, as soon as it is possible), and
/// those of Sender.cfg. Subscribes: controls, state. Publishes: ~status (latched), ~telemetry.
/// Services: ~arm. Zero packets go out when disarmed, in fault and at the end.
class Sender : public nodelet::Nodelet {
 public:
  ~Sender() override {
    running_ = false;
    if (thread_.joinable()) thread_.join();
    reconfigure_.reset();
    if (!link_) return;
    for (int i = 0; i < kFarewells; ++i) {
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        link_->disarm(steadyNow(), "the sender ends");
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }

 private:
  static constexpr int kFarewells = 10;  // UDP may lose some

  void onInit() override {
    try {
      start();
    } catch (const std::exception& error) {
      NODELET_FATAL("sender: %s", error.what());
      throw;
    }
  }

  void start() {
    ros::NodeHandle& nh = getMTPrivateNodeHandle();
    const int port = optionalParameter<int>(nh, "port", 3333);
    if (port < 0 || port > 65535) throw std::runtime_error("port must be between 0 and 65535");
    const auto address = optionalParameter<std::string>(nh, "bind_address", "0.0.0.0");
    const auto peer = optionalParameter<std::string>(nh, "peer", "");
    auto_arm_ = optionalParameter<bool>(nh, "auto_arm", false);

    socket_ =
        std::make_unique<UdpSocket>(UdpAddress::parse(address, static_cast<std::uint16_t>(port)));
    link_ = std::make_unique<GroundLink>(
        GroundLinkParams(), peer.empty() ? UdpAddress() : UdpAddress::parse(peer),
        [this](const std::string& data, const UdpAddress& to) { return socket_->send(data, to); });

    status_publisher_ = nh.advertise<ground_msgs::SenderStatus>("status", 1, true);
    telemetry_publisher_ = nh.advertise<ground_msgs::Telemetry>("telemetry", 10);
    reconfigure_ = std::make_unique<LiveParameters<SenderConfig>>(
        nh, [](const SenderConfig& c) { return params(c).validate(); },
        [this](const SenderConfig& c) {
          const std::lock_guard<std::mutex> lock(mutex_);
          link_->setParams(params(c));
        });
    thread_ = std::thread([this] { run(); });
    arm_service_ = nh.advertiseService("arm", &Sender::onArm, this);
    const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
    ros::NodeHandle& topics = getMTNodeHandle();
    state_subscriber_ = topics.subscribe("state", 1, &Sender::onState, this, hints);
    controls_subscriber_ = topics.subscribe("controls", 4, &Sender::onControls, this, hints);
    NODELET_INFO("sender: listening on UDP port %d", static_cast<int>(socket_->port()));
  }

  static GroundLinkParams params(const SenderConfig& c) {
    GroundLinkParams p;
    p.command_timeout = c.command_timeout;
    p.state_timeout = c.state_timeout;
    p.keepalive_rate = c.keepalive_rate;
    p.require_state = c.require_state;
    return p;
  }

  static double steadyNow() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
  }

  /// How old a message is by its stamp [s]; one from the future is not old.
  static double age(const std_msgs::Header& header) {
    return std::max(0.0, (ros::Time::now() - header.stamp).toSec());
  }

  void onControls(const ros::MessageEvent<ground_msgs::Controls const>& event) {
    const ground_msgs::Controls& controls = *event.getMessage();
    const double now = steadyNow();
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      link_->command(now, age(controls.header), event.getPublisherName(),
                     {controls.left, controls.right, controls.lift});
      if (auto_arm_ && link_->arm(now).empty()) auto_arm_ = false;
    }
    publishStatusOnChange();
  }

  void onState(const ground_msgs::State::ConstPtr& state) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      link_->state(steadyNow(), age(state->header), state->valid);
    }
    publishStatusOnChange();
  }

  bool onArm(std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      auto_arm_ = false;
      if (request.data) {
        response.message = link_->arm(steadyNow());
        response.success = response.message.empty();
        if (!response.success) response.message = "not armed: " + response.message;
      } else {
        link_->disarm(steadyNow(), "disarmed by hand");
        response.success = true;
      }
    }
    publishStatusOnChange();
    return true;
  }

  /// Receives, watches and keeps packets going on the steady clock, whatever ROS's clock does.
  void run() {
    std::string data;
    UdpAddress from;
    double next_status = 0;
    while (running_) {
      const bool came = socket_->receive(kTick, data, from);
      const double now = steadyNow();
      std::optional<CraftTelemetry> telemetry;
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (came) telemetry = link_->datagram(now, data, from);
        link_->tick(now);
      }
      if (telemetry) publishTelemetry(*telemetry);
      publishStatusOnChange(now >= next_status);
      if (now >= next_status) next_status = now + 0.5;
    }
  }

  void publishTelemetry(const CraftTelemetry& t) {
    auto message = boost::make_shared<ground_msgs::Telemetry>();
    message->header.stamp = ros::Time::now();
    message->roll = t.roll;
    message->pitch = t.pitch;
    message->yaw = t.yaw;
    std::copy(t.acc.begin(), t.acc.end(), message->acc.begin());
    std::copy(t.gyro.begin(), t.gyro.end(), message->gyro.begin());
    std::copy(t.mag.begin(), t.mag.end(), message->mag.begin());
    telemetry_publisher_.publish(message);
  }

  void publishStatusOnChange(bool always = false) {
    auto message = boost::make_shared<ground_msgs::SenderStatus>();
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      message->state = static_cast<std::uint8_t>(link_->current());
      message->reason = link_->reason();
      message->peer = link_->peer().text();
      const GroundLink::Counters& counters = link_->counters();
      message->sent = counters.sent;
      message->received = counters.received;
      message->malformed = counters.malformed;
      message->foreign = counters.foreign;
      message->refused = counters.refused;
      const bool changed = message->state != published_state_ || message->peer != published_peer_;
      if (!changed && !always) return;
      if (message->state != published_state_) {
        const bool fault = link_->current() == GroundLink::State::kFault;
        ROS_LOG(fault ? ros::console::levels::Warn : ros::console::levels::Info,
                ROSCONSOLE_DEFAULT_NAME, "sender: %s: %s", kNames[message->state],
                message->reason.c_str());
      }
      published_state_ = message->state;
      published_peer_ = message->peer;
    }
    message->header.stamp = ros::Time::now();
    status_publisher_.publish(message);
  }

  static constexpr double kTick = 0.002;  // [s]
  static constexpr const char* kNames[] = {"DISARMED", "ARMED", "FAULT"};

  std::mutex mutex_;  ///< guards link_, auto_arm_ and what was published
  std::unique_ptr<UdpSocket> socket_;
  std::unique_ptr<GroundLink> link_;
  bool auto_arm_ = false;
  int published_state_ = 0;
  std::string published_peer_;
  std::atomic<bool> running_{true};
  std::thread thread_;
  std::unique_ptr<LiveParameters<SenderConfig>> reconfigure_;
  ros::Publisher status_publisher_, telemetry_publisher_;
  ros::Subscriber controls_subscriber_, state_subscriber_;
  ros::ServiceServer arm_service_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::Sender, nodelet::Nodelet)
