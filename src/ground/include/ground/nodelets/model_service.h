#pragma once

#include <ground_msgs/LoadModel.h>
#include <ros/ros.h>

#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "ground/nodelets/callback_thread.h"
#include "ground/nodelets/live_changes.h"
#include "ground/nodelets/model_loading.h"

namespace ground {

/// Service by which a nodelet loads another model file while it runs. The change is logged and published
/// (LiveChanges).
class ModelService {
 public:
  /// Replaces the model and returns a remark for the caller, which may be empty. An exception
  /// refuses the model, and the nodelet keeps the old one.
  using Take = std::function<std::string(const Model&, const std::string& file)>;

  ModelService() = default;
  /// The thread reads files, so that a slow disk does not block the nodelet, and outlives the service.
  ModelService(CallbackThread& thread, const ros::NodeHandle& nh, const std::string& name, Take take) {
    using Load = ground_msgs::LoadModel;
    const std::string full = nh.resolveName(name);
    // load_model replaces the value of parameter model, load_model2 the value of model2.
    const std::string parameter = name.substr(std::strlen("load_"));
    const auto file = std::make_shared<std::string>(nh.param<std::string>(parameter, ""));
    const auto serve = [full, parameter, file, changes = LiveChanges(nh), take = std::move(take)](
                           Load::Request& request, Load::Response& response) {
      try {
        const Model model = loadModelAndWarn(request.file);
        const std::string remark = take(model, request.file);
        response.success = true;
        response.message = model.name + " of " + request.file;
        if (!remark.empty()) response.message += "; " + remark;
        changes.report({{parameter, std::exchange(*file, request.file), request.file}});
      } catch (const std::exception& error) {
        response.success = false;
        response.message = std::string("refused, the old model stays: ") + error.what();
        ROS_ERROR("%s: %s", full.c_str(), response.message.c_str());
      }
      return true;
    };
    server_ = thread.handle(nh).advertiseService<Load::Request, Load::Response>(name, serve);
  }

 private:
  ros::ServiceServer server_;
};

}  // namespace ground
