#include <ground/OpenLoopPRBSConfig.h>

#include <memory>
#include <optional>
#include <pluginlib/class_list_macros.hpp>

#include "ground/control/excitation_pilot.h"
#include "ground/nodelets/controller.h"
#include "ground/nodelets/model_loading.h"
#include "ground/nodelets/parameters.h"

namespace ground {

/// Plays a pseudo-random binary sequence on the thrusters with exact timing, and ends with zero
/// inputs.
///
/// Parameters: csv (file of rows LEFT,RIGHT; empty: generated from order and seed), rows_per_bit of
/// that file (0: determined from the file), order (9), seed (1), model (of the craft, for the fence, and to
/// refuse one with other thrusters; empty: neither), and those of OpenLoopPRBS.cfg, which take effect at the
/// next start.
class OpenLoopPRBS : public Controller {
 public:
  OpenLoopPRBS()
      : Controller(std::make_unique<ExcitationPilot>([this] { return seconds(ros::Time::now()); },
                                                     [](const ExcitationPilot::Mark&) {},
                                                     [](const ReferencePilot::Decision&) {})),
        pilot_(static_cast<ExcitationPilot&>(pilot())) {}
  ~OpenLoopPRBS() override {
    reconfigure_.reset();
    shutdown();
  }

 private:
  void load(ros::NodeHandle& nh) override {
    const auto file = optionalParameter<std::string>(nh, "model", "");
    std::optional<Model> model;
    if (!file.empty()) model = loadModelAndWarn(file);
    if (model && !model->thrusters->isPair())
      throw std::runtime_error("OpenLoopPRBS has levels for a left and a right thruster, and " + model->name +
                               " lists others (" + model->thrusters->names() +
                               "): use an excitation of design prbs");
    const auto csv = optionalParameter<std::string>(nh, "csv", "");
    const int order = optionalParameter<int>(nh, "order", 9);
    const int seed = optionalParameter<int>(nh, "seed", 1);
    if (seed < 0) throw std::runtime_error("parameter seed must not be negative");
    if (csv.empty()) {
      sequence_.rows = makePrbs(order, static_cast<unsigned long>(seed));
    } else {
      sequence_ = readPrbs(csv, optionalParameter<int>(nh, "rows_per_bit", 0));
    }
    using Config = OpenLoopPRBSConfig;
    reconfigure_ = std::make_unique<LiveParameters<Config>>(nh, [this, csv, model](const Config& c) {
      const auto params = paramsIn<PrbsParams>(c);
      auto life = paramsIn<LifecycleParams>(c);
      life.recovery_time = 0;
      if (!csv.empty()) NODELET_INFO("%s: %s", csv.c_str(), sequence_.describe(params.clock).c_str());
      InputSignal signal = playBits(sequence_, params);
      const std::lock_guard lock(mutex());
      setParams(life);
      pilot_.play(std::move(signal), params.duration, model ? &*model : nullptr);
    });
  }

  PrbsFile sequence_;
  ExcitationPilot& pilot_;
  std::unique_ptr<LiveParameters<OpenLoopPRBSConfig>> reconfigure_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::OpenLoopPRBS, nodelet::Nodelet)
