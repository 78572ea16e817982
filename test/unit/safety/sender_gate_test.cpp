// The link, the fence of what is sent and the test of obedience together, as the sender has them.
#include "ground/safety/sender_gate.h"

#include <gtest/gtest.h>

#include <vector>

#include "ground/model/model_file.h"

namespace ground {
namespace sender_gate_test {

constexpr double kFrame = 0.01;  // [s]

/// A gate in a room of 4 x 4 m, on clocks that differ, and what leaves through it.
class SenderGateTest : public testing::Test {
 protected:
  SenderGateTest() { gate_.setCraft(craft_); }

  Instant now() const { return {now_, 1e9 + now_}; }
  void wait(double duration) {
    for (const double until = now_ + duration; now_ < until; now_ += 0.001) gate_.tick(now());
  }
  /// A state at x [m] that moves with u [m/s] along x.
  void see(double x = 0, double u = 0) {
    MeasuredState state;
    state.stamp = now().time;
    state.valid = true;
    state.state = {Vector3<double>(x, 0, 0), Vector3<double>(u, 0, 0)};
    gate_.state(now(), state);
  }
  void command(double input, double lift = 1) {
    gate_.command(now(), now().time, "/mine", {input, input, lift});
  }
  std::string arm() {
    see();
    command(0, 0);
    return gate_.link(now()).arm(now_);
  }
  const std::string& reason() const { return gate_.link().reason(); }

  Model craft_ = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  std::vector<MotorCommand> sent_;
  SenderGate gate_{GroundLinkParams(), UdpAddress{1, 1},
                   [this](const MotorCommand& command, const UdpAddress&) {
                     sent_.push_back(command);
                     return std::string();
                   },
                   craft_.thrusters};
  double now_ = 5;
};

TEST_F(SenderGateTest, NoThrustLeavesAfterTheCraftCanNoLongerStopInTheRoom) {
  gate_.setFence(Fence(Room(), 0));
  ASSERT_EQ(arm(), "");
  see(1.1, 1.1);
  command(1);
  ASSERT_EQ(sent_.back().thrusters(0), 1);
  wait(0.15);  // it moves on unseen, under thrust
  EXPECT_FALSE(gate_.armed());
  EXPECT_NE(reason().find("outside of the room"), std::string::npos) << reason();
  for (const double x : {0.0, 1.9}) {
    gate_.link(now()).disarm(now_, "again");
    sent_.clear();
    ASSERT_EQ(arm(), "");
    see(x, 2);
    command(1);
    EXPECT_EQ(sent_.back().thrusters(0), x == 0 ? 1 : 0);
  }
}

TEST_F(SenderGateTest, ASilenceDoesNotBeginWhereTheCraftWouldLeave) {
  gate_.setFence(Fence(Room(), 0));
  ASSERT_EQ(arm(), "");
  see(1.4, 1);
  command(0.4);
  now_ += 0.15;
  EXPECT_NE(gate_.silence(now(), 0.5), "");
  EXPECT_EQ(sent_.back().thrusters(0), 0);
}

TEST_F(SenderGateTest, AfterAJumpOfTimeOldStatesCountNoMore) {
  gate_.setFence(Fence(Room(), 0));
  ASSERT_EQ(arm(), "");
  see(1.9, 2);
  gate_.timeJumped(now(), "time jumped");
  gate_.link(now()).disarm(now_, "again");
  command(0, 0);
  gate_.link(now()).state(now_, 0, true);  // not through the gate: its fence knows no state
  EXPECT_EQ(gate_.link(now()).arm(now_), "");
}

TEST_F(SenderGateTest, AStateThatIsNotFiniteIsNone) {
  ASSERT_EQ(arm(), "");
  see(NAN);
  EXPECT_EQ(reason(), "the state is invalid: the state is not finite");
}

TEST_F(SenderGateTest, ACraftThatDoesNotMoveDisobeysUnlessItIsFastened) {
  for (const bool fastened : {false, true}) {
    GroundLinkParams params;
    params.require_state = !fastened;
    gate_.setParams(params);
    gate_.link(now()).disarm(now_, "again");
    ASSERT_EQ(arm(), "");
    for (const double until = now_ + 3; now_ < until; now_ += kFrame) {
      command(1);
      see();
    }
    EXPECT_EQ(gate_.armed(), fastened) << reason();
  }
}

}  // namespace sender_gate_test
}  // namespace ground
