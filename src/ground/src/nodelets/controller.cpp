#include "ground/nodelets/controller.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "ground/nodelets/controls.h"
#include "ground/nodelets/messages.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/real_time_threads.h"
#include "ground/safety/fence_bound.h"

namespace ground {
namespace {

constexpr double kStatusPeriod = 0.5;  // [s]
constexpr double kWatch = 0.005;       // longest interval of ticks of the life cycle [s]
// Largest pace of a simulated clock [-], and shortest interval of ticks with it [s].
constexpr double kMaxPace = 10, kSimulatedTick = 5e-4;

}  // namespace

Controller::~Controller() { shutdown(); }

void Controller::shutdown() {
  if (!alive_.exchange(false)) return;
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
  state_subscriber_.shutdown();
  sender_subscriber_.shutdown();
  controls_subscriber_.shutdown();
  drive_subscriber_.shutdown();
  telemetry_subscriber_.shutdown();
  start_service_.shutdown();
  stop_service_.shutdown();
  const std::lock_guard lock(mutex_);
  if (controls_) life_.sendZero(now());
}

void Controller::start(ros::NodeHandle& nh, ros::NodeHandle& topics) {
  name_ = getName();
  ros::NodeHandle services = service_callbacks_.handle(getPrivateNodeHandle());
  epoch_ = ros::Time::now();
  auto_start_ = optionalParameter<bool>(nh, "auto_start", false);
  real_time_ = wantsRealTime(nh);
  if (real_time_) callbacks_.prioritise(RealTimePriority::kControl);
  LifecycleParams params;
  params.require_armed = optionalParameter<bool>(nh, "require_armed", true);
  params.require_state = require_state_ = optionalParameter<bool>(nh, "require_state", true);
  life_.setParams(params);
  auto room = optionalParameter<std::string>(nh, "room", "");
  if (room.empty()) room = optionalParameter<std::string>(topics, "sender/room", "");
  if (!room.empty() && !require_state_)
    throw std::runtime_error("the room needs the state (require_state): leave out room");
  if (!room.empty()) {
    room_ = loadRoom(room);
    life_.setFence(Fence(*room_, room_->margin));
  }
  controls_ = topics.advertise<ground_msgs::Controls>("controls", 4);
  wanted_publisher_ = topics.advertise<ground_msgs::Controls>("controls/wanted", 4);
  decision_publisher_ = topics.advertise<ground_msgs::Decision>("decision", 4);
  status_ = nh.advertise<Status>("status", 1, true);
  load(nh);
  if (room_)
    NODELET_INFO("%s: %s", name_.c_str(), fenceBound(*room_, fullAcceleration(*pilot_, now().time)).c_str());
  start_service_ = services.advertiseService("start", &Controller::onStart, this);
  stop_service_ = services.advertiseService("stop", &Controller::onStop, this);
  const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
  drive_subscriber_ = topics.subscribe("drive", 4, &Controller::onDrive, this);
  sender_subscriber_ = topics.subscribe("sender/status", 4, &Controller::onSender, this, hints);
  controls_subscriber_ = topics.subscribe("controls", 4, &Controller::onControls, this, hints);
  telemetry_subscriber_ = topics.subscribe("sender/telemetry", 4, &Controller::onTelemetry, this);
  state_subscriber_ = topics.subscribe("state", 1, &Controller::onState, this, hints);
  {
    const std::lock_guard lock(mutex_);
    publishStatus();  // whoever hears it finds the services
  }
  thread_ = std::thread([this] { run(); });
}

void Controller::setParams(LifecycleParams params) {
  const std::lock_guard lock(mutex_);
  params.require_armed = life_.params().require_armed;
  params.require_state = require_state_;
  life_.setParams(params);
}

void Controller::onDrive(const ground_msgs::Drive::ConstPtr& message) {
  const std::lock_guard lock(mutex_);
  const double began = seconds(message->began), as_of = seconds(message->header.stamp);
  life_.attempt([&] { pilot_->driveBegan(began, as_of); });
}

void Controller::onTelemetry(const ground_msgs::Telemetry::ConstPtr& message) {
  const std::optional<double> volts = voltageIn(*message);
  if (!volts) return;
  const std::lock_guard lock(mutex_);
  life_.attempt([&] { pilot_->voltage(*volts); });
}

void Controller::onControls(const ground_msgs::Controls::ConstPtr& message) {
  const std::string& driver = message->header.frame_id;
  const std::lock_guard lock(mutex_);
  if (driver.empty() || driver == name_) return;
  const bool fits = misfit(*message, life_.layout()).empty();
  if (fits && !readInputs(*message).finite()) return;
  const double stamp = seconds(message->header.stamp);
  if (fits) life_.attempt([&] { pilot_->commanded(stamp, readInputs(*message)); });
  if (std::isfinite(message->lift)) life_.otherDrives(now(), driver, message->lift);
}

void Controller::onSender(const ground_msgs::SenderStatus::ConstPtr& message) {
  const std::lock_guard lock(mutex_);
  life_.sender(now(), message->state == ground_msgs::SenderStatus::ARMED, message->reason);
}

void Controller::onState(const ground_msgs::State::ConstPtr& message) {
  const std::lock_guard lock(mutex_);
  measured_at_ = message->header.stamp;
  const std::string jump = time_watch_.look();
  if (!jump.empty()) life_.timeJumped(now(), jump);
  life_.state(now(), measuredState(*message, seconds(measured_at_)));
}

bool Controller::onStart(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  const std::lock_guard lock(mutex_);
  response.message = life_.start(now());
  response.success = response.message.empty();
  if (response.success) response.message = pilot_->caution();
  return true;
}

bool Controller::onStop(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  const std::lock_guard lock(mutex_);
  auto_start_ = false;
  life_.stop(now(), "stopped by hand");
  response.success = true;
  return true;
}

/// Advances the life cycle; returns the time to the next call [s].
double Controller::watch() {
  const std::string jump = time_watch_.look();
  if (!jump.empty()) life_.timeJumped(now(), jump);
  if (auto_start_) {
    auto_start_ = false;
    const std::string refusal = life_.start(now());
    if (!refusal.empty()) log_.warn(name_ + ": not started: " + refusal);
  }
  life_.tick(now());
  const Instant at = now();
  if (at.steady >= next_status_) publishStatus();
  const Instant due = life_.due();
  const double left = std::min(due.steady - at.steady, due.time - at.time);
  return ros::Time::isSimTime() ? std::clamp(left / kMaxPace, kSimulatedTick, kWatch)
                                : std::clamp(left, 0.0, kWatch);
}

void Controller::run() {
  if (real_time_) prioritise(RealTimePriority::kControl);
  std::unique_lock lock(mutex_);
  while (alive_) {
    const double wait = watch();
    wake_.wait_for(lock, std::chrono::duration<double>(wait));
  }
}

void Controller::publish(const Inputs& inputs) {
  const ros::Time stamp = ros::Time::now();
  if (stamp.isZero()) return;  // a simulated clock has not started, so there is no valid stamp
  auto message = boost::make_shared<ground_msgs::Controls>();
  message->header.stamp = stamp;
  if (life_.started()) message->header.frame_id = name_;
  writeInputs(inputs, life_.layout(), *message);
  controls_.publish(message);
  life_.attempt([&] {
    pilot_->commanded(seconds(stamp), inputs);
    sent();
  });
  if (!decision_) return;
  wanted_publisher_.publish(wanted_);
  decision_publisher_.publish(decision_);
  decision_.reset();
}

void Controller::note(const ReferencePilot::Decision& made) {
  wanted_ = boost::make_shared<ground_msgs::Controls>();
  wanted_->header.stamp = ros::Time::now();
  wanted_->header.frame_id = name_;
  writeInputs({made.wanted, life_.params().lift}, pilot_->layout(), *wanted_);
  decision_ = boost::make_shared<ground_msgs::Decision>();
  decision_->header = wanted_->header;
  decision_->state = measured_at_;
  decision_->computing = made.computing;
}

void Controller::changed() {
  publishStatus();
  const std::string line = name_ + ": " + nameOf(life_.current()) + ": " + life_.reason();
  if (life_.current() == ControllerLifecycle::State::kStopped ||
      life_.current() == ControllerLifecycle::State::kRecovering)
    log_.warn(line);
  else
    log_.info(line);
}

void Controller::publishStatus() {
  auto message = boost::make_shared<Status>();
  message->header.stamp = ros::Time::now();
  message->state = static_cast<std::uint8_t>(life_.current());
  message->controller = name_;
  message->reason = life_.reason();
  message->elapsed = life_.elapsed(seconds(message->header.stamp));
  status_.publish(message);
  next_status_ = steadyNow() + kStatusPeriod;
}

}  // namespace ground
