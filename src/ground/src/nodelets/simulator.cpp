#include <geometry_msgs/PoseStamped.h>
#include <ground/SimulatorConfig.h>
#include <ground_msgs/State.h>
#include <rosgraph_msgs/Clock.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <mutex>
#include <pluginlib/class_list_macros.hpp>
#include <random>
#include <stdexcept>
#include <thread>

#include "ground/estimation/axis_mapping.h"
#include "ground/link/protocol.h"
#include "ground/link/udp_socket.h"
#include "ground/model/model_file.h"
#include "ground/model/plausibility.h"
#include "ground/nodelets/controls.h"
#include "ground/nodelets/messages.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/model_service.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/shell.h"
#include "ground/simulation/simulated_imu.h"
#include "ground/simulation/simulated_lab.h"

namespace ground {

/// Simulates craft and room: uses the craft's UDP protocol with the sender, moves the craft by the
/// model, and publishes the mocap's poses in OptiTrack's frame. Publishes the time: /clock runs at
/// real_time_factor.
///
/// Parameters: model (model file, required), sender ("127.0.0.1:3333"), seed (1), mocap_rate (100
/// Hz), axes ("x, z, -y"), x, y, psi (initial pose, world_ned), and those of Simulator.cfg, which can be
/// changed at run time; battery_endurance (0 s: no battery; see BatteryParams), battery_charge (1).
/// Publishes: vrpn_client_node/hovercraft/pose, ~truth (the true state), /clock. Service: ~load_model
/// (replaces the model by another file). The factors of Simulator.cfg multiply the parameters of the loaded
/// model.
class Simulator : public Shell {
 public:
  ~Simulator() override {
    alive_ = false;
    if (thread_.joinable()) thread_.join();
  }

 private:
  using Config = SimulatorConfig;
  using SteadyClock = std::chrono::steady_clock;

  void start(ros::NodeHandle& nh, ros::NodeHandle& topics) override {
    loaded_ = loadModelAndWarn(requiredParameter<std::string>(nh, "model"));
    input_max_ = loaded_.body.input_max;
    const int seed = optionalParameter<int>(nh, "seed", 1);
    if (seed < 0) throw std::runtime_error("parameter seed must not be negative");
    SimulatedLab::Params room;
    room.seed = static_cast<unsigned long>(seed);
    room.start = 1000;
    imu_ = SimulatedImu(static_cast<unsigned>(seed));
    room.initial.eta << optionalParameter<double>(nh, "x", 0.0), optionalParameter<double>(nh, "y", 0.0),
        optionalParameter<double>(nh, "psi", 0.0);
    if (!room.initial.eta.allFinite()) throw std::runtime_error("x, y and psi must be finite");
    room.battery = {optionalParameter<double>(nh, "battery_endurance", 0.0),
                    optionalParameter<double>(nh, "battery_charge", 1.0)};
    mocap_.rate = optionalParameter<double>(nh, "mocap_rate", 100.0);
    mapping_ = AxisMapping(optionalParameter<std::string>(nh, "axes", AxisMapping::kOptiTrack));
    sender_ = UdpAddress::parse(optionalParameter<std::string>(nh, "sender", "127.0.0.1"), 3333);
    socket_ = std::make_unique<UdpSocket>(UdpAddress());
    craft_ = std::make_unique<ModelCraft>(loaded_, room);
    room_ = std::make_unique<SimulatedLab>(*craft_, mocap_, room);

    pose_publisher_ = topics.advertise<geometry_msgs::PoseStamped>("vrpn_client_node/hovercraft/pose", 10);
    truth_publisher_ = nh.advertise<ground_msgs::State>("truth", 10);
    clock_publisher_ = topics.advertise<rosgraph_msgs::Clock>("/clock", 10);
    reconfigure_ = std::make_unique<LiveParameters<Config>>(nh, [this](const Config& c) { apply(c); });
    model_service_ =
        ModelService(reconfigure_->thread(), nh, "load_model", [this](const Model& m, const std::string&) {
          const std::lock_guard<std::mutex> lock(mutex_);
          requireSameThrusters(*loaded_.thrusters, *m.thrusters);
          craft_->setModel(scaled(m, factors_));
          loaded_ = m;
          input_max_ = m.body.input_max;
          return std::string();
        });
    thread_ = std::thread([this] { run(); });
  }

