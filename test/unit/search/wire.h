// What the craft makes of a packet.
#pragma once

#include <stdexcept>

#include "ground/link/protocol.h"

namespace ground {
namespace search {

/// A command as the craft reads it. Throws std::logic_error if it cannot.
inline MotorCommand overTheWire(const MotorCommand& command, const ThrusterLayout& layout) {
  MotorCommand read = MotorCommand::off(layout.size());
  std::string reason;
  if (!decodeMotors(encodeMotors(command, layout), read, &reason, layout)) throw std::logic_error(reason);
  return read;
}

}  // namespace search
}  // namespace ground
