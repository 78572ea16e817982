#include <ground/ExcitationConfig.h>
#include <ground_msgs/Burst.h>
#include <ground_msgs/Drive.h>

#include <algorithm>
#include <memory>
#include <mutex>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>

#include "ground/control/excitation_pilot.h"
#include "ground/nodelets/controller.h"
#include "ground/nodelets/decision_publisher.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/model_service.h"
#include "ground/nodelets/parameters.h"
#include "ground/nodelets/time.h"

namespace ground {

/// Plays any input design or file of inputs with exact timing: in bursts between which
/// ModelPredictive drives the craft home, or in open loop.
///
/// Parameters: model (model file for the thrusters and the returns; empty: a left and a right
/// thruster) and those of Excitation.cfg, which take effect at the next start. If returns is true,
/// model and the base's room are required. Also publishes: bursts (latched; at the beginning of
/// each burst and return), and each decision of a return (DecisionPublisher). Service: ~load_model
/// (takes effect at the next start). A file with a column lift sets the lift, too.
class Excitation : public Controller {
 public:
  Excitation() : Controller(pilot_) { pilot_.setSteadyClock(steadyNow); }
  ~Excitation() override {
    reconfigure_.reset();
    model_service_ = ModelService();
    drive_subscriber_.shutdown();
    shutdown();
  }

 private:
  using Config = ExcitationConfig;

  /// Plays the current settings when it is started.
  struct Player : ExcitationPilot {
    explicit Player(Excitation& excitation)
        : ExcitationPilot([&excitation] { return excitation.seconds(ros::Time::now()); },
                          [&excitation](const Mark& mark) { excitation.marked(mark); },
                          [&excitation](const ReferencePilot::Decision& decision) {
                            excitation.decision_publisher_.note(decision, excitation.pilot_.layout(),
                                                                excitation.measuredAt(), excitation.getName(),
                                                                excitation.config_.lift);
                          }),
          owner(excitation) {}
    /// Those of the model; without one, a left and a right thruster.
    const ThrusterLayout& layout() const override { return *owner.thrusters(); }
    void activate(double stamp) override {
      owner.prepare();
      ExcitationPilot::activate(stamp);
    }
    Excitation& owner;
  };

  void load(ros::NodeHandle& nh) override {
    const auto file = optionalParameter<std::string>(nh, "model", "");
    if (!file.empty()) model_ = loadModelAndWarn(file);
    ros::NodeHandle topics = this->topics();
    burst_publisher_ = topics.advertise<ground_msgs::Burst>("bursts", 10, true);
    decision_publisher_.advertise(topics);
    reconfigure_ = std::make_unique<LiveParameters<Config>>(
        nh, [this](const Config& c) { return wrong(c); }, [this](const Config& c) { apply(c); });
    model_service_ = ModelService(nh, "load_model", [this](const Model& model, const std::string&) {
      const std::lock_guard one(changing_);
      const std::string other = otherThrusters(*thrusters(), *model.thrusters);
      if (!other.empty()) throw std::runtime_error(other);
      const std::string caution = judge(&model, config_, signal_);
      const std::lock_guard lock(mutex());
      model_ = model;
      pilot_.setCaution(caution);
      return caution;
    });
    drive_subscriber_ = topics.subscribe("drive", 4, &Excitation::onDrive, this);
  }

  void onDrive(const ground_msgs::Drive::ConstPtr& message) {
    const std::lock_guard lock(mutex());
    pilot_.driveBegan(seconds(message->began), seconds(message->header.stamp));
  }

  static std::vector<double> levels(const std::string& text) {
    std::vector<double> found;
    std::string spaced = text;
    std::replace(spaced.begin(), spaced.end(), ',', ' ');
    std::istringstream words(spaced);
    for (std::string word; words >> word;) {
      std::size_t used = 0;
      try {
        found.push_back(std::stod(word, &used));
      } catch (const std::exception&) {
      }
      if (used != word.size()) throw std::invalid_argument("levels: '" + word + "' is not a number");
    }
    return found;
  }

  ThrusterLayoutPtr thrusters() const { return model_ ? model_->thrusters : thrusterPair(); }

