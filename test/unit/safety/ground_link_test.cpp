// The state machine and the peer rules of the link, on a simulated clock.
#include "ground/safety/ground_link.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <utility>
#include <vector>

namespace ground {
namespace ground_link_test {

using State = GroundLink::State;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();
const UdpAddress kCraft = UdpAddress::parse("10.0.0.2:4000");
const UdpAddress kRestarted = UdpAddress::parse("10.0.0.2:4001");
const UdpAddress kStranger = UdpAddress::parse("10.0.0.3:4000");
const MotorCommand kZero{};
const MotorCommand kDrive{0.5, 0.25, 1};

class GroundLinkTest : public testing::Test {
 protected:
  struct Packet {
    double time;
    MotorCommand command;
    UdpAddress to;
  };

  void make(const UdpAddress& peer = {}, const GroundLinkParams& params = {}) {
    link_ =
        std::make_unique<GroundLink>(params, peer, [this](const MotorCommand& command, const UdpAddress& to) {
          if (!broken_.empty()) return broken_;
          packets_.push_back({now_, command, to});
          return std::string();
        });
  }
  void SetUp() override { make(); }

  GroundLink& link() { return *link_; }
  void telemetry(const UdpAddress& from) { link().datagram(now_, CraftTelemetry(), from); }
  /// Telemetry that counts the commands that have reached the craft.
  void counted(std::uint32_t commands, std::optional<std::uint32_t> boot = {}) {
    CraftTelemetry t;
    t.commands = commands;
    t.boot = boot;
    link().datagram(now_, t, kCraft);
  }
  void booted(std::uint32_t boot) {
    CraftTelemetry t;
    t.boot = boot;
    link().datagram(now_, t, kCraft);
  }
  void garbage(const UdpAddress& from) { link().datagram(now_, std::nullopt, from); }
  void command(const MotorCommand& c, const std::string& source = "/a", double age = 0) {
    link().command(now_, age, source, c);
  }
  void state(bool valid = true, double age = 0) { link().state(now_, age, valid, "lost"); }
  std::string arm() { return link().arm(now_); }
  /// Advances the clock in steps of a millisecond.
  void wait(double duration) {
    const double until = now_ + duration;
    while (now_ < until - 1e-9) {
      now_ += 0.001;
      link().tick(now_);
    }
  }
  /// Sends states and a command at 100 Hz for `duration` [s].
  void feed(double duration, const MotorCommand& c) {
    for (const double until = now_ + duration; now_ < until - 1e-9; wait(0.01)) {
      state();
      command(c);
    }
    state();
    command(c);
  }
  void armed() {
    telemetry(kCraft);
    state();
    command(kZero);
    ASSERT_EQ(arm(), "");
    ASSERT_EQ(link().current(), State::kArmed);
  }
  void fault() {
    armed();
    state(false);
    ASSERT_EQ(link().current(), State::kFault);
  }
  bool lastIs(const MotorCommand& c) const {
    const MotorCommand& last = packets_.back().command;
    return last == c;
  }
  bool allZeroSince(std::size_t first) const {
    for (std::size_t i = first; i < packets_.size(); ++i) {
      const MotorCommand& c = packets_[i].command;
      if (!c.zero()) return false;
    }
    return true;
  }

