#pragma once

#include <ground_msgs/ControllerStatus.h>
#include <ground_msgs/Controls.h>
#include <ground_msgs/Decision.h>
#include <ground_msgs/Drive.h>
#include <ground_msgs/SenderStatus.h>
#include <ground_msgs/State.h>
#include <ground_msgs/Telemetry.h>
#include <std_srvs/Trigger.h>

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "ground/control/reference_pilot.h"
#include "ground/nodelets/background.h"
#include "ground/nodelets/inheriting_mutex.h"
#include "ground/nodelets/shell.h"
#include "ground/nodelets/time.h"

namespace ground {

/// Base of all controllers: receives states, sends commands, with a ControllerLifecycle in between.
/// It owns the Pilot that computes the commands, whose functions are called with mutex() held. Where a
/// pilot needs nothing else of the nodelet, ControllerOf is all of it.
///
/// Several controllers may be loaded into one manager; the one that was started last drives. Its
/// commands carry its name in frame_id. The controller that drove before stops and sends nothing,
/// and the lift stays on.
///
/// Parameters: real_time (false: ordinary priority; see wantsRealTime), auto_start (false),
/// require_armed (true: wait for the sender), require_state (true; false only on a bench, where the
/// craft is fastened), room (file of the room in which the craft is kept; empty: the sender's room,
/// if it has one). They cannot be changed at run time. Subscribes: state, sender/status, controls, drive
/// (start of the drive, for a model loaded in the middle of it), sender/telemetry (the voltage of the
/// battery, on which the thrust of a model may depend). Publishes: controls, ~status (latched),
/// and, after the command of a closed-loop decision, controls/wanted (the inputs before saturation) and
/// decision (its processor time). Services: ~start, ~stop, in their own thread.
class Controller : public Shell {
 public:
  ~Controller() override;

 protected:
  /// Does not call the pilot until it is loaded.
  explicit Controller(std::unique_ptr<Pilot> pilot) : pilot_(std::move(pilot)) {}
  /// Ends thread and callbacks, and sends zero inputs. The destructor of a child must call it first if its
  /// pilot or sent() uses members of the child.
  void shutdown();
  Pilot& pilot() { return *pilot_; }
  /// Loads parameters and advertises; throws if anything is missing or wrong. Called without mutex(),
  /// which callbacks of LiveParameters lock after its own.
  virtual void load(ros::NodeHandle& nh) = 0;
  /// Handle for topics.
  ros::NodeHandle topics() { return callbacks_.handle(getNodeHandle()); }
  /// Takes effect at once; require_armed and require_state do not change. Call from any thread.
  void setParams(LifecycleParams params);
  /// The room in which the life cycle keeps the craft; constant after loading.
  const std::optional<Room>& room() const { return room_; }
  /// Whether it waits for a state and stops without one; constant after loading.
  bool requiresState() const { return require_state_; }
  /// Guards the data shared by child and base.
  InheritingMutex& mutex() { return mutex_; }
  /// For what is logged with mutex() held.
  Background& log() { return log_; }
  /// Called after each command with mutex() held, for what need not come before it.
  virtual void sent() {}
  /// Publishes a decision after its command.
  void note(const ReferencePilot::Decision& decision);
  /// ROS time on the clock of the pilot's stamps: since the nodelet was loaded [s].
  double seconds(const ros::Time& time) const { return secondsBetween(epoch_, time); }
  /// Stamp of the newest state.
  const ros::Time& measuredAt() const { return measured_at_; }

 private:
  using Status = ground_msgs::ControllerStatus;

  void start(ros::NodeHandle& nh, ros::NodeHandle& topics) final;
  void onDrive(const ground_msgs::Drive::ConstPtr& message);
  void onTelemetry(const ground_msgs::Telemetry::ConstPtr& message);
  void onState(const ground_msgs::State::ConstPtr& message);
  void onControls(const ground_msgs::Controls::ConstPtr& message);
  void onSender(const ground_msgs::SenderStatus::ConstPtr& message);
  bool onStart(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response);
  bool onStop(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response);
  void run();
  double watch();
  Instant now() const { return {steadyNow(), seconds(ros::Time::now())}; }
  void publish(const Inputs& inputs);
  void changed();
  void publishStatus();

  std::unique_ptr<Pilot> pilot_;  ///< guarded by mutex_
  Background log_;
  CallbackThread service_callbacks_;
  InheritingMutex mutex_;  ///< guards everything below
  std::string name_;
  ros::Time epoch_, measured_at_;
  ControllerLifecycle life_{*pilot_, [this](const Inputs& inputs) { publish(inputs); },
                            [this] { changed(); }};
  std::optional<Room> room_;
  bool auto_start_ = false;
  bool real_time_ = false;  ///< constant after loading
  bool require_state_ = true;
  RosTimeWatch time_watch_;
  double next_status_ = 0;  ///< steady clock [s]
  ground_msgs::Controls::Ptr wanted_;
  ground_msgs::Decision::Ptr decision_;  ///< null if it is published
  ros::Publisher controls_, status_, wanted_publisher_, decision_publisher_;
  ros::Subscriber state_subscriber_, sender_subscriber_, controls_subscriber_, drive_subscriber_,
      telemetry_subscriber_;
  ros::ServiceServer start_service_, stop_service_;
  std::condition_variable_any wake_;
  std::atomic<bool> alive_{true};
  std::thread thread_;
};

/// A controller that is its pilot: P is a Pilot that can be made without arguments and has
/// LifecycleParams load(ros::NodeHandle&), which reads parameters once and throws if one is missing or wrong.
template <class P>
class ControllerOf : public Controller {
 public:
  ControllerOf() : Controller(std::make_unique<P>()) {}
  ~ControllerOf() override { shutdown(); }

 private:
  void load(ros::NodeHandle& nh) override { setParams(static_cast<P&>(pilot()).load(nh)); }
};

}  // namespace ground
