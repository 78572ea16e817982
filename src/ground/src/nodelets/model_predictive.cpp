#include <ground/ModelPredictiveConfig.h>
#include <ground_msgs/CraftChange.h>

#include <filesystem>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <string>
#include <utility>

#include "ground/model/craft_change.h"
#include "ground/nodelets/reference_tracking.h"

namespace ground {

/// Tracks a reference by nonlinear model predictive control with the whole model, effects included.
/// Parameters: those of ReferenceTracking, horizon, weights and the observer's noise; adapt (false): takes
/// the changes of the craft that live_comparison names into its model, within bounds (CraftChange), and
/// drives home and stops there when a thruster of more than two is dead. A new drive begins with the model of
/// the file. Subscribes: craft_change.
class ModelPredictive : public ReferenceTracking<ModelPredictiveConfig> {
 public:
  ModelPredictive() : ReferenceTracking("ModelPredictive") {}
  ~ModelPredictive() override {
    subscriber_ = ros::Subscriber();  // before the thread of its callbacks
    shutdown();
  }

 private:
  void loaded(const Model& model, const std::string& file) override {
    craft_ = std::make_unique<CraftChange>(model);
    file_model_ = model;
    name_ = std::filesystem::path(file).stem().string();
    taken_ = Eigen::VectorXd::Zero(craft_->size());
    if (!subscriber_)
      subscriber_ =
          changes().handle(topics()).subscribe("craft_change", 10, &ModelPredictive::onChange, this);
  }

  void onChange(const ground_msgs::CraftChange::ConstPtr& message) {
    Eigen::VectorXd change = Eigen::VectorXd::Zero(craft_->size());
    if (config().adapt) {
      if (message->model != name_ || static_cast<int>(message->change.size()) != craft_->size()) {
        NODELET_WARN_THROTTLE(5, "%s: changes relative to %s are not taken: its own model is %s",
                              getName().c_str(), message->model.c_str(), name_.c_str());
      } else {
        change = craft_->bounded(Eigen::Map<const Eigen::VectorXd>(message->change.data(), craft_->size()));
      }
    }
    if (!craft_->differ(taken_, change)) return;
    taken_ = change;
    try {
      const bool is_changed = !change.isZero();
      replaceModel(is_changed ? craft_->apply(change) : file_model_);
      NODELET_INFO("%s: %s", getName().c_str(),
                   is_changed ? ("takes into its model: " + message->text).c_str()
                              : "goes back to the model of its file");
      const std::string dead = craft_->deadNames(change);
      if (dead != std::exchange(dead_, dead) && !dead.empty() && goHome(dead + " is dead"))
        NODELET_WARN("%s: drives home, because %s is dead", getName().c_str(), dead.c_str());
    } catch (const std::exception& error) {
      NODELET_WARN("%s: keeps its model: %s", getName().c_str(), error.what());
    }
  }

  // All in the thread of changes()
  std::unique_ptr<CraftChange> craft_;
  Model file_model_;
  std::string name_;       ///< of the model file
  Eigen::VectorXd taken_;  ///< change in the controller's model
  std::string dead_;       ///< names of the thrusters that are dead by it
  ros::Subscriber subscriber_;
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::ModelPredictive, nodelet::Nodelet)
