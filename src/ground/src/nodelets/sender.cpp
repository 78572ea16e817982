#include <ground/SenderConfig.h>
#include <ground_msgs/Controls.h>
#include <ground_msgs/Drive.h>
#include <ground_msgs/SenderStatus.h>
#include <ground_msgs/Silence.h>
#include <ground_msgs/State.h>
#include <ground_msgs/Telemetry.h>
#include <std_srvs/SetBool.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <memory>
#include <mutex>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <thread>

#include "ground/link/own_stop.h"
#include "ground/link/protocol.h"
#include "ground/link/udp_socket.h"
#include "ground/nodelets/background.h"
#include "ground/nodelets/controls.h"
#include "ground/nodelets/inheriting_mutex.h"
#include "ground/nodelets/messages.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/real_time_threads.h"
#include "ground/nodelets/shell.h"
#include "ground/nodelets/time.h"
#include "ground/safety/sender_gate.h"

namespace ground {

/// UDP link from the ROS graph to the craft.
///
/// Parameters:
/// - port (3333), bind_address (0.0.0.0)
/// - peer: HOST or HOST:PORT of the craft; empty: learned from its first datagram
/// - auto_arm (false): arms once, as soon as possible
/// - model: model file of the craft, for its thrusters, for the thrust that the fence counts, and to detect
///   that it does not follow its commands; empty: a left and a right thruster, and neither of the others
/// - own_stop: records of prove_stop, for a remark at arming if the craft of `model` is not proven
///   to stop by itself; empty: no remark
/// - room: file of a room; a craft that is about to leave it is a fault; empty: no bounds
/// - real_time (false): its threads ask for real-time priority (see wantsRealTime)
/// - bench (false): the craft is fastened; arms without a state, and allows thrust without lift
/// - those of Sender.cfg
///
/// Subscribes: controls, state. Publishes: ~status (latched), ~telemetry, sent (each command
/// that has left for the craft, with the time at which it did), drive (latched; start of the newest drive).
/// Services: ~arm and ~silence, in their own thread. Sends zero packets when disarmed, in fault and at the
/// end.
///
/// The thread of run() only communicates with the craft. Another one publishes and logs, so that a
/// hanging master or terminal cannot block the zero packets.
class Sender : public Shell {
 public:
  ~Sender() override {
    // First sends zeros, because leaving ROS may wait for the master.
    running_ = false;
    if (link_thread_.joinable()) link_thread_.join();
  }

 private:
  using Status = ground_msgs::SenderStatus;
  using Telemetry = ground_msgs::Telemetry;

  static constexpr int kFinalZeros = 10;         // zero packets at the end; UDP may lose some
  static constexpr double kFinalPeriod = 0.005;  // [s]
  static constexpr double kTick = 0.002;         // longest wait for the craft [s]
  static constexpr double kStatusPeriod = 0.5;   // [s]
  static constexpr double kSentPeriod = 0.02;    // longest interval of messages on the same command [s]
  static constexpr const char* kBench = "bench mode: without mocap there is no fence; tie the craft down";

  void start(ros::NodeHandle& nh, ros::NodeHandle& topics) override {
    real_time_ = wantsRealTime(nh);
    if (real_time_) callbacks_.prioritise(RealTimePriority::kSend);
    auto_arm_ = optionalParameter<bool>(nh, "auto_arm", false);
    const auto model_file = optionalParameter<std::string>(nh, "model", "");
    std::optional<Model> model;
    if (!model_file.empty()) {
      model = loadModelAndWarn(model_file);
      layout_ = model->thrusters;
      craft_ = model->name;
    }
    own_stop_ = optionalParameter<std::string>(nh, "own_stop", "");
    if (!own_stop_.empty() && model_file.empty())
      throw std::runtime_error("parameter own_stop needs parameter model, which names the craft");
    bench_ = optionalParameter<bool>(nh, "bench", false);
    const auto room = optionalParameter<std::string>(nh, "room", "");
    if (bench_) prepareForBench(room);
    if (!bench_ && room.empty()) NODELET_WARN("sender: no room, so no fence keeps the craft from a wall");
    if (!room.empty() && model_file.empty())
      NODELET_WARN("sender: no model, so the fence does not know how fast thrust takes the craft to a wall");
    remark_ = armingRemark();
    openLink(nh);
    if (model) gate_->setCraft(*model);
    if (!room.empty()) gate_->setFence(Fence(loadRoom(room), 0));

    status_publisher_ = nh.advertise<Status>("status", 10, true);
    telemetry_publisher_ = nh.advertise<Telemetry>("telemetry", 10);
    sent_publisher_ = topics.advertise<ground_msgs::Controls>("sent", 20);
    drive_publisher_ = topics.advertise<ground_msgs::Drive>("drive", 1, true);
    reconfigure_ = std::make_unique<LiveParameters<SenderConfig>>(
        nh, [this](const SenderConfig& c) { apply(paramsIn<GroundLinkParams>(c)); });
    const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
    state_subscriber_ = topics.subscribe("state", 1, &Sender::onState, this, hints);
    controls_subscriber_ = topics.subscribe("controls", 4, &Sender::onControls, this, hints);
    endTidilyOnSignals();
    if (real_time_) background_.add([] { prioritise(RealTimePriority::kReport); });
    link_thread_ = std::thread([this] { run(); });
    arm_service_ = arm_callbacks_.handle(nh).advertiseService("arm", &Sender::onArm, this);
    silence_service_ = arm_callbacks_.handle(nh).advertiseService("silence", &Sender::onSilence, this);
    NODELET_INFO("sender: listening on UDP port %d; no craft is connected yet",
                 static_cast<int>(socket_->port()));
  }

