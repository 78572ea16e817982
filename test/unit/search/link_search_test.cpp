// Every sequence of events that can happen to the link: no promise is broken.
#include <gtest/gtest.h>

#include <iostream>

#include "link_world.h"

namespace ground {
namespace search {

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

std::vector<int> named(const std::vector<std::string>& names) {
  std::vector<int> result;
  for (const std::string& name : names) result.push_back(LinkWorld::event(name));
  return result;
}

void searchLink(const GroundLinkParams& params) {
  const std::vector<std::string> armed = {"telemetry", "state", "zero command", "arm", "command"};
  std::vector<std::string> silent = armed, lost = armed, fault = armed, counting = armed;
  silent.push_back("silence of 0.5 s");
  lost.push_back("invalid state");
  fault.push_back("clock set");
  counting.push_back("telemetry with a new count");
  const std::vector<std::string> bench = {"hello", "zero command", "arm", "command"};
  Wire wire;
  Search<LinkWorld> search([&] { return LinkWorld(params, wire); },
                           {{}, named(armed), named(silent), named(lost), named(fault), named(counting), named(bench)},
                           bounds(120000));
  const Found found = search.run();
  std::cout << "link: " << found.text() << "\n";
  EXPECT_EQ(found.violation, "") << found.sequence;
}

TEST(EverySequence, LinkWithRecovery) { searchLink(linkParams(0.25)); }
TEST(EverySequence, LinkWithoutRecovery) { searchLink(linkParams(0)); }
TEST(EverySequence, LinkOnTheBench) {
  GroundLinkParams params = linkParams(0.25);
  params.require_state = params.require_lift = false;
  searchLink(params);
}

}  // namespace search
}  // namespace ground
