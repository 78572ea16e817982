#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

namespace ground {

/// Normalised inputs of the craft, each 0..1.
struct MotorCommand {
  double left = 0.0;   ///< left thruster
  double right = 0.0;  ///< right thruster
  double lift = 0.0;   ///< lift fan
};

/// What the craft says of itself, in the flight controller's units.
struct CraftTelemetry {
  float roll = 0, pitch = 0, yaw = 0;
  std::array<int, 3> acc{}, gyro{}, mag{};
  /// Commands taken since it was switched on; nothing from a craft that does not count them.
  std::optional<std::uint32_t> commands;
};

/// Datagram to the craft: each motor 1000 + 1000 clip(value), both lift motors alike. Throws
/// std::invalid_argument when a value is not finite.
std::string encodeMotors(const MotorCommand& command);
/// Reads a datagram from the ground; false, with the reason and `command` untouched, when it is not
/// exactly one Motors message or a value is outside 1000..2000.
bool decodeMotors(const std::string& datagram, MotorCommand& command,
                  std::string* reason = nullptr);

std::string encodeTelemetry(const CraftTelemetry& telemetry);
/// Reads a datagram from the craft; false, with the reason and `telemetry` untouched, when it is
/// not a DroneState. All its fields are optional, so that one cut between two fields still is one.
bool decodeTelemetry(const std::string& datagram, CraftTelemetry& telemetry,
                     std::string* reason = nullptr);

}  // namespace ground
