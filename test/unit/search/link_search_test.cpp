// Every sequence of events that can happen to the link: no promise is broken.
#include <gtest/gtest.h>

#include <iostream>
#include <memory>

#include "link_world.h"

namespace ground {
namespace link_search {
namespace {

using Names = std::vector<std::string>;

constexpr std::uint32_t kCraftHost = 0x0a000002;
const Names kReady = {"telemetry", "state", "zero command"};
const Names kArmed = {"telemetry", "state", "zero command", "arm", "command"};
const Names kTimes = {"until just before a limit", "until a limit", "until just after a limit"};

Names operator+(Names a, const Names& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

/// Timeouts that are all different, and multiples of a tick.
GroundLinkParams linkParams(double recovery) {
  GroundLinkParams params;
  params.state_timeout = 205 * kTick;
  params.command_timeout = 204 * kTick;
  params.recovery_time = recovery;
  params.craft_timeout = 1;
  params.obedience_timeout = 0.5;
  params.keepalive_rate = 64;
  return params;
}

void searchLink(const GroundLinkParams& params, const std::vector<Names>& roots, const Names& events,
                std::uint64_t transitions, const UdpAddress& craft = {},
                const ThrusterLayoutPtr& layout = thrusterPair()) {
  Wire wire;
  search::Search<LinkWorld> search([&] { return LinkWorld(params, wire, craft, layout); }, roots, events,
                                   search::bounds(transitions));
  const search::Found found = search.run();
  std::cout << found.text() << "\n";
  EXPECT_EQ(found.violation, "") << found.sequence;
}

void searchAll(const GroundLinkParams& params) {
  searchLink(params,
             {{},
              kReady,
              kArmed,
              kArmed + Names{"silence of 0.5 s"},
              kArmed + Names{"invalid state"},
              kArmed + Names{"clock set"},
              kArmed + Names{"telemetry with a new count"},
              kArmed + Names{"telemetry with a boot id"},
              {"hello", "zero command", "arm", "command"}},
             LinkWorld::events(), 400000);
}

}  // namespace

TEST(EverySequence, OfALinkWithRecovery) { searchAll(linkParams(0.25)); }
TEST(EverySequence, OfALinkWithoutRecovery) { searchAll(linkParams(0)); }
TEST(EverySequence, OfALinkOnTheBench) {
  GroundLinkParams params = linkParams(0.25);
  params.require_state = params.require_lift = false;
  searchAll(params);
}

TEST(EverySequence, OfALinkToACraftOfFixedAddress) {
  const Names peers = {"hello", "hello of a stranger", "telemetry", "telemetry of the other port",
                       "telemetry of a stranger"};
  const Names events =
      peers + kTimes + Names{"state", "zero command", "arm", "disarm", "nobody calls for 3 s"};
  for (const std::uint16_t port : {0, 4000})
    searchLink(linkParams(0.25), {{}, {"state", "zero command"}}, events, 100000, {kCraftHost, port});
}

TEST(EverySequence, OfALinkToACraftOfThreeThrusters) {
  std::vector<Thruster> thrusters = thrusterPair()->thrusters();
  thrusters.push_back(thrusters.front());
  thrusters.back().name = "bow";
  searchLink(linkParams(0.25), {{}, kArmed}, LinkWorld::events(), 50000, {},
             std::make_shared<const ThrusterLayout>(thrusters));
}

// Fewer kinds of events, and so longer sequences.
TEST(LongSequences, OfStates) {
  searchLink(
      linkParams(0.25), {kReady, kArmed},
      kTimes + Names{"state", "invalid state", "old state", "zero command", "command", "arm", "disarm"},
      400000);
}
TEST(LongSequences, OfPublishers) {
  searchLink(linkParams(0), {kReady, kArmed},
             kTimes + Names{"state", "zero command", "command", "command of NaN", "zero command of another",
                            "command of another", "arm", "disarm"},
             400000);
}
TEST(LongSequences, OfTheCraft) {
  searchLink(
      linkParams(0.25), {{"state", "zero command"}, kArmed},
      {"hello", "telemetry", "telemetry with a new count", "telemetry with the same count",
       "telemetry with a lower count", "telemetry with a boot id",
       "telemetry of a restarted craft with a boot id", "telemetry of the other port",
       "telemetry of a stranger", "state", "zero command", "arm", "disarm",
       "driving, until just before a limit", "driving, until a limit", "driving, until just after a limit",
       "driving, the count stands still until just after its limit"},
      400000);
}
TEST(LongSequences, OfEnds) {
  searchLink(linkParams(0.25), {kReady, kArmed},
             {"state", "zero command", "command", "arm", "disarm", "end", "silence of 0.5 s", "clock set",
              "packets cannot be sent", "packets can be sent", "the craft leaves the room",
              "the craft is in the room", "until a limit", "driving, until just before a limit",
              "driving, until a limit", "driving, until just after a limit"},
             400000);
}

}  // namespace link_search
}  // namespace ground
