// The datagrams of the craft, byte by byte, and the socket that carries them.
#include "ground/link/protocol.h"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

#include "../crafts.h"
#include "ground/link/udp_socket.h"

namespace ground {
namespace protocol_test {

std::string bytes(std::initializer_list<int> values) { return std::string(values.begin(), values.end()); }

std::string refusal(const std::string& datagram) {
  MotorCommand command{0.5, 0.5, 0.5};
  std::string reason;
  EXPECT_FALSE(decodeMotors(datagram, command, &reason));
  EXPECT_EQ(command.thrusters(0), 0.5);
  EXPECT_EQ(command.thrusters(1), 0.5);
  EXPECT_EQ(command.lift, 0.5);
  return reason;
}

// Wire format by the protobuf documentation: key (field << 3 | type), then a base-128 varint;
// 1000 = e8 07, 1250 = e2 09, 1500 = dc 0b, 2000 = d0 0f.
TEST(Motors, EncodesToKnownBytes) {
  EXPECT_EQ(encodeMotors({0, 0, 0}),
            bytes({0x08, 0xe8, 0x07, 0x10, 0xe8, 0x07, 0x18, 0xe8, 0x07, 0x20, 0xe8, 0x07}));
  // DL and DR are the lift, field 3 is the right thruster, field 4 the left one.
  EXPECT_EQ(encodeMotors({0.25, 0.5, 1}),
            bytes({0x08, 0xd0, 0x0f, 0x10, 0xd0, 0x0f, 0x18, 0xdc, 0x0b, 0x20, 0xe2, 0x09}));
}

TEST(Motors, RefusesToEncodeValuesThatAreNotFinite) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  EXPECT_THROW(encodeMotors({nan, 0, 0}), std::invalid_argument);
  EXPECT_THROW(encodeMotors({0, inf, 0}), std::invalid_argument);
  EXPECT_THROW(encodeMotors({0, 0, -inf}), std::invalid_argument);
}

/// Two thrusters of which the second goes backwards, and a third one.
ThrusterLayout three() {
  std::vector<Thruster> thrusters = thrusterPair()->thrusters();
  thrusters[1].least = -1;
  thrusters.push_back(thrusters[0]);
  thrusters[2].name = "bow";
  return ThrusterLayout(thrusters);
}

TEST(MotorsOfAnyThrusters, RoundTripWithinTheRanges) {
  const ThrusterLayout layout = three();
  std::vector<Thruster> alone = {layout[0]};
  alone[0].position = {0, 1};
  std::vector<Thruster> eight;
  for (int i = 0; i < 8; ++i) {
    eight.push_back(layout[i % 3]);
    eight.back().name = "t" + std::to_string(i);
  }
  for (const ThrusterLayout& one : {ThrusterLayout(alone), layout, ThrusterLayout(eight)}) {
    Inputs sent = Inputs::off(one.size(), 0.7);
    for (int i = 0; i < one.size(); ++i) sent.thrusters(i) = -0.9 + 0.3 * i;
    Inputs heard;
    std::string reason;
    ASSERT_TRUE(decodeMotors(encodeMotors(sent, one), heard, &reason, one)) << reason;
    const Thrusters<double> inside = one.clipped(sent.thrusters);
    for (int i = 0; i < one.size(); ++i) EXPECT_NEAR(heard.thrusters(i), inside(i), 1e-12) << i;
    EXPECT_NEAR(heard.lift, 0.7, 1e-12);
  }
}

TEST(MotorsOfAnyThrusters, AreRefusedByAnotherCraft) {
  const ThrusterLayout layout = three();
  Inputs command = Inputs::off(3, 0.5);
  std::string reason;
  EXPECT_FALSE(decodeMotors(encodeMotors({0, 0, 0}), command, &reason, layout));
  EXPECT_EQ(reason, "it is for another number of thrusters");
  EXPECT_EQ(refusal(encodeMotors(command, layout)), "it is for another number of thrusters");
  EXPECT_THROW(encodeMotors({0, 0, 0}, layout), std::invalid_argument);
  command.thrusters(0) = 0.4;
  command.thrusters(1) = -0.4;
  std::vector<Thruster> forward = layout.thrusters();
  forward[1].least = 0;
  EXPECT_FALSE(decodeMotors(encodeMotors(command, layout), command, &reason, ThrusterLayout(forward)));
  EXPECT_EQ(reason, "a motor is outside of the range of its thruster");
}

TEST(Motors, EveryTruncationIsRefused) {
  const std::string whole = encodeMotors({0.25, 0.5, 1});
  for (std::size_t n = 0; n < whole.size(); ++n) EXPECT_NE(refusal(whole.substr(0, n)), "");
}

TEST(Motors, RefusesGarbageWithAReason) {
  EXPECT_EQ(refusal("\xff\xff\xff\xff"), "it is cut or garbled");
  EXPECT_EQ(refusal("hello"), "it is cut or garbled");
  EXPECT_EQ(refusal(""), "a motor is missing");
  EXPECT_EQ(refusal(encodeTelemetry({})), "it has fields of another message");
  const std::string zero = encodeMotors({});
  EXPECT_NE(refusal(zero + bytes({0x28, 0x01})), "") << "a further thruster, not packed";
  EXPECT_EQ(refusal(zero + bytes({0x30, 0x01})), "it has fields of another message");
  EXPECT_EQ(refusal(zero + zero), "a motor is given twice");
  for (int field = 0; field < 4; ++field) {
    std::string low = zero, high = encodeMotors({1, 1, 1});
    low[3 * field + 1] = '\xe7';   // 999
    high[3 * field + 1] = '\xd1';  // 2001
    EXPECT_EQ(refusal(low), "a motor is outside of the range of its thruster");
    EXPECT_EQ(refusal(high), "a motor is outside of the range of its thruster");
  }
}

CraftTelemetry someTelemetry() {
  CraftTelemetry t;
  t.roll = 1.5f;
  t.pitch = -2.25f;
  t.yaw = 179.875f;
  t.acc = {-1, 2, std::numeric_limits<int>::min()};
  t.gyro = {4, 0, -6};
  t.mag = {std::numeric_limits<int>::max(), 8, 9};
  return t;
}

TEST(DroneState, DecodesKnownBytes) {
  // roll = 1.0 (fixed32), acc_x = 300, gyro_z = -2 (varint of ten bytes)
  const std::string datagram = bytes({0x0d, 0x00, 0x00, 0x80, 0x3f, 0x20, 0xac, 0x02, 0x48, 0xfe, 0xff, 0xff,
                                      0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01});
  CraftTelemetry t;
  ASSERT_TRUE(decodeTelemetry(datagram, t));
  EXPECT_EQ(t.roll, 1.0f);
  EXPECT_EQ(t.pitch, 0.0f);
  EXPECT_EQ(t.acc[0], 300);
  EXPECT_EQ(t.gyro[2], -2);
}

// A craft of an earlier version, which has none of these fields, is understood as before.
TEST(DroneState, MayHaveACountOfCommandsAVoltageAndABootId) {
  const std::string without = encodeTelemetry(someTelemetry());
  CraftTelemetry counts = someTelemetry(), tells = counts, boots = counts, read;
  counts.commands = boots.boot = 300;
  tells.voltage = 7.5f;
  const std::vector<std::pair<CraftTelemetry, std::string>> cases = {
      {counts, bytes({0x68, 0xac, 0x02})},             // field 13
      {tells, bytes({0x75, 0x00, 0x00, 0xf0, 0x40})},  // field 14, fixed32
      {boots, bytes({0x78, 0xac, 0x02})},              // field 15
  };
  for (const auto& [sent, added] : cases) {
    EXPECT_EQ(encodeTelemetry(sent), without + added);
    ASSERT_TRUE(decodeTelemetry(without + added, read));
    EXPECT_EQ(read.commands, sent.commands);
    EXPECT_EQ(read.voltage, sent.voltage);
    EXPECT_EQ(read.boot, sent.boot);
    ASSERT_TRUE(decodeTelemetry(without, read));
    EXPECT_FALSE(read.commands || read.voltage || read.boot);
  }
}

TEST(DroneState, TheLongestOneIsUnderstood) {
  CraftTelemetry t, read;
  t.acc = t.gyro = t.mag = {-1, -1, -1};
  t.roll = t.pitch = t.yaw = -1;
  t.commands = t.boot = std::numeric_limits<std::uint32_t>::max();
  t.voltage = 7.5f;
  EXPECT_TRUE(decodeTelemetry(encodeTelemetry(t), read));
  EXPECT_EQ(read.boot, t.boot);
}

TEST(DroneState, AVoltageThatCannotBeOneDoesNotSilenceTheCraft) {
  CraftTelemetry t = someTelemetry();
  t.commands = std::numeric_limits<std::uint32_t>::max();
  t.acc = t.gyro = {-1, -1, -1};
  for (const float bad : {0.0f, -3.0f, std::numeric_limits<float>::quiet_NaN()}) {
    t.voltage = bad;
    CraftTelemetry read;
    ASSERT_TRUE(decodeTelemetry(encodeTelemetry(t), read)) << bad;
    EXPECT_FALSE(read.voltage);
    EXPECT_EQ(read.roll, t.roll);
  }
}

TEST(DroneState, RefusesGarbageWithAReason) {
  CraftTelemetry t;
  t.roll = 42;
  const auto refused = [&t](const std::string& datagram) {
    std::string reason;
    EXPECT_FALSE(decodeTelemetry(datagram, t, &reason));
    EXPECT_EQ(t.roll, 42);
    return reason;
  };
  EXPECT_EQ(refused(""), "it is empty");
  EXPECT_EQ(refused("hello"), "it is cut or garbled");
  EXPECT_EQ(refused(encodeMotors({})), "it has fields of another message");
  EXPECT_EQ(refused(std::string(60000, '\x0d')), "it is too long");
  CraftTelemetry bad;
  bad.yaw = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(refused(encodeTelemetry(bad)), "an angle is not finite");
}

TEST(UdpAddress, ReadsHostAndPort) {
  EXPECT_EQ(UdpAddress::parse("127.0.0.1:3333").text(), "127.0.0.1:3333");
  EXPECT_EQ(UdpAddress::parse("10.1.2.3").port, 0);
  EXPECT_EQ(UdpAddress::parse("10.1.2.3", 77).text(), "10.1.2.3:77");
  EXPECT_EQ(UdpAddress::parse("localhost:1").text(), "127.0.0.1:1");
  EXPECT_FALSE(UdpAddress().known());
  for (const char* bad : {"127.0.0.1:", "127.0.0.1:0", "127.0.0.1:65536", "127.0.0.1:-1", ":5",
                          "127.0.0.1:5x", "::1", "", "256.1.1.1"})
    EXPECT_THROW(UdpAddress::parse(bad), std::invalid_argument) << bad;
}

TEST(UdpSocket, CarriesDatagramsAndTheirSender) {
  UdpSocket a(UdpAddress::parse("127.0.0.1")), b(UdpAddress::parse("127.0.0.1"));
  const UdpAddress to_a = UdpAddress::parse("127.0.0.1", a.port());
  ASSERT_TRUE(b.send("abc", to_a));
  ASSERT_TRUE(b.send("", to_a));
  std::string data;
  UdpAddress from;
  ASSERT_TRUE(a.receive(5, data, from));
  EXPECT_EQ(data, "abc");
  EXPECT_EQ(from, UdpAddress::parse("127.0.0.1", b.port()));
  ASSERT_TRUE(a.receive(5, data, from));
  EXPECT_EQ(data, "");
  EXPECT_FALSE(a.receive(0.001, data, from));
}

TEST(UdpSocket, ReportsFailures) {
  UdpSocket a(UdpAddress::parse("127.0.0.1"));
  EXPECT_EQ(ground::refusal([&] { UdpSocket b(UdpAddress::parse("127.0.0.1", a.port())); }),
            "cannot bind UDP port " + std::to_string(a.port()) + ": Address already in use");
  errno = 0;
  EXPECT_FALSE(a.send("abc", UdpAddress::parse("255.255.255.255", 9)));  // broadcast is not allowed
  EXPECT_NE(errno, 0);
}

}  // namespace protocol_test
}  // namespace ground
