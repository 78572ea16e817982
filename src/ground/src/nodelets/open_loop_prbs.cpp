#include <ground/OpenLoopPRBSConfig.h>

#include <memory>
#include <pluginlib/class_list_macros.hpp>

#include "ground/control/input_design.h"
#include "ground/nodelets/controller.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/parameters.h"

namespace ground {

/// Plays a pseudo-random binary sequence on the thrusters with exact timing, and ends with zero
/// inputs.
///
/// Parameters: csv (file of rows LEFT,RIGHT; empty: generated from order and seed), rows_per_bit of
/// that file (0: determined from the file), order (9), seed (1), model (of the craft, to refuse one
/// with other thrusters; empty: no check), and those of OpenLoopPRBS.cfg, which take effect at the
/// next start.
class OpenLoopPRBS : private Pilot, public Controller {
 public:
  OpenLoopPRBS() : Controller(static_cast<Pilot&>(*this)) {}
  ~OpenLoopPRBS() override { shutdown(); }

 private:
  void load(ros::NodeHandle& nh) override {
    const auto file = optionalParameter<std::string>(nh, "model", "");
    const Model model = file.empty() ? Model() : loadModelAndWarn(file);
    if (!model.thrusters->isPair())
      throw std::runtime_error("OpenLoopPRBS has levels for a left and a right thruster, and " + model.name +
                               " lists others (" + model.thrusters->names() +
                               "): use an excitation of design prbs");
    csv_ = optionalParameter<std::string>(nh, "csv", "");
    const int order = optionalParameter<int>(nh, "order", 9);
    const int seed = optionalParameter<int>(nh, "seed", 1);
    if (seed < 0) throw std::runtime_error("parameter seed must not be negative");
    if (csv_.empty()) {
      sequence_.rows = makePrbs(order, static_cast<unsigned long>(seed));
    } else {
      sequence_ = readPrbs(csv_, optionalParameter<int>(nh, "rows_per_bit", 0));
    }
    using Config = OpenLoopPRBSConfig;
    reconfigure_ = std::make_unique<LiveParameters<Config>>(nh, [this](const Config& c) {
      const std::lock_guard lock(mutex());
      params_ = paramsIn<PrbsParams>(c);
      auto life = paramsIn<LifecycleParams>(c);
      life.recovery_time = 0;
      setParams(life);
    });
  }

  void activate(double) override {
    signal_ = playBits(sequence_, params_);
    if (!csv_.empty()) log().info(csv_ + ": " + sequence_.describe(params_.clock));
  }
  Inputs update(double elapsed, double, const RigidState<double>&, double lift) override {
    return {signal_.at(elapsed).thrusters, lift};
  }
  double end() const override { return signal_.end; }
  double nextChange(double elapsed) const override { return signal_.nextChange(elapsed); }

  std::string csv_;  ///< empty if the sequence is generated
  PrbsFile sequence_;
  PrbsParams params_;
  InputSignal signal_;
  std::unique_ptr<LiveParameters<OpenLoopPRBSConfig>> reconfigure_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::OpenLoopPRBS, nodelet::Nodelet)
