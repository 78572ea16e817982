#include "ground/link/protocol.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "drone.pb.h"

namespace ground {
namespace {

constexpr int kOff = 1000, kRange = 1000;
// Four floats of five bytes with their keys, nine ints of eleven, a count and a boot id of six each.
constexpr std::size_t kLongestTelemetry = 131;

unsigned toMotor(double value, double least, double most) {
  const auto share = static_cast<int>(std::lround(kRange * std::clamp(value, least, most)));
  return static_cast<unsigned>(kOff + share);
}

bool fromMotor(unsigned motor, double least, double most, double& value) {
  value = (static_cast<double>(motor) - kOff) / kRange;
  return value >= least && value <= most;
}

/// The motors of all thrusters.
std::vector<unsigned> thrustersIn(const proto::Motors& motors, int count) {
  std::vector<unsigned> all = {motors.motor_l(), motors.motor_r()};
  all.insert(all.end(), motors.motors_further().begin(), motors.motors_further().end());
  if (count == 1 && all.size() == 2 && motors.motor_r() == kOff) all.pop_back();
  return all;
}

bool refuse(const char* why, std::string* reason) {
  if (reason != nullptr) *reason = why;
  return false;
}

}  // namespace

std::string encodeMotors(const MotorCommand& command, const ThrusterLayout& layout) {
  if (!command.finite()) throw std::invalid_argument("a motor command is not finite");
  if (command.thrusters.size() != layout.size())
    throw std::invalid_argument("a motor command is for another number of thrusters");
  const unsigned lift = toMotor(command.lift, 0, 1);
  proto::Motors motors;
  motors.set_motor_dl(lift);
  motors.set_motor_dr(lift);
  motors.set_motor_r(kOff);
  for (int i = 0; i < layout.size(); ++i) {
    const unsigned motor = toMotor(command.thrusters(i), layout[i].least, layout[i].most);
    if (i == 0) motors.set_motor_l(motor);
    if (i == 1) motors.set_motor_r(motor);
    if (i > 1) motors.add_motors_further(motor);
  }
  return motors.SerializeAsString();
}

bool decodeMotors(const std::string& datagram, MotorCommand& command, std::string* reason,
                  const ThrusterLayout& layout) {
  proto::Motors motors;
  // Partial, because protobuf prints to stderr if a required field is missing.
  if (!motors.ParsePartialFromString(datagram)) return refuse("it is cut or garbled", reason);
  if (!motors.unknown_fields().empty()) return refuse("it has fields of another message", reason);
  if (!motors.IsInitialized()) return refuse("a motor is missing", reason);
  if (motors.ByteSizeLong() != datagram.size()) return refuse("a motor is given twice", reason);
  const std::vector<unsigned> all = thrustersIn(motors, layout.size());
  if (static_cast<int>(all.size()) != layout.size())
    return refuse("it is for another number of thrusters", reason);
  MotorCommand read = Inputs::off(layout.size());
  double lift_right = 0;
  bool inside =
      fromMotor(motors.motor_dl(), 0, 1, read.lift) && fromMotor(motors.motor_dr(), 0, 1, lift_right);
  for (int i = 0; i < layout.size(); ++i)
    inside = inside &&
             fromMotor(all[static_cast<std::size_t>(i)], layout[i].least, layout[i].most, read.thrusters(i));
  if (!inside) return refuse("a motor is outside of the range of its thruster", reason);
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
  if (t.voltage) state.set_battery_voltage(*t.voltage);
  if (t.boot) state.set_boot_id(*t.boot);
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
       std::nullopt,
       std::nullopt,
       std::nullopt};
  if (state.has_motors_received()) t.commands = state.motors_received();
  if (state.has_boot_id()) t.boot = state.boot_id();
  // A sensor that is not connected must not silence the craft.
  const float voltage = state.battery_voltage();
  if (std::isfinite(voltage) && voltage > 0) t.voltage = voltage;
  return true;
}

}  // namespace ground
