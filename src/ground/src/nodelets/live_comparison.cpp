#include <ground/LiveComparisonConfig.h>
#include <ground_msgs/Controls.h>
#include <ground_msgs/Drive.h>
#include <ground_msgs/ModelComparison.h>
#include <ground_msgs/ModelError.h>
#include <ground_msgs/State.h>
#include <ground_msgs/Telemetry.h>
#include <nav_msgs/Path.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <string>
#include <utility>
#include <vector>

#include "ground/estimation/model_monitor.h"
#include "ground/nodelets/controls.h"
#include "ground/nodelets/messages.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/model_service.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/shell.h"
#include "ground/nodelets/time.h"

namespace ground {

/// Compares one or two models with the measurements of a running experiment or of a bag.
///
/// Parameters: model (model file, required), model2 (another, optional) and those of
/// LiveComparison.cfg, which can be changed at run time. Subscribes: state, controls, drive, sender/telemetry
/// (the voltage of the battery, on which the thrust of a model may depend). Publishes with every state:
/// model_error, model_error2 (how far the prediction is off, and since when it has failed). Publishes at
/// `rate`: path/predicted, path/predicted2 (prediction of each model over the last horizon),
/// model_comparison. Logs when a model stops predicting. Services: ~load_model, ~load_model2 (load another
/// model file).
class LiveComparison : public Shell {
 private:
  using Config = LiveComparisonConfig;

  /// A model and its publishers.
  struct Contestant {
    std::string name, file;
    std::unique_ptr<ModelMonitor> monitor;
    std::string failure;  ///< the newest in the log
    ros::Publisher error, path;
  };

  void start(ros::NodeHandle& nh, ros::NodeHandle& topics) override {
    const std::array<std::string, kModels> files = {requiredParameter<std::string>(nh, "model"),
                                                    optionalParameter<std::string>(nh, "model2", "")};
    reconfigure_ = std::make_unique<LiveParameters<Config>>(nh, [this](const Config& c) { apply(c); });
    for (std::size_t i = 0; i < kModels; ++i) {
      const std::string suffix = i == 0 ? "" : "2";
      Contestant& c = contestants_[i];
      if (!files[i].empty()) take(c, loadModelAndWarn(files[i]), files[i]);
      c.error = topics.advertise<ground_msgs::ModelError>("model_error" + suffix, 10);
      c.path = topics.advertise<nav_msgs::Path>("path/predicted" + suffix, 1);
      services_[i] = ModelService(reconfigure_->thread(), nh, "load_model" + suffix,
                                  [this, &c](const Model& model, const std::string& file) {
                                    const std::lock_guard<std::mutex> lock(mutex_);
                                    take(c, model, file);
                                    return std::string();
                                  });
    }
    comparison_publisher_ = topics.advertise<ground_msgs::ModelComparison>("model_comparison", 1);
    controls_subscriber_ = topics.subscribe("controls", 50, &LiveComparison::onControls, this,
                                            ros::TransportHints().tcpNoDelay());
    sent_subscriber_ =
        topics.subscribe("sent", 50, &LiveComparison::onSent, this, ros::TransportHints().tcpNoDelay());
    drive_subscriber_ = topics.subscribe("drive", 4, &LiveComparison::onDrive, this);
    telemetry_subscriber_ = topics.subscribe("sender/telemetry", 4, &LiveComparison::onTelemetry, this);
    state_subscriber_ =
        topics.subscribe("state", 50, &LiveComparison::onState, this, ros::TransportHints().tcpNoDelay());
  }

  static MonitorParams params(const Config& c) {
    MonitorParams p;
    p.horizon = c.horizon;
    p.window = c.window;
    p.observer = paramsIn<ObserverParams>(c);
    return p;
  }

  void apply(const Config& c) {
    const std::string wrong = params(c).validate();
    if (!wrong.empty()) throw std::invalid_argument(wrong);
    const std::lock_guard<std::mutex> lock(mutex_);
    config_ = c;
    contest_ = ModelContest(c.horizon, c.window);
    for (Contestant& one : contestants_)
      if (one.monitor) one.monitor->setParams(params(c));
  }

