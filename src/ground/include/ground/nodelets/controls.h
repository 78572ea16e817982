#pragma once

#include <ground_msgs/Controls.h>

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "ground/model/inputs.h"
#include "ground/model/thruster.h"

namespace ground {

/// Writes inputs into a message: left and right for the pair, else all thrusters with the names of
/// their channels.
inline void writeInputs(const Inputs& inputs, const ThrusterLayout& layout, ground_msgs::Controls& message) {
  message.lift = inputs.lift;
  if (layout.isPair()) {
    message.left = inputs.thrusters(0);
    message.right = inputs.thrusters(1);
    return;
  }
  message.thrusters.assign(inputs.thrusters.begin(), inputs.thrusters.end());
  message.channels = layout.channels();
}

/// Why a message is not for a craft with these thrusters; empty if it is.
inline std::string misfit(const ground_msgs::Controls& message, const ThrusterLayout& layout) {
  if (message.thrusters.empty() && message.channels.empty())
    return layout.isPair() ? "" : "is for a left and a right thruster, and the craft has " + layout.names();
  const bool complete = message.thrusters.size() + 1 == message.channels.size();
  if (complete && !layout.isPair() && message.channels == layout.channels()) return "";
  std::string channels;
  for (const std::string& channel : message.channels) channels += (channels.empty() ? "" : ", ") + channel;
  return "is for the channels " + channels + ", and the craft has " + layout.names();
}

/// The inputs of a message; of at most kMaxThrusters thrusters.
inline Inputs readInputs(const ground_msgs::Controls& message) {
  if (message.thrusters.empty()) return {message.left, message.right, message.lift};
  const std::size_t count = std::min<std::size_t>(message.thrusters.size(), kMaxThrusters);
  Inputs inputs = Inputs::off(static_cast<int>(count), message.lift);
  std::copy_n(message.thrusters.begin(), count, inputs.thrusters.begin());
  return inputs;
}

/// Throws std::runtime_error if a node that runs for a craft cannot take another model.
inline void requireSameThrusters(const ThrusterLayout& now, const ThrusterLayout& next) {
  if (now.isPair() != next.isPair() || now.channels() != next.channels())
    throw std::runtime_error("the model has other thrusters (" + next.names() + ") than the craft (" +
                             now.names() + "): start again with that model");
}

}  // namespace ground
