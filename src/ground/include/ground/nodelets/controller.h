#pragma once

#include <ground_msgs/ControllerStatus.h>
#include <ground_msgs/Controls.h>
#include <ground_msgs/SenderStatus.h>
#include <ground_msgs/State.h>
#include <nodelet/nodelet.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <atomic>
#include <condition_variable>
#include <limits>
#include <mutex>
#include <string>
#include <thread>

#include "ground/model/dynamics.h"
#include "ground/nodelets/callback_thread.h"
#include "ground/nodelets/time.h"

namespace ground {

/// What all controllers are tuned with.
struct ControllerParams {
  double lift = 1.0;           ///< input of the lift fan while the craft is driven, 0..1
  double lift_time = 1.0;      ///< lift alone before the thrusters start [s]
  double state_timeout = 0.2;  ///< oldest state with which to drive [s]
  double recovery_time = 0.0;  ///< without a state that zero thrust bridges before a stop [s]
  double rate = 50.0;          ///< of closed-loop control [Hz]
};

/// Base of all controllers: state in, commands out, and everything in between that keeps the craft
/// safe. A child says what to command.
///
/// IDLE, WAITING (for a valid state and an armed sender), LIFTING, RUNNING, then DONE or STOPPED.
/// Zero inputs go out in every state but LIFTING and RUNNING. It stops itself when the state is
/// stale or invalid for recovery_time (until then thrust is zero), when the sender disarms, when
/// ROS time is set (RosTimeWatch), when state or command are not finite and when the child objects.
///
/// Several controllers may be loaded into one manager: the one that was started last drives. It
/// says its name in the frame_id of its commands; whoever drove until then stops and is silent, and
/// the lift stays on.
///
/// Parameters: auto_start (false), require_armed (true: wait for the sender). Subscribes: state,
/// sender/status, controls. Publishes: controls, ~status (latched). Services: ~start, ~stop, in a
/// thread of their own.
class Controller : public nodelet::Nodelet {
 public:
  ~Controller() override;

 protected:
  /// Ends thread and callbacks with zero inputs; to be called first by every child's destructor,
  /// since they call into the child.
  void shutdown();
  /// Loads parameters and advertises; throws on anything missing or wrong.
  virtual void load(ros::NodeHandle& nh) = 0;
  /// Called when RUNNING begins, at the time of `stamp`; what it throws refuses the start.
  virtual void activate(const ros::Time& stamp) = 0;
  /// Called when RUNNING ends for whatever reason.
  virtual void deactivate() {}
  /// Why it has to stop, empty when it may go on; asked before every update.
  virtual std::string objection(const ros::Time& /*stamp*/, const RigidState<double>& /*state*/) {
    return "";
  }
  /// Inputs left, right at `elapsed` seconds since RUNNING began.
  virtual Vector2<double> update(double elapsed, const ros::Time& stamp,
                                 const RigidState<double>& state) = 0;
  virtual bool finished(double elapsed) const = 0;
  /// Every command, also those of other controllers: left, right, lift, 0..1.
  virtual void published(const ros::Time& /*stamp*/, double /*left*/, double /*right*/,
                         double /*lift*/) {}
  /// What whoever starts it should know; empty when nothing.
  virtual std::string caution() const { return ""; }
  /// When an open-loop controller changes its inputs next, seconds since RUNNING began; a
  /// closed-loop one is driven by the state instead, at most at `rate`.
  virtual double nextChange(double /*elapsed*/) const { return kByState; }

  static constexpr double kByState = -1.0;

  /// Where topics are advertised and subscribed.
  ros::NodeHandle topics() { return callbacks_.handle(getNodeHandle()); }
  /// Takes effect at once. Call from any thread.
  void setParams(const ControllerParams& params);
  /// Guards what child and base share; held while load, activate, update, deactivate are called.
  std::recursive_mutex& mutex() { return mutex_; }
  bool running() const { return state_ == ground_msgs::ControllerStatus::RUNNING; }

 private:
  using Status = ground_msgs::ControllerStatus;

  void onInit() override;
  void onState(const ground_msgs::State::ConstPtr& message);
  void onControls(const ground_msgs::Controls::ConstPtr& message);
  void onSender(const ground_msgs::SenderStatus::ConstPtr& message);
  bool onStart(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response);
  bool onStop(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response);
  void run();
  double watch();
  bool started() const;
  double liftAlone() const;
  void change(std::uint8_t state, const std::string& reason);
  void enter(std::uint8_t state, const std::string& reason);
  std::string start();
  void begin(const ros::Time& stamp);
  void control(const ros::Time& stamp);
  std::string stateProblem() const;
  bool stateIsFinite() const;
  std::string jumped(const ground_msgs::State& state) const;
  bool bridge(double now, const std::string& problem);
  void publish(double left, double right, double lift);
  void publishStatus();

  CallbackThread callbacks_, service_callbacks_;
  std::recursive_mutex mutex_;  ///< guards everything below
  ControllerParams params_;
  std::string name_;
  std::uint8_t state_ = Status::IDLE;
  std::string reason_ = "not started yet";
  bool auto_start_ = false, require_armed_ = true;
  bool armed_ = false;
  ground_msgs::State::ConstPtr measured_;
  ground_msgs::State::ConstPtr known_;  ///< the last one with which it was driven
  double measured_at_ = -std::numeric_limits<double>::infinity();  ///< steady clock [s]
  RosTimeWatch time_watch_;
  ros::Time lifting_since_, running_since_, last_update_;
  double started_at_ = 0;    ///< steady clock [s]
  double others_until_ = 0;  ///< how long another controller may be taken to drive [s]
  bool lifted_ = false;      ///< by another controller, whose place is taken
  double lost_since_ = 0;    ///< when the state was lost while RUNNING, 0 while it is there
  double next_keepalive_ = 0, next_status_ = 0;  ///< steady clock [s]
  ros::Publisher controls_, status_;
  ros::Subscriber state_subscriber_, sender_subscriber_, controls_subscriber_;
  ros::ServiceServer start_service_, stop_service_;
  std::condition_variable_any wake_;
  std::atomic<bool> alive_{true};
  std::thread thread_;
};

}  // namespace ground