  void take(Contestant& contestant, const Model& model, const std::string& file) {
    contestant.monitor = std::make_unique<ModelMonitor>(model, params(config_));
    contestant.monitor->setDrive(drive_);
    contestant.file = file;
    contestant.failure.clear();
    const std::filesystem::path path(file);
    contestant.name = path.stem().string();
    for (const Contestant& other : contestants_)
      if (&other != &contestant && other.monitor && other.name == contestant.name)
        contestant.name = (path.parent_path().filename() / path.stem()).string();
    contest_ = ModelContest(config_.horizon, config_.window);
  }

  /// Time since the first message [s]. Restarts if time jumps back, as with a bag that begins
  /// again.
  double seconds(const ros::Time& stamp) {
    if (epoch_.isZero() || secondsBetween(newest_, stamp) < -kJump) {
      if (!epoch_.isZero()) recorded_.reset();  // a record from before the jump
      epoch_ = newest_ = stamp;
      last_paths_ = 0;
      drive_ = DriveClock();
      for (Contestant& c : contestants_)
        if (c.monitor) c.monitor->reset();
      hears_sent_ = false;
      first_command_.reset();
      first_state_.reset();
      followRecord();
    }
    newest_ = std::max(newest_, stamp);
    return secondsBetween(epoch_, stamp);
  }

  /// Sets the models' t by the newest recorded start of a drive, which may be before epoch_.
  void followRecord() {
    if (recorded_)
      drive_.record(secondsBetween(epoch_, recorded_->began),
                    secondsBetween(epoch_, recorded_->header.stamp));
    for (Contestant& c : contestants_)
      if (c.monitor) c.monitor->setDrive(drive_);
  }

  void onDrive(const ground_msgs::Drive::ConstPtr& message) {
    const std::lock_guard<std::mutex> lock(mutex_);
    recorded_ = message;
    if (!epoch_.isZero()) followRecord();
  }