  double now_ = 100;
  std::string broken_;
  std::vector<Packet> packets_;
  std::unique_ptr<GroundLink> link_;
};

TEST_F(GroundLinkTest, ArmsOnlyWithEverythingInPlace) {
  telemetry(kCraft);
  command(kZero);
  EXPECT_EQ(arm(), "there is no state");
  state(false);
  EXPECT_EQ(arm(), "the state is invalid: lost");
  state(false, 0.25);  // as before the first pose, whose stamp is zero
  EXPECT_EQ(arm(), "the state is invalid: lost");
  state(true, 0.25);
  EXPECT_EQ(arm(), "the state is stale");
  state(true, kNan);
  EXPECT_NE(arm(), "");
  state();
  wait(0.21);
  EXPECT_EQ(arm(), "the state is stale");
  state();
  EXPECT_EQ(arm(), "there is no fresh command");
  for (const MotorCommand& c : {MotorCommand{0.01, 0, 0}, {0, 0.01, 0}, {0, 0, 0.01}, {-0.01, 0, 0}}) {
    command(c);
    EXPECT_EQ(arm(), "the command is not zero");
  }
  command(kZero);
  command({kNan, 0, 0});
  EXPECT_EQ(arm(), "there is no fresh command: a command of /a is not finite");
  command(kZero);
  command(kZero, "/a", 0.3);
  EXPECT_EQ(arm(),
            "there is no fresh command: a command of /a is older by its stamp than "
            "command_timeout");
  EXPECT_EQ(link().current(), State::kDisarmed);
  command(kZero);
  EXPECT_EQ(arm(), "");
  EXPECT_EQ(link().current(), State::kArmed);
  EXPECT_EQ(link().reason(), "armed with commands of /a");
  EXPECT_EQ(arm(), "");  // arming again has no effect
  EXPECT_TRUE(allZeroSince(0));
}

TEST_F(GroundLinkTest, OnABenchEverythingExceptTheStateIsWatched) {
  GroundLinkParams params;
  params.require_state = params.require_lift = false;
  make({}, params);
  const MotorCommand push{0.5, 0, 0};
  command(kZero);
  EXPECT_EQ(arm(), "no craft is connected");
  telemetry(kCraft);
  ASSERT_EQ(arm(), "");
  for (int i = 0; i < 210; ++i, wait(0.01)) command(push);
  EXPECT_EQ(link().reason(), "the craft has fallen silent (craft_timeout)");
  EXPECT_TRUE(lastIs(kZero));

  link().disarm(now_, "by hand");
  telemetry(kCraft);
  EXPECT_EQ(arm(), "the command is not zero");
  command(kZero);
  ASSERT_EQ(arm(), "");
  command(push);
  EXPECT_TRUE(lastIs(push));
  wait(0.3);
  EXPECT_EQ(link().reason(), "commands are stale");
  EXPECT_TRUE(lastIs(kZero));
}

TEST_F(GroundLinkTest, ArmedSendsEachCommandAtOnceAndRepeatsIt) {
  armed();
  packets_.clear();
  command(kDrive);
  ASSERT_EQ(packets_.size(), 1u);
  EXPECT_TRUE(lastIs(kDrive));
  wait(0.1);
  EXPECT_NEAR(packets_.size(), 6, 1);
  EXPECT_TRUE(lastIs(kDrive));
  packets_.clear();
  feed(1, kDrive);
  EXPECT_NEAR(packets_.size(), 101, 1);  // nothing is repeated while commands are frequent
}

TEST_F(GroundLinkTest, RefusesCommandsThatAreNotFinite) {
  armed();
  command(kDrive);
  const std::size_t sent = packets_.size();
  for (const MotorCommand& c : {MotorCommand{kNan, 0, 0}, {0, kInf, 0}, {0, 0, -kInf}, {kNan, kNan, kNan}})
    command(c);
  EXPECT_EQ(packets_.size(), sent);
  EXPECT_EQ(link().counters().refused, 4u);
  EXPECT_EQ(link().current(), State::kArmed);
  // A series of them ends as if no command came.
  const double since = now_;
  while (link().current() == State::kArmed && now_ < since + 1) {
    state();
    command({kNan, 0, 0});
    wait(0.01);
  }
  EXPECT_EQ(link().current(), State::kFault);
  EXPECT_NEAR(now_ - since, 0.2, 0.011);
  EXPECT_EQ(link().reason(), "commands are stale: a command of /a is not finite");
}

TEST_F(GroundLinkTest, RefusesThrustWithoutLiftUnlessAllowed) {
  armed();
  feed(0.1, kDrive);
  const std::size_t before = packets_.size();
  const std::uint64_t refused = link().counters().refused;
  for (int i = 0; i < 10; ++i) {
    command({0.5, 0.25, 0});
    wait(0.01);
  }
  EXPECT_EQ(link().counters().refused, refused + 10);
  for (std::size_t i = before; i < packets_.size(); ++i) EXPECT_EQ(packets_[i].command.lift, 1);
  wait(0.2);
  EXPECT_EQ(link().current(), State::kFault);
  EXPECT_TRUE(lastIs(kZero));
  EXPECT_NE(link().reason().find("thrust without lift"), std::string::npos) << link().reason();

  GroundLinkParams params;
  params.require_lift = false;
  make({}, params);
  armed();
  command({0.5, 0.25, 0});
  EXPECT_TRUE(lastIs({0.5, 0.25, 0}));
}

TEST_F(GroundLinkTest, ACraftThatFallsSilentIsAFault) {
  armed();
  feed(1.9, kDrive);
  EXPECT_EQ(link().current(), State::kArmed);
  feed(0.2, kDrive);
  EXPECT_EQ(link().current(), State::kFault);
  EXPECT_NE(link().reason().find("silent"), std::string::npos) << link().reason();
  link().disarm(now_, "by hand");
  feed(0.1, kZero);
  EXPECT_NE(arm().find("silent"), std::string::npos);
  telemetry(kCraft);
  EXPECT_EQ(arm(), "");

  GroundLinkParams params;
  params.craft_timeout = 0;
  make({}, params);
  armed();
  feed(10, kDrive);
  EXPECT_EQ(link().current(), State::kArmed);

  make();  // a craft that has sent only its hello
  garbage(kCraft);
  feed(0.1, kZero);
  ASSERT_EQ(arm(), "");
  feed(3, kDrive);
  EXPECT_EQ(link().current(), State::kArmed);
}

TEST_F(GroundLinkTest, ACraftThatCountsNoMoreCommandsIsAFault) {
  armed();
  for (std::uint32_t i = 0; i < 300; ++i) {
    counted(i);
    feed(0.01, kDrive);
  }
  ASSERT_EQ(link().current(), State::kArmed);
  const double last = now_;
  while (link().current() == State::kArmed && now_ < last + 2) {
    counted(299);
    feed(0.01, kDrive);
  }
  EXPECT_NEAR(now_ - last, 1.0, 0.03);
  EXPECT_EQ(link().reason(),
            "the craft does not follow its commands: its count of received commands has "
            "stopped");
  EXPECT_TRUE(lastIs(kZero));
  // When commands reach it again, there is no thrust.
  const std::size_t sent = packets_.size();
  for (std::uint32_t i = 300; i < 350; ++i) {
    counted(i);
    feed(0.01, kDrive);
  }
  EXPECT_EQ(link().current(), State::kFault);
  EXPECT_TRUE(allZeroSince(sent));
}

TEST_F(GroundLinkTest, ACraftThatRestartsGetsNoThrustBeforeItIsArmedAgain) {
  for (const bool has_boot : {false, true})
    for (const bool counts : {false, true})
      for (const double outage : {0.0, 0.1, 0.5, 1.9}) {
        make();
        std::uint32_t boot = 77, count = 0;
        const auto speak = [&] {
          if (counts) return counted(count++, has_boot ? std::make_optional(boot) : std::nullopt);
          has_boot ? booted(boot) : telemetry(kCraft);
        };
        armed();
        for (int i = 0; i < 100; ++i, feed(0.01, kDrive)) speak();
        ASSERT_EQ(link().current(), State::kArmed);
        feed(outage, kDrive);
        boot = 5;
        count = 0;
        for (int i = 0; i < 2; ++i, feed(0.01, kDrive)) speak();
        if (!has_boot && !counts) {  // nobody can know: see the page on the protocol
          EXPECT_EQ(link().current(), State::kArmed);
          continue;
        }
        EXPECT_EQ(link().current(), State::kFault) << has_boot << counts << outage;
        if (outage < 1) {
          EXPECT_EQ(link().reason(), "the craft has restarted");
        }
        const std::size_t sent = packets_.size();
        for (int i = 0; i < 100; ++i, feed(0.01, kDrive)) speak();
        EXPECT_TRUE(allZeroSince(sent));
        link().disarm(now_, "by hand");
        speak();
        command(kZero);
        EXPECT_EQ(arm(), "");
        for (int i = 0; i < 100; ++i, feed(0.01, kDrive)) speak();
        EXPECT_TRUE(lastIs(kDrive)) << "it drives on as the craft that it is now";
      }
}

TEST_F(GroundLinkTest, DatagramsThatAreLateOrRepeatedAreNoRestart) {
  armed();
  std::uint32_t random = 1;
  for (std::uint32_t count = 10; count < 2000; ++count) {
    counted(count, 77);
    if (count % 7 == 0) counted(count, 77);                   // repeated
    if (count % 3 == 0) counted(count - 1 - random % 9, 77);  // a late one
    random = random * 1664525 + 1013904223;
    if (count % 5 == 0) booted(77);  // without a count
    if (count % 11 == 0) telemetry(kCraft);
    feed(0.01, kDrive);
    ASSERT_EQ(link().current(), State::kArmed) << link().reason() << " at " << count;
  }
}

TEST_F(GroundLinkTest, ACraftThatRestartsWhileDisarmedOrElsewhereCanBeArmed) {
  counted(1000, 1);
  counted(3, 2);
  counted(4, 2);
  armed();
  counted(5, 2);
  feed(0.1, kDrive);
  EXPECT_TRUE(lastIs(kDrive));
  link().disarm(now_, "by hand");
  wait(3);
  CraftTelemetry restarted;
  restarted.boot = 3;
  restarted.commands = 0;
  link().datagram(now_, restarted, kRestarted);
  state();
  command(kZero);
  ASSERT_EQ(arm(), "");
  link().datagram(now_, restarted, kRestarted);
  feed(0.1, kDrive);
  EXPECT_TRUE(lastIs(kDrive)) << link().reason();
}

TEST_F(GroundLinkTest, ARestartDuringASilenceEndsIt) {
  armed();
  counted(100);
  feed(0.1, {0.2, 0.2, 0.6});
  ASSERT_EQ(link().silence(now_, 1.5), "");
  feed(0.2, kZero);
  const std::size_t sent = packets_.size();
  counted(0);
  counted(0);
  EXPECT_EQ(link().current(), State::kFault);
  EXPECT_GT(packets_.size(), sent) << "zeros at once";
  EXPECT_TRUE(allZeroSince(sent));
}

TEST_F(GroundLinkTest, DisobedienceIsAFaultWhileArmedOnly) {
  telemetry(kCraft);
  link().disobeyed(now_, "it moves as without thrust");
  EXPECT_EQ(link().current(), State::kDisarmed);
  armed();
  feed(0.1, kDrive);
  EXPECT_EQ(link().sent().thrusters(0), kDrive.thrusters(0));
  link().disobeyed(now_, "it moves as without thrust");
  EXPECT_EQ(link().current(), State::kFault);
  EXPECT_EQ(link().reason(), "the craft does not follow its commands: it moves as without thrust");
  EXPECT_TRUE(lastIs(kZero));
}

TEST_F(GroundLinkTest, ACraftThatLeavesTheRoomIsAFaultAndPreventsArming) {
  telemetry(kCraft);
  link().confine(now_, "the craft is 0.10 m outside of the room");
  EXPECT_EQ(link().current(), State::kDisarmed);
  feed(0.1, kZero);
  EXPECT_EQ(link().arm(now_), "the craft is 0.10 m outside of the room");
  link().confine(now_, "");
  armed();
  feed(0.1, kDrive);
  link().confine(now_, "");
  EXPECT_TRUE(lastIs(kDrive));
  link().confine(now_, "the craft is 0.01 m outside of the room");
  EXPECT_EQ(link().current(), State::kFault);
  EXPECT_EQ(link().reason(), "the craft is 0.01 m outside of the room");
  EXPECT_TRUE(lastIs(kZero));
  link().confine(now_, "");
  feed(0.1, kDrive);
  EXPECT_EQ(link().current(), State::kFault) << "until it is disarmed by hand";
}

TEST_F(GroundLinkTest, StaleCommandsAreAFault) {
  armed();
  command(kDrive);
  const double since = now_;
  while (link().current() == State::kArmed && now_ < since + 1) {
    state();
    wait(0.001);
  }
  EXPECT_NEAR(now_ - since, 0.2, 0.0021);
  EXPECT_EQ(link().reason(), "commands are stale");
  EXPECT_TRUE(lastIs(kZero));  // at once
  EXPECT_NEAR(packets_.back().time, now_, 1e-9);
}

TEST_F(GroundLinkTest, ATimeJumpIsAFaultAndDiscardsStateAndCommand) {
  armed();
  feed(0.1, kDrive);
  link().timeJumped(now_, "time jumped back by 2.0 s");
  EXPECT_EQ(link().current(), State::kFault);
  EXPECT_EQ(link().reason(), "time jumped back by 2.0 s");
  EXPECT_TRUE(lastIs(kZero));
  link().disarm(now_, "by hand");
  EXPECT_EQ(arm(), "there is no state");
  state();
  EXPECT_EQ(arm(), "there is no fresh command");
  command(kZero);
  EXPECT_EQ(arm(), "");
}

TEST_F(GroundLinkTest, StampsFromTheFutureAreRefused) {
  armed();
  feed(0.1, kDrive);
  const double before = now_;
  while (link().current() == State::kArmed && now_ < before + 1) {
    state();
    command(kDrive, "/a", -1.5);
    wait(0.01);
  }
  EXPECT_NEAR(now_ - before, 0.2, 0.011);
  EXPECT_EQ(link().reason(),
            "commands are stale: a command of /a has a stamp from the future: the clocks differ");
  link().disarm(now_, "by hand");
  command(kZero, "/a", -0.1);  // clocks always differ slightly
  state(true, -1.5);
  EXPECT_NE(arm(), "");
  state(true, -0.1);
  EXPECT_EQ(arm(), "");
}

TEST_F(GroundLinkTest, FaultLastsUntilDisarmedByHand) {
  fault();
  packets_.clear();
  feed(1, kDrive);
  feed(1, kZero);
  EXPECT_EQ(link().current(), State::kFault);
  EXPECT_TRUE(allZeroSince(0));
  EXPECT_GE(packets_.size(), 95u);
  EXPECT_EQ(arm(), "in fault (the state is invalid: lost): disarm first");
  link().disarm(now_, "by hand");
  EXPECT_EQ(link().current(), State::kDisarmed);
  feed(0.1, kZero);
  EXPECT_EQ(link().current(), State::kDisarmed);
  telemetry(kCraft);
  EXPECT_EQ(arm(), "");
}

TEST_F(GroundLinkTest, StoppedForGood) {
  armed();
  command(kDrive);
  const std::size_t first = packets_.size();
  link().stop(now_, "the end");
  feed(0.1, kZero);
  EXPECT_EQ(arm(), "the end");
  link().disarm(now_, "by hand");
  EXPECT_EQ(arm(), "the end");
  command(kDrive);
  link().sendZero(now_);
  EXPECT_GT(packets_.size(), first);
  EXPECT_TRUE(allZeroSince(first));
}

TEST_F(GroundLinkTest, FailingToSendIsAFaultWhenItLasts) {
  armed();
  broken_ = "Network is unreachable";
  feed(0.15, kDrive);
  EXPECT_EQ(link().current(), State::kArmed);
  broken_.clear();
  feed(0.1, kDrive);
  broken_ = "Network is unreachable";
  feed(0.15, kDrive);
  EXPECT_EQ(link().current(), State::kArmed);  // the count starts again
  feed(0.1, kDrive);
  EXPECT_EQ(link().current(), State::kFault);
  EXPECT_EQ(link().reason(), "packets cannot be sent: Network is unreachable");
  link().disarm(now_, "by hand");
  feed(0.1, kZero);
  EXPECT_EQ(arm(), "packets cannot be sent: Network is unreachable");
  const auto sent = link().counters().sent;
  EXPECT_EQ(sent, packets_.size());
  broken_.clear();
  feed(0.1, kZero);
  EXPECT_EQ(arm(), "");
}

TEST_F(GroundLinkTest, NoOtherPeerTakesOverWhileArmedOrLater) {
  garbage(kCraft);
  state();
  command(kZero);
  ASSERT_EQ(arm(), "");
  telemetry(kStranger);
  EXPECT_EQ(link().peer(), kCraft);
  link().disarm(now_, "by hand");
  wait(10);
  telemetry(kStranger);
  telemetry(kRestarted);  // a craft that never sent telemetry cannot be known to have gone
  EXPECT_EQ(link().peer(), kCraft);
  EXPECT_EQ(link().counters().foreign, 3u);
}

TEST_F(GroundLinkTest, ARestartedCraftComesBackOnAnotherPort) {
  for (const bool in_fault : {false, true}) {
    make();
    armed();
    if (in_fault) {
      state(false);
    } else {
      link().disarm(now_, "by hand");
    }
    wait(1.9);
    telemetry(kRestarted);
    EXPECT_EQ(link().peer(), kCraft);
    wait(0.2);
    garbage(kRestarted);
    telemetry(kStranger);
    EXPECT_EQ(link().peer(), kCraft);
    telemetry(kRestarted);
    EXPECT_EQ(link().peer(), kRestarted);
    EXPECT_EQ(link().counters().foreign, 3u);
    packets_.clear();
    wait(0.1);
    EXPECT_EQ(packets_.back().to, kRestarted);
    telemetry(kCraft);  // the old port is a stranger now
    EXPECT_EQ(link().peer(), kRestarted);
  }
}

TEST_F(GroundLinkTest, AShortLossOfTheStateIsBridgedWithZeros) {
  GroundLinkParams params;
  params.recovery_time = 0.5;
  make({}, params);
  armed();
  feed(0.1, kDrive);
  EXPECT_EQ(packets_.back().command.thrusters(0), kDrive.thrusters(0));
  // The state becomes invalid while commands continue: zeros at once, and no fault.
  state(false);
  link().tick(now_);
  EXPECT_EQ(packets_.back().command.thrusters(0), 0);
  packets_.clear();
  for (int i = 0; i < 40; ++i) {
    command(kDrive);
    wait(0.01);
  }
  EXPECT_EQ(link().current(), State::kArmed);
  ASSERT_FALSE(packets_.empty());
  for (const Packet& p : packets_) EXPECT_EQ(p.command.thrusters(0) + p.command.thrusters(1), 0);
  // The state returns in time: the craft drives on.
  feed(0.05, kDrive);
  EXPECT_EQ(link().current(), State::kArmed);
  EXPECT_EQ(packets_.back().command.thrusters(0), kDrive.thrusters(0));
  // The next loss may last the whole time again; after that it is a lasting fault.
  state(false);
  for (int i = 0; i < 49; ++i) {
    command(kDrive);
    wait(0.01);
  }
  EXPECT_EQ(link().current(), State::kArmed);
  command(kDrive);
  wait(0.03);
  EXPECT_EQ(link().current(), State::kFault);
  feed(0.1, kDrive);
  EXPECT_EQ(link().current(), State::kFault);
  EXPECT_EQ(packets_.back().command.thrusters(0), 0);
}

/// A command weak enough for a silence.
const MotorCommand kWeak{0.2, 0.2, 0.6};

TEST_F(GroundLinkTest, ASilenceSendsNothingAndThenDisarms) {
  armed();
  feed(0.5, kWeak);
  packets_.clear();
  ASSERT_EQ(link().silence(now_, 1.5), "");
  const double began = now_;
  ASSERT_EQ(packets_.size(), 1u);  // the last packet repeats the command
  EXPECT_TRUE(lastIs(kWeak));
  EXPECT_EQ(link().current(), State::kArmed);
  EXPECT_EQ(link().reason(), "silent: nothing is sent, to see whether the craft stops by itself");
  EXPECT_EQ(link().lift(), kWeak.lift);
  feed(1.49, kDrive);
  EXPECT_EQ(packets_.size(), 1u);
  EXPECT_EQ(link().lift(), kWeak.lift);
  feed(0.02, kDrive);
  ASSERT_GT(packets_.size(), 1u);
  EXPECT_NEAR(packets_[1].time, began + 1.5, 0.0011);
  EXPECT_EQ(link().current(), State::kDisarmed);
  EXPECT_EQ(link().reason(), "disarmed after the silence");
  feed(1, kDrive);
  EXPECT_GE(packets_.size(), 50u);
  EXPECT_TRUE(allZeroSince(1));
}

TEST_F(GroundLinkTest, EveryEndOfASilenceSendsZerosAtOnceAndNeverThrust) {
  GroundLinkParams params;
  params.recovery_time = 0.5;
  const std::vector<std::pair<std::function<void()>, State>> ends = {
      {[this] { link().disarm(now_, "by hand"); }, State::kDisarmed},
      {[this] { link().stop(now_, "the end"); }, State::kDisarmed},
      {[this] { state(false); }, State::kFault},  // a silence is not bridged
      {[this] { link().timeJumped(now_, "time jumped"); }, State::kFault},
      {[this] { now_ += 3; }, State::kDisarmed},  // without a tick
  };
  for (const auto& [end, after] : ends) {
    make({}, params);
    armed();
    feed(0.5, kWeak);
    ASSERT_EQ(link().silence(now_, 2), "");
    feed(0.5, kWeak);
    const std::size_t sent = packets_.size();
    end();
    link().tick(now_);
    EXPECT_EQ(link().current(), after);
    ASSERT_GT(packets_.size(), sent);
    EXPECT_EQ(packets_[sent].time, now_);
    feed(3, kWeak);
    EXPECT_GE(packets_.size(), sent + 140);
    EXPECT_TRUE(allZeroSince(sent));
  }
}

TEST_F(GroundLinkTest, ASilenceIsRefusedWithAReason) {
  telemetry(kCraft);
  feed(0.1, kZero);
  EXPECT_EQ(link().silence(now_, 1), "not armed: not armed yet");
  armed();
  feed(0.1, kWeak);
  for (const double duration : {0.0, -1.0, 2.01, kNan, kInf})
    EXPECT_EQ(link().silence(now_, duration), "a silence must be longer than 0 s and at most 2 s");
  command({0.2, 0.51, 1});
  EXPECT_EQ(link().silence(now_, 1), "the thrust is above 0.5, too much for a craft that may not stop");
  command(kWeak);
  broken_ = "Network is unreachable";
  EXPECT_EQ(link().silence(now_, 1), "packets cannot be sent: Network is unreachable");
  broken_.clear();
  const std::size_t sent = packets_.size();
  feed(0.1, kWeak);
  EXPECT_GT(packets_.size(), sent) << "a silence that was refused has begun";
  EXPECT_EQ(link().silence(now_, 2), "");
  EXPECT_NE(link().silence(now_, 2), "") << "silences would follow each other";
  EXPECT_NE(arm(), "");
  state(false);
  EXPECT_EQ(link().silence(now_, 1), "not armed: the state is invalid: lost");
}

TEST_F(GroundLinkTest, AFixedPeerIsTheOnlyOne) {
  make(kCraft);
  wait(0.1);
  EXPECT_EQ(packets_.back().to, kCraft);  // it need not send first
  garbage(kStranger);
  telemetry(kStranger);
  wait(5);
  telemetry(kRestarted);
  EXPECT_EQ(link().peer(), kCraft);
  EXPECT_EQ(link().counters().foreign, 3u);
  telemetry(kCraft);
  EXPECT_EQ(link().counters().received, 1u);
}

/// A link to a craft with three thrusters, the second of which goes backwards.
class LinkOfAnyThrusters : public testing::Test {
 protected:
  LinkOfAnyThrusters() {
    std::vector<Thruster> thrusters = thrusterPair()->thrusters();
    thrusters[1].least = -1;
    thrusters.push_back(thrusters[0]);
    thrusters[2].name = "bow";
    layout_ = std::make_shared<const ThrusterLayout>(thrusters);
    link_ = std::make_unique<GroundLink>(
        GroundLinkParams(), kCraft,
        [this](const MotorCommand& command, const UdpAddress&) {
          sent_.push_back(command);
          return std::string();
        },
        layout_);
    command(Inputs::off(3));
    link_->state(0, 0, true);
  }
  void command(const Inputs& inputs) { link_->command(0, 0, "/a", inputs); }

  ThrusterLayoutPtr layout_;
  std::unique_ptr<GroundLink> link_;
  std::vector<Inputs> sent_;
};

TEST_F(LinkOfAnyThrusters, SendsCommandsOfAllThrustersAndZerosToAll) {
  ASSERT_EQ(link_->arm(0), "");
  const Inputs drive(Thrusters<double>{0.5, -0.5, 0.25}, 1);
  command(drive);
  EXPECT_TRUE(sent_.back() == drive);
  link_->tick(1);
  EXPECT_EQ(link_->current(), State::kFault) << "the command is stale";
  link_->sendZero(1);
  EXPECT_TRUE(sent_.back() == Inputs::off(3));
}

}  // namespace ground_link_test
}  // namespace ground