  /// Factors on parameters of the body, in the order of kScaled.
  using Factors = std::array<double, 6>;
  static constexpr std::array<const char*, 6> kScaled = {"k", "m", "I_z", "X_u", "Y_v", "N_r"};

  static Factors factors(const Config& c) {
    return {c.k_factor, c.m_factor, c.I_z_factor, c.X_u_factor, c.Y_v_factor, c.N_r_factor};
  }

  /// Throws std::exception if the scaled parameters are invalid or refused as implausible.
  static Model scaled(Model model, const Factors& factors) {
    for (std::size_t i = 0; i < factors.size(); ++i)
      if (factors[i] != 1) model.setValue(kScaled[i], factors[i] * model.value(kScaled[i]));
    for (const Implausibility& found : implausibilities(model.body, *model.thrusters))
      if (found.refused) throw std::invalid_argument(found.key + ": " + found.message);
    return model;
  }

  void apply(const Config& c) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (room_->time() + c.clock_offset <= 0)
      throw std::invalid_argument("clock_offset must leave the time positive");
    if (factors(c) != factors_) {
      craft_->setModel(scaled(loaded_, factors(c)));  // throws if the craft cannot go on by it
      factors_ = factors(c);
    }
    setFields(mocap_, MocapParams::table(), c);
    room_->setMocap(mocap_);
    room_->setWatchdog(c.watchdog);
    wall_origin_ = last_turn_ = SteadyClock::now();
    time_origin_ = room_->time();
    real_time_factor_ = c.real_time_factor;
    clock_offset_ = c.clock_offset;
  }

  /// Simulated time from the wall clock [s]. A turn of run() advances it by at most kLongestTurn of
  /// wall time, so that the simulation waits for the controllers when the computer is busy or the
  /// process was stopped. It also waits while the clock of this process lags behind: its nodelets
  /// would receive poses that are ahead of their time.
  double timeNow() {
    const auto now = SteadyClock::now();
    constexpr SteadyClock::duration kNone{0};
    const SteadyClock::duration longest = clockLags() ? kNone : kLongestTurn;
    wall_origin_ += std::max(now - last_turn_ - longest, kNone);
    last_turn_ = now;
    const std::chrono::duration<double> wall = now - wall_origin_;
    return time_origin_ + real_time_factor_ * wall.count();
  }

  /// Whether ros::Time of this process, which another thread sets, is far from the published time.
  bool clockLags() const {
    if (!ros::Time::isSimTime()) return false;
    const std::chrono::duration<double> most = kLongestTurn;
    return std::abs(published_ - ros::Time::now().toSec()) > real_time_factor_ * most.count();
  }

  void run() {
    std::string datagram;
    UdpAddress from;
    double next_telemetry = 0, next_truth = 0;
    while (alive_) {
      const bool came = socket_->receive(kTick, datagram, from);
      std::unique_lock<std::mutex> lock(mutex_);
      const double now = timeNow();
      room_->advance(now);
      if (came && from == sender_) obey(datagram);
      const auto frames = room_->takeFrames();
      const RigidState<double> state = room_->state(), rate = room_->derivative();
      const double voltage = room_->voltage();
      const double offset = clock_offset_;
      lock.unlock();

      publishClock(now + offset);
      for (const MocapFrame& frame : frames) publishPose(frame, offset);
      if (now >= next_truth) {
        publishTruth(now + offset, state, rate);
        next_truth = now + kTruthPeriod;
      }
      if (now >= next_telemetry) {
        sendTelemetry(state, rate, voltage);
        next_telemetry = now + kTelemetryPeriod;
      }
    }
  }