  /// What was commanded, until it is known what has left for the craft: recordings are read likewise.
  void onControls(const ground_msgs::Controls::ConstPtr& controls) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!hears_sent_) take(controls);
  }

  void onSent(const ground_msgs::Controls::ConstPtr& sent) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!std::exchange(hears_sent_, true)) first_command_.reset();
    take(sent);
  }

  void take(const ground_msgs::Controls::ConstPtr& controls) {
    const Inputs inputs = readInputs(*controls);
    if (!inputs.finite()) return;
    const double time = seconds(controls->header.stamp);
    first_command_ = first_command_.value_or(time);
    drive_.command(time, controls->lift);
    for (Contestant& c : contestants_) {
      if (!c.monitor) continue;
      const Model& model = c.monitor->model();
      const std::string other = misfit(*controls, *model.thrusters);
      if (!other.empty()) {
        NODELET_WARN_THROTTLE(5, "live_comparison: %s: a command %s", c.name.c_str(), other.c_str());
        continue;
      }
      Thrusters<double> thrusters = model.thrusters->clipped(inputs.thrusters);
      thrusters *= model.body.input_max;
      c.monitor->command(time, thrusters, inputs.lift);
    }
  }

  void onTelemetry(const ground_msgs::Telemetry::ConstPtr& message) {
    const std::optional<double> volts = voltageIn(*message);
    if (!volts) return;
    const std::lock_guard<std::mutex> lock(mutex_);
    for (Contestant& c : contestants_)
      if (c.monitor) c.monitor->voltage(seconds(message->header.stamp), *volts);
  }

  void onState(const ground_msgs::State::ConstPtr& message) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const RigidState<double> state = stateIn(*message);
    if (!message->valid || !isFinite(state)) return;
    const double time = seconds(message->header.stamp);
    first_state_ = first_state_.value_or(time);
    std::array<std::optional<ModelMonitor::Error>, kModels> errors;
    for (std::size_t i = 0; i < kModels; ++i) {
      Contestant& c = contestants_[i];
      if (!c.monitor) continue;
      errors[i] = c.monitor->measure(time, state, poseIn(*message));
      if (errors[i]) publishError(c, message->header, *errors[i]);
    }
    const bool is_tried = errors[0] && errors[1] && errors[0]->excited && errors[1]->excited;
    if (is_tried) contest_.add(time, *errors[0], *errors[1]);
    if (time - last_paths_ < 1 / config_.rate) return;
    last_paths_ = time;
    for (Contestant& c : contestants_)
      if (c.monitor) publishPath(c, message->header.stamp);
    if (errors[0] && errors[1]) publishComparison(message->header);
  }

  void publishError(Contestant& c, const std_msgs::Header& header, const ModelMonitor::Error& e) {
    auto message = boost::make_shared<ground_msgs::ModelError>();
    message->header = header;
    message->model = c.name;
    message->horizon = e.horizon;
    message->window = e.covered;
    message->position_error = e.rms.position;
    message->heading_error = e.rms.heading;
    message->position_noise = e.noise.position;
    message->heading_noise = e.noise.heading;
    message->excited = e.excited;
    for (int i = 0; i < 3; ++i) {
      message->eta[i] = e.predicted.eta(i);
      message->nu[i] = e.predicted.nu(i);
      message->eta_error[i] = e.eta(i);
      message->wrench[i] = e.wrench(i);
      message->wrench_noise[i] = e.wrench_noise(i);
    }
    addFailure(c, e.failing_since, *message);
    c.error.publish(message);
  }

  /// Adds since when a model has failed, on the clock of a recording that began with this node; logs it.
  void addFailure(Contestant& c, const Vector3<double>& failing_since, ground_msgs::ModelError& message) {
    const double zero = std::max(first_state_.value_or(0), first_command_.value_or(0));
    const Vector3<double> since = failing_since.array() - zero;
    std::copy(since.begin(), since.end(), message.failing_since.begin());
    const std::string failing = failureText(since);
    if (!failing.empty()) {
      const double from = std::floor(since.array().isFinite().select(since, kMax).minCoeff());
      message.failure = "has not predicted " + failing;
      message.next = "rosrun ground identify diagnose BAG --model " + c.file + " --from " +
                     std::to_string(std::max(0L, std::lround(from))) + " -o diagnosis";
    }
    if (message.failure == std::exchange(c.failure, message.failure)) return;
    if (failing.empty()) {
      NODELET_INFO("live_comparison: %s predicts as before its failure", c.name.c_str());
    } else {
      NODELET_WARN("live_comparison: %s %s; to find what is missing: %s", c.name.c_str(),
                   message.failure.c_str(), message.next.c_str());
    }
  }

  static void publishPath(Contestant& c, const ros::Time& stamp) {
    auto path = inWorld<nav_msgs::Path>(stamp);
    for (const Vector3<double>& eta : c.monitor->path(kPathStep))
      addPose(*path, stamp, poseOf(eta.x(), eta.y(), -0.01, eta.z()));  // above the floor
    if (!path->poses.empty()) c.path.publish(path);
  }

  void publishComparison(const std_msgs::Header& header) {
    auto message = boost::make_shared<ground_msgs::ModelComparison>();
    message->header = header;
    for (std::size_t i = 0; i < kModels; ++i) message->models[i] = contestants_[i].name;
    if (const auto found = contest_.preference()) {
      message->difference = found->difference;
      message->standard_error = found->standard_error;
      if (found->clear()) message->better = message->models[found->difference < 0 ? 0 : 1];
    }
    comparison_publisher_.publish(message);
  }

  static constexpr std::size_t kModels = 2;
  static constexpr double kPathStep = 0.02;  // [s]
  static constexpr double kMax = std::numeric_limits<double>::max();
  static constexpr double kJump = 0.5;  // smallest jump back, larger than any disorder [s]

  std::mutex mutex_;  ///< guards what follows
  Config config_;
  std::array<Contestant, kModels> contestants_;
  ModelContest contest_{1.0, 10.0};
  ros::Time epoch_;                                    ///< zero of the monitors' clock
  ros::Time newest_;                                   ///< newest stamp
  DriveClock drive_;                                   ///< starts of drives, on the monitors' clock
  ground_msgs::Drive::ConstPtr recorded_;              ///< newest start of a drive, recorded by the sender
  std::optional<double> first_command_, first_state_;  ///< on the monitors' clock [s]
  double last_paths_ = 0;
  ros::Publisher comparison_publisher_;
  bool hears_sent_ = false;
  ros::Subscriber state_subscriber_, controls_subscriber_, sent_subscriber_, drive_subscriber_,
      telemetry_subscriber_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
  std::array<ModelService, kModels> services_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::LiveComparison, nodelet::Nodelet)
