#include <ground/ExcitationConfig.h>
#include <ground_msgs/Burst.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>

#include "ground/control/excitation_pilot.h"
#include "ground/nodelets/controller.h"
#include "ground/nodelets/controls.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/model_service.h"
#include "ground/nodelets/parameters.h"

namespace ground {

/// Plays any input design or file of inputs with exact timing: in bursts between which
/// ModelPredictive drives the craft home, or in open loop.
///
/// Parameters: model (model file for the thrusters and the returns; empty: a left and a right
/// thruster) and those of Excitation.cfg, which take effect at the next start. If returns is true,
/// model and the base's room are required. Also publishes: bursts (latched; at the beginning of
/// each burst and return). Service: ~load_model
/// (takes effect at the next start). A file with a column lift sets the lift, too.
class Excitation : public Controller {
 public:
  Excitation()
      : Controller(std::make_unique<ExcitationPilot>(
            [this] { return seconds(ros::Time::now()); },
            [this](const ExcitationPilot::Mark& mark) { marked(mark); },
            [this](const ReferencePilot::Decision& decision) { note(decision); }, steadyNow)),
        pilot_(static_cast<ExcitationPilot&>(pilot())) {}
  ~Excitation() override {
    model_service_ = ModelService();
    reconfigure_.reset();
    shutdown();
  }

 private:
  using Config = ExcitationConfig;

  void load(ros::NodeHandle& nh) override {
    const auto file = optionalParameter<std::string>(nh, "model", "");
    if (!file.empty()) model_ = loadModelAndWarn(file);
    burst_publisher_ = topics().advertise<ground_msgs::Burst>("bursts", 10, true);
    reconfigure_ = std::make_unique<LiveParameters<Config>>(nh, [this](const Config& c) { apply(c); });
    model_service_ = ModelService(reconfigure_->thread(), nh, "load_model",
                                  [this](const Model& model, const std::string&) {
                                    requireSameThrusters(*thrusters(), *model.thrusters);
                                    model_ = model;
                                    prepare();
                                    return pilot_.caution();
                                  });
  }

  static std::vector<double> levels(const std::string& text) {
    std::vector<double> found;
    std::string spaced = text;
    std::replace(spaced.begin(), spaced.end(), ',', ' ');
    std::istringstream numbers(spaced);
    for (double level; numbers >> level;) found.push_back(level);
    if (!numbers.eof()) throw std::invalid_argument("levels: '" + text + "' is not a list of numbers");
    return found;
  }

  ThrusterLayoutPtr thrusters() const { return model_ ? model_->thrusters : thrusterPair(); }

  InputSignal signal(const Config& c) const {
    DesignParams design;
    design.thrusters = thrusters();
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

  /// Throws if the values do not fit together.
  void apply(const Config& c) {
    const char* const missing = !requiresState() ? "go by the state (require_state)"
                                : !room()        ? "need a room"
                                : !model_        ? "need a model"
                                                 : nullptr;
    if (c.returns && missing)
      throw std::invalid_argument(std::string("returns ") + missing + "; returns:=false plays open loop");
    signal_ = signal(c);
    config_ = c;
    if (!signal_.description.empty()) NODELET_INFO("%s: %s", c.file.c_str(), signal_.description.c_str());
    prepare();
    NODELET_INFO("%s: %s", getName().c_str(), pilot_.caution().c_str());
  }

  /// Gives signal, model and settings to the pilot.
  void prepare() {
    auto life = paramsIn<LifecycleParams>(config_);
    if (signal_.has_lift) life.lift_time = 0;
    const std::lock_guard lock(mutex());
    setParams(life);
    pilot_.setCaution(remark());
    if (!config_.returns) return pilot_.play(signal_, config_.duration, model_ ? &*model_ : nullptr);
    ReturnParams returns;
    returns.room = *room();
    returns.burst = config_.burst;
    pilot_.playInside(signal_, config_.duration, *model_, returns);
  }

  /// Remark for the user who starts it about where the craft will go.
  std::string remark() const {
    if (!requiresState()) return "open loop, without the state: the craft must be clamped";
    if (!room()) return "open loop, without a room that would keep it inside";
    return config_.returns ? "bursts of " + config_.design + " between returns home"
                           : "open loop; the room stops it";
  }

  void marked(const ExcitationPilot::Mark& mark) {
    auto message = boost::make_shared<ground_msgs::Burst>();
    message->header.stamp = ros::Time::now();
    message->number = static_cast<std::uint32_t>(mark.number);
    message->burst = mark.burst;
    message->reason = mark.reason;
    burst_publisher_.publish(message);
    log().info(getName() + (mark.burst ? ": burst " : ": return after burst ") + std::to_string(mark.number) +
               ": " + mark.reason);
  }

  // Used only in the thread of reconfigure_.
  std::optional<Model> model_;
  InputSignal signal_;
  Config config_;
  ExcitationPilot& pilot_;
  ros::Publisher burst_publisher_;
  std::unique_ptr<LiveParameters<Config>> reconfigure_;
  ModelService model_service_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::Excitation, nodelet::Nodelet)