  void obey(const std::string& datagram) {
    MotorCommand command;
    std::string why;
    if (!decodeMotors(datagram, command, &why, *loaded_.thrusters)) {
      NODELET_WARN_THROTTLE(1, "simulator: a datagram of the sender is not a Motors message: %s",
                            why.c_str());
      return;
    }
    ++commands_;
    room_->command(input_max_ * asVector(command.thrusters), command.lift);
  }

  void publishClock(double now) {
    auto clock = boost::make_shared<rosgraph_msgs::Clock>();
    clock->clock = ros::Time(now);
    clock_publisher_.publish(clock);
    published_ = now;
  }

  void publishPose(const MocapFrame& frame, double offset) {
    Eigen::Vector3d p;
    Eigen::Quaterniond q;
    mapping_.toMocap(frame.eta, kMarkerHeight, p, q);
    auto pose = boost::make_shared<geometry_msgs::PoseStamped>();
    pose->header.stamp = ros::Time(frame.captured + offset);
    pose->header.frame_id = "mocap";
    pose->pose.position.x = p.x();
    pose->pose.position.y = p.y();
    pose->pose.position.z = p.z();
    pose->pose.orientation.w = q.w();
    pose->pose.orientation.x = q.x();
    pose->pose.orientation.y = q.y();
    pose->pose.orientation.z = q.z();
    pose_publisher_.publish(pose);
  }

  void publishTruth(double now, const RigidState<double>& state, const RigidState<double>& rate) {
    auto truth = inWorld<ground_msgs::State>(ros::Time(now));
    for (int i = 0; i < 3; ++i) {
      truth->eta[i] = state.eta(i);
      truth->nu[i] = state.nu(i);
      truth->nu_dot[i] = rate.nu(i);
    }
    truth->valid = true;
    truth_publisher_.publish(truth);
  }

  void sendTelemetry(const RigidState<double>& state, const RigidState<double>& rate, double voltage) {
    CraftTelemetry telemetry;
    telemetry.yaw = static_cast<float>(180 / M_PI * wrapAngle(state.eta.z()));
    const ImuSample felt = imu_.sample(state, rate.nu);
    telemetry.acc = {felt.acceleration[0], felt.acceleration[1], -SimulatedImu::kGravity};
    telemetry.gyro = {0, 0, felt.yaw_rate};
    telemetry.commands = commands_;
    telemetry.boot = boot_;
    if (voltage > 0) telemetry.voltage = static_cast<float>(voltage);
    socket_->send(encodeTelemetry(telemetry), sender_);
  }

  static constexpr std::chrono::milliseconds kLongestTurn{20};  // longest turn of run(), wall time
  static constexpr double kTick = 0.001;                        // longest wait for a datagram, wall time [s]
  static constexpr double kTruthPeriod = 0.01;                  // [s]
  static constexpr double kTelemetryPeriod = 0.01;              // [s]
  static constexpr double kMarkerHeight = 0.04;                 // height of the markers above the floor [m]

  std::mutex mutex_;  ///< guards craft_, room_, loaded_, factors_, input_max_, origins, factor and offset
  Model loaded_;      ///< model as in its file, without factors
  Factors factors_ = {1, 1, 1, 1, 1, 1};
  std::unique_ptr<ModelCraft> craft_;
  std::unique_ptr<SimulatedLab> room_;
  SteadyClock::time_point wall_origin_, last_turn_;
  double time_origin_ = 0, real_time_factor_ = 1;
  double clock_offset_ = 0;  ///< published times minus times of the room [s]
  MocapParams mocap_;
  AxisMapping mapping_;
  double input_max_ = 1;
  std::uint32_t commands_ = 0;  ///< number of commands received; used only by run()
  const std::uint32_t boot_ = std::random_device()();
  SimulatedImu imu_{1};   ///< used only by run()
  double published_ = 0;  ///< last time on /clock [s]; used only by run()
  UdpAddress sender_;
  std::unique_ptr<UdpSocket> socket_;
  ros::Publisher pose_publisher_, truth_publisher_, clock_publisher_;
  std::atomic<bool> alive_{true};
  std::thread thread_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
  ModelService model_service_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::Simulator, nodelet::Nodelet)
