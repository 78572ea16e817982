#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "ground/model/inputs.h"

namespace ground {

/// Normalised inputs of the craft.
using MotorCommand = Inputs;

/// Telemetry of the craft, in the flight controller's units.
struct CraftTelemetry {
  float roll = 0, pitch = 0, yaw = 0;
  std::array<int, 3> acc{}, gyro{}, mag{};
  /// Number of commands received since power-on; no value if the craft does not count them.
  std::optional<std::uint32_t> commands;
  std::optional<float> voltage;       ///< of the battery [V]; no value if the craft does not measure it
  std::optional<std::uint32_t> boot;  ///< differs after each start; no value if the craft does not send it
};

}  // namespace ground
