// Every sequence of events that can happen to a flight, with the parameters of the launch files.
#include <gtest/gtest.h>

#include <iostream>

#include "flight_world.h"

namespace ground {
namespace flight_search {

void searchFlight(lifecycle_search::SearchPilot::Loop loop) {
  const std::vector<std::string> ready = {"telemetry", "start", "stop", "pose", "arm"};
  std::vector<std::string> driving = ready;
  driving.insert(driving.end(), {"start", "1.1 s with poses"});
  Shared shared(loop);
  search::Search<FlightWorld> search([&] { return FlightWorld(shared); }, {{}, ready, driving},
                                     FlightWorld::events(), search::bounds(300000));
  const search::Found found = search.run();
  std::cout << found.text() << "\n";
  EXPECT_EQ(found.violation, "") << found.sequence;
}

TEST(EverySequence, OfAFlight) { searchFlight(lifecycle_search::SearchPilot::Loop::kClosed); }
TEST(EverySequence, OfAFlightInOpenLoop) { searchFlight(lifecycle_search::SearchPilot::Loop::kOpen); }

}  // namespace flight_search
}  // namespace ground
