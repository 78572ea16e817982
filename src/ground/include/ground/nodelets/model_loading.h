#pragma once

#include <ros/console.h>

#include <stdexcept>
#include <string>
#include <vector>

#include "ground/model/model_file.h"

namespace ground {

/// Like loadModel; logs a warning for each implausible value. Throws std::runtime_error also if the
/// thrusters are not a left and a right one: messages and link know no others.
inline Model loadModelAndWarn(const std::string& path) {
  std::vector<std::string> warnings;
  const Model model = loadModel(path, &warnings);
  if (!model.thrusters->isPair())
    throw std::runtime_error(path + ": this node commands a left and a right thruster; the model " +
                             model.name + " lists others (" + model.thrusters->names() +
                             "): give one in the short form, without thrusters");
  for (const std::string& warning : warnings) ROS_WARN("%s", warning.c_str());
  return model;
}

}  // namespace ground