  /// Opens the socket and makes the link to the craft.
  void openLink(const ros::NodeHandle& nh) {
    const int port = optionalParameter<int>(nh, "port", 3333);
    if (port < 0 || port > 65535) throw std::runtime_error("port must be between 0 and 65535");
    const auto address = optionalParameter<std::string>(nh, "bind_address", "0.0.0.0");
    const auto peer_text = optionalParameter<std::string>(nh, "peer", "");
    const UdpAddress peer = peer_text.empty() ? UdpAddress() : UdpAddress::parse(peer_text);
    if (!peer_text.empty() && !peer.known())
      throw std::runtime_error("peer '" + peer_text + "' is not the address of a craft");
    socket_ = std::make_unique<UdpSocket>(UdpAddress::parse(address, static_cast<std::uint16_t>(port)));
    gate_ = std::make_unique<SenderGate>(
        GroundLinkParams(), peer,
        [this](const MotorCommand& command, const UdpAddress& to) {
          if (!socket_->send(encodeMotors(command, *layout_), to)) return std::string(std::strerror(errno));
          onSent(command);
          return std::string();
        },
        layout_);
  }

  /// Throws std::runtime_error if other parameters need a state or arm automatically.
  void prepareForBench(const std::string& room) {
    if (!room.empty()) throw std::runtime_error("a bench has no room: leave out parameter room or bench");
    if (auto_arm_)
      throw std::runtime_error("arm a craft on a bench by hand: leave out parameter auto_arm or bench");
    NODELET_WARN("sender: %s", kBench);
  }

  const GroundLink& link() const { return gate_->link(); }

  /// roscpp shuts down only on SIGINT; SIGTERM and SIGHUP would kill the process before its zeros.
  static void endTidilyOnSignals() {
    struct sigaction interrupt = {}, current = {};
    if (sigaction(SIGINT, nullptr, &interrupt) != 0 || interrupt.sa_handler == SIG_DFL ||
        interrupt.sa_handler == SIG_IGN)
      return;
    for (const int signal : {SIGTERM, SIGHUP})
      if (sigaction(signal, nullptr, &current) == 0 && current.sa_handler == SIG_DFL)
        sigaction(signal, &interrupt, nullptr);
  }

  void apply(GroundLinkParams params) {
    params.require_state = !bench_;
    params.require_lift = params.require_lift && !bench_;
    const std::lock_guard lock(mutex_);
    gate_->setParams(params);
  }

  static Instant now() { return {steadyNow(), ros::Time::now().toSec()}; }

  void onControls(const ros::MessageEvent<ground_msgs::Controls const>& event) {
    const ground_msgs::Controls& controls = *event.getMessage();
    const std::lock_guard lock(mutex_);
    const std::string other = misfit(controls, *layout_);
    if (other.empty())
      gate_->command(now(), controls.header.stamp.toSec(), event.getPublisherName(), readInputs(controls));
    else
      gate_->link(now()).refuseCommand(steadyNow(), event.getPublisherName(), other);
    collect();
  }

  void onState(const ground_msgs::State::ConstPtr& state) {
    const std::lock_guard lock(mutex_);
    gate_->state(now(), measuredState(*state, state->header.stamp.toSec()));
    collect();
  }

