#pragma once

#include <ros/console.h>

#include <string>
#include <vector>

#include "ground/model/model_file.h"

namespace ground {

/// Like loadModel; logs a warning for each implausible value.
inline Model loadModelAndWarn(const std::string& path) {
  std::vector<std::string> warnings;
  const Model model = loadModel(path, &warnings);
  for (const std::string& warning : warnings) ROS_WARN("%s", warning.c_str());
  return model;
}

}  // namespace ground
