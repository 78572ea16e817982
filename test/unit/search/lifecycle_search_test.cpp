// Every sequence of events that can happen to a controller's life cycle: no promise is broken.
#include <gtest/gtest.h>

#include <iostream>

#include "lifecycle_world.h"

namespace ground {
namespace lifecycle_search {

void searchLifecycle(SearchPilot::Loop loop, double recovery, bool require = true,
                     const std::vector<std::string>& events = LifecycleWorld::events()) {
  LifecycleParams params;
  params.rate = 64;
  params.lift_time = 0.5;
  params.state_timeout = 205 * kTick;
  params.recovery_time = recovery;
  params.require_state = params.require_armed = require;
  SearchPilot pilot(loop);
  const std::vector<std::string> lifting = {"start", "the sender is armed", "state", "5 ms pass"};
  std::vector<std::string> running = lifting;
  for (int i = 0; i < 2; ++i) running.push_back("with states, until just after a limit");
  std::vector<std::string> lost = running;
  lost.push_back("invalid state");
  search::Search<LifecycleWorld> search([&] { return LifecycleWorld(params, pilot); },
                                        {{}, lifting, running, lost}, events, search::bounds(400000));
  const search::Found found = search.run();
  std::cout << found.text() << "\n";
  EXPECT_EQ(found.violation, "") << found.sequence;
}

TEST(EverySequence, OfALifecycleClosedLoop) { searchLifecycle(SearchPilot::Loop::kClosed, 0.25); }
TEST(EverySequence, OfALifecycleClosedLoopWithoutRecovery) { searchLifecycle(SearchPilot::Loop::kClosed, 0); }
TEST(EverySequence, OfALifecycleOpenLoop) { searchLifecycle(SearchPilot::Loop::kOpen, 0.25); }
TEST(EverySequence, OfALifecycleOpenLoopOnTheBench) {
  searchLifecycle(SearchPilot::Loop::kOpen, 0.25, false);
}
TEST(EverySequence, OfALifecycleOpenThenClosedLoopOnTheBench) {
  searchLifecycle(SearchPilot::Loop::kOpenThenClosed, 0.25, false);
}
TEST(EverySequence, OfALifecycleOpenThenClosedLoop) {
  searchLifecycle(SearchPilot::Loop::kOpenThenClosed, 0.25);
}

TEST(LongSequences, OfALifecycle) {
  searchLifecycle(SearchPilot::Loop::kClosed, 0.25, true,
                  {"state", "invalid state", "start", "stop", "the sender is armed",
                   "the sender is not armed", "another controller drives", "until just before a limit",
                   "until a limit", "until just after a limit", "with states, until a limit"});
}

}  // namespace lifecycle_search
}  // namespace ground