  /// Publishes a command that was sent. mutex_ is held.
  void onSent(const MotorCommand& command) {
    const ros::Time now = ros::Time::now();
    const double steady = steadyNow();
    if (now.isZero() || (command == published_ && steady < next_sent_)) return;
    published_ = command;
    next_sent_ = steady + kSentPeriod;
    auto message = boost::make_shared<ground_msgs::Controls>();
    message->header.stamp = now;
    const double lift = std::clamp(command.lift, 0.0, 1.0);
    writeInputs({layout_->clipped(command.thrusters), lift}, *layout_, *message);
    background_.add([this, message] { sent_publisher_.publish(message); });
  }

  /// Remark at arming about a bench and the craft's own stop; reads a file.
  std::string armingRemark() const {
    const std::string stop = own_stop_.empty() ? "" : ownStopRemark(own_stop_, craft_);
    if (!bench_) return stop;
    return stop.empty() ? kBench : kBench + ("; " + stop);
  }

  bool onArm(std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response) {
    const std::string remark = armingRemark();
    const std::lock_guard lock(mutex_);
    remark_ = remark;
    auto_arm_ = false;
    if (request.data) {
      // A drive that begins now would begin at 0, and its time would jump when the clock starts.
      const std::string problem = ros::Time::now().isZero() ? "the simulated clock has not started"
                                                            : gate_->link(now()).arm(steadyNow(), remark_);
      response.success = problem.empty();
      response.message = problem.empty() ? "armed" : "not armed: " + problem;
      if (problem.empty() && !remark_.empty()) response.message += "; " + remark_;
    } else {
      gate_->link(now()).disarm(steadyNow(), "disarmed by hand");
      response.success = true;
      response.message = "disarmed";
    }
    collect();
    return true;
  }

  bool onSilence(ground_msgs::Silence::Request& request, ground_msgs::Silence::Response& response) {
    const std::lock_guard lock(mutex_);
    response.message = gate_->silence(now(), request.duration);
    response.success = response.message.empty();
    if (response.success) response.last_packet = ros::Time::now();
    collect();
    return true;
  }

  /// Receives datagrams, checks timeouts, repeats packets and the status, by the steady clock.
  void run() {
    if (real_time_) prioritise(RealTimePriority::kSend);
    std::string data;
    UdpAddress from;
    double wait = 0;
    // ros::ok() holds until the end of roscpp's shutdown, which may wait for the master.
    while (running_ && !ros::isShuttingDown() && ros::ok()) {
      const bool came = socket_->receive(wait, data, from);
      const std::lock_guard lock(mutex_);
      const Instant at = now();
      const std::string jump = time_watch_.look();
      if (!jump.empty()) gate_->timeJumped(at, jump);
      GroundLink& link = gate_->link(at);
      if (came) {
        CraftTelemetry telemetry;
        const bool understood = decodeTelemetry(data, telemetry);
        if (link.datagram(at.steady, understood ? std::make_optional(telemetry) : std::nullopt, from))
          report(telemetry);
      }
      gate_->tick(at);
      if (auto_arm_ && at.time > 0 && link.arm(at.steady, remark_).empty()) auto_arm_ = false;
      wait = std::clamp(link.nextPacket() - at.steady, 0.0, kTick);
      collect();
      if (at.steady >= next_status_) reportStatus();
    }
    for (int i = 0; i < kFinalZeros; ++i) {
      {
        const std::lock_guard lock(mutex_);
        auto_arm_ = false;
        GroundLink& link = gate_->link(now());
        if (i == 0) link.stop(steadyNow(), "the sender ends");
        link.sendZero(steadyNow());
        collect();
      }
      std::this_thread::sleep_for(std::chrono::duration<double>(kFinalPeriod));
    }
  }

  /// Queues the status if it has changed. mutex_ is held.
  void collect() {
    if (gate_->drive().starts().size() != drives_) reportDrive();
    if (link().revision() != collected_) reportStatus();
  }

  /// Publishes the start of the newest drive, if there is one. mutex_ is held.
  void reportDrive() {
    auto message = boost::make_shared<ground_msgs::Drive>();
    message->header.stamp = ros::Time::now();
    drives_ = gate_->drive().starts().size();
    const double origin = gate_->drive().origin(message->header.stamp.toSec() - gate_->epoch());
    if (!std::isfinite(origin)) return;
    message->began = ros::Time(gate_->epoch() + origin);
    background_.add([this, message] { drive_publisher_.publish(message); });
  }

