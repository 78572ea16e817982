#include "ground/nodelets/controller.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "ground/estimation/jump.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/time.h"

namespace ground {
namespace {

constexpr double kKeepalive = 0.02;      // between repeated commands [s]
constexpr double kHandover = 0.2;        // after which a silent controller has gone [s]
constexpr double kStatusPeriod = 0.5;    // [s]
constexpr double kWatch = 0.005;         // between looks at the watchdog [s]
constexpr double kSimulatedTick = 5e-4;  // between looks at a simulated clock [s]

RigidState<double> rigidState(const ground_msgs::State& message) {
  RigidState<double> state;
  std::copy(message.eta.begin(), message.eta.end(), state.eta.data());
  std::copy(message.nu.begin(), message.nu.end(), state.nu.data());
  return state;
}

const char* nameOf(std::uint8_t state) {
  static const char* names[] = {"IDLE", "WAITING", "LIFTING", "RUNNING", "DONE", "STOPPED"};
  return names[state];
}

}  // namespace

Controller::~Controller() { shutdown(); }

void Controller::shutdown() {
  if (!alive_.exchange(false)) return;
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
  state_subscriber_.shutdown();
  sender_subscriber_.shutdown();
  controls_subscriber_.shutdown();
  start_service_.shutdown();
  stop_service_.shutdown();
  const std::lock_guard<std::recursive_mutex> lock(mutex_);
  if (controls_) publish(0, 0, 0);
}

void Controller::onInit() {
  name_ = getName();
  try {
    const std::lock_guard<std::recursive_mutex> lock(mutex_);
    ros::NodeHandle nh = callbacks_.handle(getPrivateNodeHandle());
    ros::NodeHandle services = service_callbacks_.handle(getPrivateNodeHandle());
    ros::NodeHandle topics = this->topics();
    auto_start_ = optionalParameter<bool>(nh, "auto_start", false);
    require_armed_ = optionalParameter<bool>(nh, "require_armed", true);
    controls_ = topics.advertise<ground_msgs::Controls>("controls", 4);
    status_ = nh.advertise<Status>("status", 1, true);
    load(nh);
    publishStatus();
    thread_ = std::thread([this] { run(); });
    start_service_ = services.advertiseService("start", &Controller::onStart, this);
    stop_service_ = services.advertiseService("stop", &Controller::onStop, this);
    const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
    sender_subscriber_ = topics.subscribe("sender/status", 4, &Controller::onSender, this, hints);
    controls_subscriber_ = topics.subscribe("controls", 4, &Controller::onControls, this, hints);
    state_subscriber_ = topics.subscribe("state", 1, &Controller::onState, this, hints);
  } catch (const std::exception& error) {
    NODELET_FATAL("%s: %s", name_.c_str(), error.what());
    throw;
  }
}

void Controller::setParams(const ControllerParams& params) {
  const std::lock_guard<std::recursive_mutex> lock(mutex_);
  params_ = params;
}

bool Controller::started() const {
  return state_ == Status::WAITING || state_ == Status::LIFTING || running();
}

void Controller::onControls(const ground_msgs::Controls::ConstPtr& message) {
  const std::string& driver = message->header.frame_id;
  const std::lock_guard<std::recursive_mutex> lock(mutex_);
  if (driver.empty() || driver == name_) return;
  for (double input : {message->left, message->right, message->lift})
    if (!std::isfinite(input)) return;
  const double now = steadyNow();
  published(message->header.stamp, message->left, message->right, message->lift);
  if (!started()) {
    others_until_ = now + kHandover;
    lifted_ = message->lift > 0;
  } else if (now - started_at_ > kHandover) {  // until then it is the one that was replaced
    others_until_ = now + kHandover;
    change(Status::STOPPED, driver + " has taken over");
  }
}

void Controller::onSender(const ground_msgs::SenderStatus::ConstPtr& message) {
  const std::lock_guard<std::recursive_mutex> lock(mutex_);
  armed_ = message->state == ground_msgs::SenderStatus::ARMED;
  if (require_armed_ && !armed_ && (state_ == Status::LIFTING || running()))
    enter(Status::STOPPED, "the sender is not armed: " + message->reason);
}

void Controller::onState(const ground_msgs::State::ConstPtr& message) {
  const std::lock_guard<std::recursive_mutex> lock(mutex_);
  measured_ = message;
  measured_at_ = steadyNow();
  if (running() && message->valid && stateIsFinite()) {
    const std::string jump = jumped(*message);
    known_ = message;
    if (!jump.empty()) enter(Status::STOPPED, jump);
  }
  watch();
  if (!running() || lost_since_ != 0 || nextChange(0) != kByState) return;
  const double since = secondsBetween(last_update_, message->header.stamp);
  // A tenth of tolerance, so that jitter does not skip every other state.
  if (last_update_.isZero() || since >= 0.9 / params_.rate) control(message->header.stamp);
}

bool Controller::onStart(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  const std::lock_guard<std::recursive_mutex> lock(mutex_);
  response.message = start();
  response.success = response.message.empty();
  if (response.success) response.message = caution();
  return true;
}

bool Controller::onStop(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  const std::lock_guard<std::recursive_mutex> lock(mutex_);
  auto_start_ = false;
  enter(Status::STOPPED, "stopped by hand");
  response.success = true;
  return true;
}

std::string Controller::start() {
  if (started()) return "it has been started already";
  started_at_ = steadyNow();
  lifted_ = lifted_ && others_until_ > started_at_;
  enter(Status::WAITING, "waits for a valid state and an armed sender");
  return "";
}

std::string Controller::stateProblem() const {
  if (!measured_) return "there is no state";
  if (!measured_->valid) return "the state is invalid: " + measured_->status;
  if (steadyNow() - measured_at_ > params_.state_timeout) return "the state is stale";
  // A state may also come on time and be old.
  const double age = secondsBetween(measured_->header.stamp, ros::Time::now());
  if (age > params_.state_timeout) return "the state is stale";
  if (!stateIsFinite()) return "the state is not finite";
  return "";
}

bool Controller::stateIsFinite() const {
  for (int i = 0; i < 3; ++i)
    if (!std::isfinite(measured_->eta[i]) || !std::isfinite(measured_->nu[i])) return false;
  return true;
}

/// What is said of a state that the craft cannot have come to from the last one with which it was
/// driven: it has been carried away, or the mocap sees something else; empty otherwise.
std::string Controller::jumped(const ground_msgs::State& state) const {
  if (!known_) return "";
  const double dt = std::max(0.0, secondsBetween(known_->header.stamp, state.header.stamp));
  const Jump jump(rigidState(*known_), rigidState(state), dt);
  if (!jump.impossible()) return "";
  char text[120];
  std::snprintf(text, sizeof text, "the state has jumped by %.2f m and %.2f rad in %.2f s",
                jump.way, jump.turn, jump.dt);
  return text;
}

/// Takes the thrust away while the state is lost; whether it may still come back.
bool Controller::bridge(double now, const std::string& problem) {
  if (problem.empty()) {
    if (lost_since_ == 0) return true;
    lost_since_ = 0;
    reason_ = "driving again";
    publishStatus();
    return true;
  }
  if (!stateIsFinite() || params_.recovery_time == 0) return false;
  if (lost_since_ == 0) {
    lost_since_ = now;
    reason_ = "no thrust until the state is back: " + problem;
    ROS_WARN("%s: %s", name_.c_str(), reason_.c_str());
    publish(0, 0, params_.lift);
    publishStatus();
  }
  return now - lost_since_ < params_.recovery_time;
}

/// Moves the life cycle on; returns how long it may be left alone [s].
double Controller::watch() {
  const double now = steadyNow();
  const std::string jump = time_watch_.look();
  if (!jump.empty() && (state_ == Status::LIFTING || running())) enter(Status::STOPPED, jump);
  if (auto_start_ && state_ == Status::IDLE) {
    auto_start_ = false;
    start();
  }
  const std::string problem = stateProblem();
  const bool ready = problem.empty() && (armed_ || !require_armed_);
  const ros::Time time = ros::Time::now();
  if (state_ == Status::WAITING && ready) {
    lifting_since_ = time;
    enter(Status::LIFTING, "lift on");
  }
  const bool bridged = running() && bridge(now, problem);
  if ((state_ == Status::LIFTING || running()) && !problem.empty() && !bridged)
    enter(Status::STOPPED, problem);
  const double lift_time = lifted_ ? 0 : params_.lift_time;
  if (state_ == Status::LIFTING && secondsBetween(lifting_since_, time) >= lift_time) begin(time);

  double wait = kWatch;
  if (running()) {
    const double elapsed = secondsBetween(running_since_, time);
    if (finished(elapsed)) {
      enter(Status::DONE, "came to its end");
    } else if (nextChange(0) != kByState && lost_since_ == 0) {
      const double last = secondsBetween(running_since_, last_update_);
      const double due = last_update_.isZero() ? 0.0 : nextChange(last);
      if (elapsed >= due || now >= next_keepalive_) control(time);
      const double left = nextChange(elapsed) - elapsed;
      wait = std::clamp(left, 0.0, ros::Time::isSimTime() ? kSimulatedTick : wait);
    }
  }
  // Without a new state a closed-loop controller decides upon the last one, until that is stale.
  if (running() && lost_since_ == 0 && nextChange(0) == kByState && !last_update_.isZero() &&
      now >= next_keepalive_ + 1 / params_.rate)
    control(last_update_);
  if (running() && lost_since_ != 0) {
    if (now >= next_keepalive_) publish(0, 0, params_.lift);
  } else if (!running() && now >= next_keepalive_) {
    publish(0, 0, liftAlone());
  }
  if (now >= next_status_) publishStatus();
  return wait;
}

void Controller::run() {
  std::unique_lock<std::recursive_mutex> lock(mutex_);
  while (alive_) {
    const double wait = watch();
    wake_.wait_for(lock, std::chrono::duration<double>(wait));
  }
}

void Controller::begin(const ros::Time& stamp) {
  running_since_ = stamp;
  last_update_ = ros::Time();
  known_ = measured_;
  try {
    activate(stamp);
  } catch (const std::exception& error) {
    enter(Status::STOPPED, error.what());
    return;
  }
  lost_since_ = 0;
  const std::string remark = caution();
  enter(Status::RUNNING, remark.empty() ? "driving" : "driving; " + remark);
}

void Controller::control(const ros::Time& stamp) {
  // The state may be older than the start by the mocap's latency.
  const double elapsed = std::max(0.0, secondsBetween(running_since_, stamp));
  const RigidState<double> state = rigidState(*measured_);
  const std::string reason = objection(stamp, state);
  if (!reason.empty()) {
    enter(Status::STOPPED, reason);
    return;
  }
  const Vector2<double> inputs = update(elapsed, stamp, state);
  last_update_ = stamp;
  if (!inputs.allFinite()) {
    enter(Status::STOPPED, "the command is not finite");
    return;
  }
  publish(inputs.x(), inputs.y(), params_.lift);
}

void Controller::enter(std::uint8_t state, const std::string& reason) {
  change(state, reason);
  if (state != Status::RUNNING) publish(0, 0, liftAlone());
}

/// The lift's input while the thrusters are off; one that takes over leaves it on.
double Controller::liftAlone() const {
  const bool on = state_ == Status::LIFTING || (state_ == Status::WAITING && lifted_);
  return on ? params_.lift : 0.0;
}

/// Without a word to the craft.
void Controller::change(std::uint8_t state, const std::string& reason) {
  const bool was_running = running();
  state_ = state;
  reason_ = reason;
  if (was_running) deactivate();
  publishStatus();
  if (state == Status::STOPPED) {
    ROS_WARN("%s: %s: %s", name_.c_str(), nameOf(state), reason.c_str());
  } else {
    ROS_INFO("%s: %s: %s", name_.c_str(), nameOf(state), reason.c_str());
  }
}

void Controller::publish(double left, double right, double lift) {
  const ros::Time now = ros::Time::now();
  if (!started() && steadyNow() < others_until_) return;
  if (now.isZero()) return;  // a simulated clock has not started: there is no stamp to give
  auto message = boost::make_shared<ground_msgs::Controls>();
  message->header.stamp = now;
  if (started()) message->header.frame_id = name_;
  message->left = left;
  message->right = right;
  message->lift = lift;
  controls_.publish(message);
  published(now, left, right, lift);
  next_keepalive_ = steadyNow() + kKeepalive;
}

void Controller::publishStatus() {
  auto message = boost::make_shared<Status>();
  message->header.stamp = ros::Time::now();
  message->state = state_;
  message->controller = name_;
  message->reason = reason_;
  if (running()) message->elapsed = secondsBetween(running_since_, message->header.stamp);
  status_.publish(message);
  next_status_ = steadyNow() + kStatusPeriod;
}

}  // namespace ground
