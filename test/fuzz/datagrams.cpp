// Fuzzes the decoders of datagrams: the craft's telemetry and the sender's commands.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "ground/link/protocol.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string datagram(reinterpret_cast<const char*>(data), size);
  ground::MotorCommand command;
  if (ground::decodeMotors(datagram, command)) {
    for (const double x : {command.thrusters(0), command.thrusters(1), command.lift})
      if (!(x >= 0 && x <= 1)) std::abort();
  }
  ground::CraftTelemetry telemetry;
  ground::decodeTelemetry(datagram, telemetry);
  return 0;
}