  InputSignal signal(const Config& c) {
    DesignParams design;
    {
      const std::lock_guard lock(mutex());
      design.thrusters = thrusters();
    }
    design.kind = c.design;
    design.file = c.file;
    design.rows_per_bit = c.rows_per_bit;
    design.levels = levels(c.levels);
    design.clock = c.clock;
    design.order = c.order;
    design.seed = static_cast<unsigned long>(c.seed);
    design.hold = c.hold;
    return makeDesign(design, c.duration);
  }

  ReturnParams returns(const Config& c) const {
    ReturnParams params;
    params.room = *room();
    params.burst = c.burst;
    params.arrival = c.arrival;
    return params;
  }

  bool hasModel() {
    const std::lock_guard lock(mutex());
    return model_.has_value();
  }

  /// Validates a change and builds its signal. LiveParameters then calls apply() if the message is
  /// empty, one change at a time.
  std::string wrong(const Config& c) {
    try {
      if (c.returns && !requiresState())
        return "returns go by the state (require_state); returns:=false plays open loop";
      if (c.returns && !room()) return "returns need a room; returns:=false plays open loop";
      if (c.returns && !hasModel()) return "returns need a model; returns:=false plays open loop";
      built_ = signal(c);
      return c.returns ? returns(c).validate() : "";
    } catch (const std::exception& error) {
      return error.what();
    }
  }

  void apply(const Config& c) {
    const std::lock_guard one(changing_);
    const std::string caution = judge(model_ ? &*model_ : nullptr, c, built_);
    LifecycleParams common;
    common.lift = c.lift;
    common.lift_time = built_.has_lift ? 0 : c.lift_time;
    common.state_timeout = c.state_timeout;
    common.recovery_time = c.recovery_time;
    common.rate = c.rate;
    if (!built_.description.empty()) NODELET_INFO("%s: %s", c.file.c_str(), built_.description.c_str());
    if (!caution.empty()) NODELET_INFO("%s: %s", getName().c_str(), caution.c_str());
    const std::lock_guard lock(mutex());
    config_ = c;
    std::swap(signal_, built_);
    setParams(common);
    pilot_.setCaution(caution);
  }

  /// Warning for the user who starts it about where the craft will go; model: null if unknown.
  std::string judge(const Model* model, const Config& c, const InputSignal& signal) const {
    if (!requiresState()) return "open loop, without the state: the craft must be fastened";
    if (!room()) return "open loop, without a room that would keep it inside";
    if (c.returns) return "bursts of " + c.design + " between returns home";
    if (!model) return "open loop; the room stops it";
    InputSequence inputs(model->thrusters->size());
    const double most = model->body.input_max;
    for (std::size_t i = 0; i < signal.times.size(); ++i) {
      const Inputs& row = signal.inputs[i];
      inputs.add(signal.times[i], most * asVector(row.thrusters), signal.has_lift ? row.lift : c.lift);
    }
    const std::string leaves = leavesRoom(*model, inputs, std::min<double>(c.duration, signal.end), *room());
    return leaves.empty() ? "open loop; by the model it stays inside"
                          : "open loop: " + leaves + ", where it is stopped";
  }

  void prepare() {
    if (config_.returns) {
      pilot_.playInside(signal_, config_.duration, *model_, returns(config_));
    } else {
      pilot_.play(signal_, config_.duration);
    }
  }

  void marked(const ExcitationPilot::Mark& mark) {
    auto message = boost::make_shared<ground_msgs::Burst>();
    message->header.stamp = ros::Time::now();
    message->number = static_cast<std::uint32_t>(mark.number);
    message->burst = mark.burst;
    message->reason = mark.reason;
    burst_publisher_.publish(message);
    if (config_.returns)
      log().info(getName() + (mark.burst ? ": burst " : ": return after burst ") +
                 std::to_string(mark.number) + ": " + mark.reason);
  }

  void sent() override { decision_publisher_.publish(); }

  InputSignal built_;  ///< built by wrong() for apply()
  /// Held while something is judged and swapped in. Its holder may read model_, config_ and signal_
  /// without mutex(). Changes need both.
  std::mutex changing_;
  std::optional<Model> model_;  ///< guarded by mutex(), like all members below
  InputSignal signal_;
  Config config_;
  Player pilot_{*this};
  ros::Publisher burst_publisher_;
  DecisionPublisher decision_publisher_;
  ros::Subscriber drive_subscriber_;
  ModelService model_service_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::Excitation, nodelet::Nodelet)
