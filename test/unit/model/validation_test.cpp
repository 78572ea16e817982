// Ranges of parameters: what a refusal says is what is refused.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>

#include "ground/control/controllers.h"
#include "ground/control/excitation_pilot.h"
#include "ground/estimation/model_monitor.h"
#include "ground/safety/ground_link.h"
#include "ground/simulation/experiment.h"

namespace ground {
namespace validation_test {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The defaults are valid; each number is accepted from one end of its range to the other.
template <class Params, class Table>
void expectRanges(const Params& standard, const Table& table) {
  EXPECT_EQ(standard.validate(), "");
  for (const auto& one : table) {
    if (one.type != "double" && one.type != "int") continue;
    const auto refusal = [&](double value) {
      Params params = standard;
      one.set(params, value);
      return params.validate();
    };
    EXPECT_LT(one.low, one.high) << one.name;
    EXPECT_EQ(refusal(one.low) + refusal(one.high), "") << one.name;
    EXPECT_EQ(refusal(one.high + 1).rfind(one.name + " must be between ", 0), 0u) << refusal(one.high + 1);
    EXPECT_NE(refusal(one.low - 1), "") << one.name;
    if (one.type == "int") continue;
    for (const double bad : {std::nan(""), kInfinity, -kInfinity}) EXPECT_NE(refusal(bad), "") << one.name;
  }
}

TEST(Ranges, AreThoseOfTheDescriptions) {
  expectRanges(LifecycleParams(), LifecycleParams::table());
  expectRanges(EstimatorParams(), EstimatorParams::table());
  expectRanges(GroundLinkParams(), GroundLinkParams::table());
  expectRanges(MocapParams(), MocapParams::table());
  expectRanges(PrbsParams(), PrbsParams::table());
  expectRanges(TrackingGains(), TrackingGains::table());
  expectRanges(PredictiveParams(), PredictiveParams::table());
}

/// The message for a value of a field.
template <class Params, class Owner>
std::string refusal(Params params, double Owner::*field, double value) {
  params.*field = value;
  return params.validate();
}

TEST(Ranges, OfExperimentsAndDesigns) {
  for (double DesignParams::*field : {&DesignParams::clock, &DesignParams::hold})
    EXPECT_NE(refusal(DesignParams(), field, 1e9), "");
  EXPECT_NE(refusal(ReturnParams(), &ReturnParams::burst, 1e9), "");
  for (double DriveParams::*field : {&DriveParams::start, &DriveParams::tail, &DriveParams::duration})
    EXPECT_NE(refusal(DriveParams(), field, -1), "");
  EXPECT_EQ(refusal(MonitorParams(), &MonitorParams::window, MonitorParams().horizon), "");
  EXPECT_NE(refusal(MonitorParams(), &MonitorParams::window, 0.99 * MonitorParams().horizon), "");
}

}  // namespace validation_test
}  // namespace ground
