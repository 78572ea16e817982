#include "ground/link/protocol.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "drone.pb.h"

namespace ground {
namespace {

constexpr unsigned kOff = 1000, kRange = 1000;
// A message has three floats, nine ints and a count: at most 120 bytes.
constexpr std::size_t kLongestTelemetry = 128;

unsigned toMotor(double value) {
  return kOff + static_cast<unsigned>(std::lround(kRange * std::clamp(value, 0.0, 1.0)));
}

bool fromMotor(unsigned motor, double& value) {
  value = (static_cast<double>(motor) - kOff) / kRange;
  return motor >= kOff && motor <= kOff + kRange;
}

bool refuse(const char* why, std::string* reason) {
  if (reason != nullptr) *reason = why;
  return false;
}

}  // namespace

std::string encodeMotors(const MotorCommand& command) {
  if (!std::isfinite(command.left) || !std::isfinite(command.right) || !std::isfinite(command.lift))
    throw std::invalid_argument("a motor command is not finite");
  proto::Motors motors;
  motors.set_motor_dl(toMotor(command.lift));
  motors.set_motor_dr(toMotor(command.lift));
  motors.set_motor_r(toMotor(command.right));
  motors.set_motor_l(toMotor(command.left));
  return motors.SerializeAsString();
}

bool decodeMotors(const std::string& datagram, MotorCommand& command, std::string* reason) {
  proto::Motors motors;
  // Partial, because protobuf prints to stderr if a required field is missing.
  if (!motors.ParsePartialFromString(datagram)) return refuse("it is cut or garbled", reason);
  if (!motors.unknown_fields().empty()) return refuse("it has fields of another message", reason);
  if (!motors.IsInitialized()) return refuse("a motor is missing", reason);
  if (motors.ByteSizeLong() != datagram.size()) return refuse("a motor is given twice", reason);
  MotorCommand read;
  double lift_right = 0;
  if (!fromMotor(motors.motor_l(), read.left) || !fromMotor(motors.motor_r(), read.right) ||
      !fromMotor(motors.motor_dl(), read.lift) || !fromMotor(motors.motor_dr(), lift_right))
    return refuse("a motor is outside 1000..2000", reason);
  command = read;
  return true;
}

std::string encodeTelemetry(const CraftTelemetry& t) {
  proto::DroneState state;
  state.set_roll(t.roll);
  state.set_pitch(t.pitch);
  state.set_yaw(t.yaw);
  state.set_acc_x(t.acc[0]);
  state.set_acc_y(t.acc[1]);
  state.set_acc_z(t.acc[2]);
  state.set_gyro_x(t.gyro[0]);
  state.set_gyro_y(t.gyro[1]);
  state.set_gyro_z(t.gyro[2]);
  state.set_mag_x(t.mag[0]);
  state.set_mag_y(t.mag[1]);
  state.set_mag_z(t.mag[2]);
  if (t.commands) state.set_motors_received(*t.commands);
  return state.SerializeAsString();
}

bool decodeTelemetry(const std::string& datagram, CraftTelemetry& t, std::string* reason) {
  proto::DroneState state;
  // protobuf also parses an empty datagram, and often parses foreign bytes as unknown fields.
  if (datagram.empty()) return refuse("it is empty", reason);
  if (datagram.size() > kLongestTelemetry) return refuse("it is too long", reason);
  if (!state.ParseFromString(datagram)) return refuse("it is cut or garbled", reason);
  if (!state.unknown_fields().empty()) return refuse("it has fields of another message", reason);
  if (!std::isfinite(state.roll()) || !std::isfinite(state.pitch()) || !std::isfinite(state.yaw()))
    return refuse("an angle is not finite", reason);
  t = {state.roll(),
       state.pitch(),
       state.yaw(),
       {state.acc_x(), state.acc_y(), state.acc_z()},
       {state.gyro_x(), state.gyro_y(), state.gyro_z()},
       {state.mag_x(), state.mag_y(), state.mag_z()},
       std::nullopt};
  if (state.has_motors_received()) t.commands = state.motors_received();
  return true;
}

}  // namespace ground