  /// Publishes what the craft has measured. mutex_ is held.
  void report(const CraftTelemetry& t) {
    if (t.voltage && std::isfinite(*t.voltage) && *t.voltage > 0) gate_->voltage(*t.voltage);
    auto message = boost::make_shared<Telemetry>();
    message->header.stamp = ros::Time::now();
    message->voltage = t.voltage.value_or(0);
    message->roll = t.roll;
    message->pitch = t.pitch;
    message->yaw = t.yaw;
    std::copy(t.acc.begin(), t.acc.end(), message->acc.begin());
    std::copy(t.gyro.begin(), t.gyro.end(), message->gyro.begin());
    std::copy(t.mag.begin(), t.mag.end(), message->mag.begin());
    background_.add([this, message] { telemetry_publisher_.publish(message); });
  }

  /// Publishes and logs the status. mutex_ is held.
  void reportStatus() {
    collected_ = link().revision();
    next_status_ = steadyNow() + kStatusPeriod;
    reportDrive();
    auto message = boost::make_shared<Status>();
    message->header.stamp = ros::Time::now();
    message->state = static_cast<std::uint8_t>(link().current());
    message->reason = link().reason();
    if (link().peer().port != 0) message->peer = link().peer().text();
    const GroundLink::Counters& counters = link().counters();
    message->sent = counters.sent;
    message->received = counters.received;
    message->malformed = counters.malformed;
    message->foreign = counters.foreign;
    message->refused = counters.refused;
    background_.add(
        [this, message, refusal = link().refusal(), problem = link().sendProblem(), remark = remark_] {
          log(*message, refusal, remark);
          status_publisher_.publish(message);
          if (!problem.empty())
            NODELET_WARN_THROTTLE(2, "sender: packets cannot be sent: %s", problem.c_str());
        });
  }

  void log(const Status& status, const std::string& refusal, const std::string& remark) {
    static const char* kNames[] = {"DISARMED", "ARMED", "FAULT"};
    if (status.state != logged_.state || status.reason != logged_.reason) {
      const bool warns = status.state == Status::FAULT || (status.state == Status::ARMED && !remark.empty());
      ROS_LOG(warns ? ros::console::levels::Warn : ros::console::levels::Info, ROSCONSOLE_DEFAULT_NAME,
              "sender: %s: %s", kNames[status.state], status.reason.c_str());
    }
    if (status.peer != logged_.peer) NODELET_INFO("sender: the craft is at %s", status.peer.c_str());
    if (status.refused != logged_.refused)
      NODELET_WARN("sender: %lu commands refused, last: %s",
                   static_cast<unsigned long>(status.refused - logged_.refused), refusal.c_str());
    logged_ = status;
  }

  CallbackThread arm_callbacks_;
  InheritingMutex mutex_;  ///< guards all members down to next_status_
  std::unique_ptr<UdpSocket> socket_;
  std::unique_ptr<SenderGate> gate_;
  ThrusterLayoutPtr layout_ = thrusterPair();  ///< constant after start()
  bool bench_ = false;                         ///< no state is needed; constant after start()
  bool real_time_ = false;                     ///< constant after start()
  std::string remark_;  ///< remark of the last arming about bench and own stop; may be empty
  bool auto_arm_ = false;
  std::uint64_t collected_ = 0;  ///< revision of the link in the newest status
  MotorCommand published_;       ///< the last one on `sent`
  double next_sent_ = 0;         ///< when it is published again, steady clock [s]
  double next_status_ = 0;       ///< steady clock [s]
  std::size_t drives_ = 0;       ///< drives that were reported; guarded by mutex_
  RosTimeWatch time_watch_;      ///< used only by run()
  Status logged_;                ///< used only in the thread of background_
  std::atomic<bool> running_{true};
  ros::Publisher status_publisher_, telemetry_publisher_, drive_publisher_, sent_publisher_;
  Background background_;  ///< outlives what reports, and is outlived by the publishers
  ros::Subscriber controls_subscriber_, state_subscriber_;
  ros::ServiceServer arm_service_, silence_service_;
  std::string own_stop_, craft_;  ///< file of records, name of the craft; constant after start()
  std::unique_ptr<LiveParameters<SenderConfig>> reconfigure_;
  std::thread link_thread_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::Sender, nodelet::Nodelet)
