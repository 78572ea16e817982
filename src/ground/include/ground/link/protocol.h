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

/// Telemetry of the craft, in the flight controller's units.
struct CraftTelemetry {
  float roll = 0, pitch = 0, yaw = 0;
  std::array<int, 3> acc{}, gyro{}, mag{};
  /// Number of commands received since power-on; no value if the craft does not count them.
  std::optional<std::uint32_t> commands;
};

/// Datagram to the craft: each motor gets 1000 + 1000 clip(value), both lift motors the same.
/// Throws std::invalid_argument if a value is not finite.
std::string encodeMotors(const MotorCommand& command);
/// Parses a datagram from the ground. Returns false, sets the reason and leaves `command`
/// unchanged, if it is not exactly one Motors message or a value is outside 1000..2000.
bool decodeMotors(const std::string& datagram, MotorCommand& command,
                  std::string* reason = nullptr);

std::string encodeTelemetry(const CraftTelemetry& telemetry);
/// Parses a datagram from the craft. Returns false, sets the reason and leaves `telemetry`
/// unchanged, if it is not a DroneState. All fields are optional, so a DroneState cut between two
/// fields is accepted.
bool decodeTelemetry(const std::string& datagram, CraftTelemetry& telemetry,
                     std::string* reason = nullptr);

}  // namespace ground
