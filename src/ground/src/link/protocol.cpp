#include "ground/link/protocol.h"

#include <algorithm>
#include <cmath>

#include "drone.pb.h"

namespace ground {
namespace {

constexpr unsigned kOff = 1000, kRange = 1000;

unsigned toMotor(double value) {
  return kOff + static_cast<unsigned>(std::lround(kRange * std::clamp(value, 0.0, 1.0)));
}

bool fromMotor(unsigned motor, double& value) {
  value = (static_cast<double>(motor) - kOff) / kRange;
  return motor >= kOff && motor <= kOff + kRange;
}

}  // namespace

std::string encodeMotors(const MotorCommand& command) {
  proto::Motors motors;
  motors.set_motor_dl(toMotor(command.lift));
  motors.set_motor_dr(toMotor(command.lift));
  motors.set_motor_r(toMotor(command.right));
  motors.set_motor_l(toMotor(command.left));
  return motors.SerializeAsString();
}

bool decodeMotors(const std::string& datagram, MotorCommand& command) {
  proto::Motors motors;
  double lift_right = 0;
  return motors.ParsePartialFromString(datagram) && motors.IsInitialized() &&
         motors.unknown_fields().empty() && fromMotor(motors.motor_l(), command.left) &&
         fromMotor(motors.motor_r(), command.right) && fromMotor(motors.motor_dl(), command.lift) &&
         fromMotor(motors.motor_dr(), lift_right);
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
  return state.SerializeAsString();
}

bool decodeTelemetry(const std::string& datagram, CraftTelemetry& t) {
  proto::DroneState state;
  // An empty datagram parses too, and a stranger's bytes often parse as fields nobody knows.
  if (datagram.empty() || !state.ParseFromString(datagram) || !state.unknown_fields().empty())
    return false;
  if (!std::isfinite(state.roll()) || !std::isfinite(state.pitch()) || !std::isfinite(state.yaw()))
    return false;
  t = {state.roll(),
       state.pitch(),
       state.yaw(),
       {state.acc_x(), state.acc_y(), state.acc_z()},
       {state.gyro_x(), state.gyro_y(), state.gyro_z()},
       {state.mag_x(), state.mag_y(), state.mag_z()}};
  return true;
}

}  // namespace ground
