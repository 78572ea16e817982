#pragma once

#include <string>

#include "ground/model/thruster.h"
#include "ground/safety/craft_telemetry.h"

namespace ground {

/// Datagram to the craft: each motor gets 1000 + 1000 value, clipped to the range of its thruster
/// in `layout`; both lift motors get the same. Throws std::invalid_argument if a value is not
/// finite or the number of thrusters is another.
std::string encodeMotors(const MotorCommand& command, const ThrusterLayout& layout = *thrusterPair());
/// Parses a datagram from the ground. Returns false, sets the reason and leaves `command`
/// unchanged, if it is not exactly one Motors message for the thrusters of `layout`, or a value is
/// outside of the range of its thruster.
bool decodeMotors(const std::string& datagram, MotorCommand& command, std::string* reason = nullptr,
                  const ThrusterLayout& layout = *thrusterPair());

std::string encodeTelemetry(const CraftTelemetry& telemetry);
/// Parses a datagram from the craft. Returns false, sets the reason and leaves `telemetry`
/// unchanged, if it is not a DroneState. A voltage that cannot be one is left out. All fields are optional,
/// so a DroneState cut between two fields is accepted.
bool decodeTelemetry(const std::string& datagram, CraftTelemetry& telemetry, std::string* reason = nullptr);

}  // namespace ground
