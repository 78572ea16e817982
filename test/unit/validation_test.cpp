// Ranges of parameters: what a refusal says is what is refused.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <regex>
#include <string>
#include <vector>

#include "ground/control/excitation_pilot.h"
#include "ground/control/input_design.h"
#include "ground/estimation/model_monitor.h"
#include "ground/link/ground_link.h"
#include "ground/simulation/experiment.h"
#include "ground/simulation/simulated_lab.h"

namespace ground {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
const std::vector<double> kNever = {std::nan(""), kInfinity, -kInfinity};

/// The message for a value of a field.
template <class Params, class Owner, class Field>
std::string refusal(Params params, Field Owner::*field, double value) {
  params.*field = static_cast<Field>(value);
  return params.validate();
}

/// The range in a refusal is the one that is accepted, both ends included.
template <class Params, class Owner>
void expectRange(const Params& params, double Owner::*field) {
  const std::string message = refusal(params, field, 1e9);
  std::smatch range;
  ASSERT_TRUE(std::regex_search(message, range, std::regex("between ([0-9.]+) and ([0-9.]+)"))) << message;
  const double low = std::stod(range[1]), high = std::stod(range[2]), nearly = 1e-6 * high;
  EXPECT_LT(low, high);
  for (const double good : {low, low + nearly, 0.5 * (low + high), high})
    EXPECT_EQ(refusal(params, field, good), "") << good;
  std::vector<double> bad = {low - nearly, high + nearly};
  bad.insert(bad.end(), kNever.begin(), kNever.end());
  for (const double value : bad) EXPECT_EQ(refusal(params, field, value), message) << value;
}

template <class Params, class Owner>
void expectPositive(const Params& params, double Owner::*field, bool zero = false) {
  for (const double good : {1e-3, 1.0, 1e6}) EXPECT_EQ(refusal(params, field, good), "") << good;
  EXPECT_EQ(refusal(params, field, 0).empty(), zero);
  EXPECT_NE(refusal(params, field, -1e-3), "");
  for (const double bad : kNever) EXPECT_NE(refusal(params, field, bad), "") << bad;
}

TEST(Ranges, AreThoseOfTheMessages) {
  for (double Room::*field : {&Room::braking, &Room::latency}) expectRange(Room(), field);
  Room hall;  // a margin has to leave space
  hall.corners = {{-200, -200}, {200, -200}, {200, 200}, {-200, 200}};
  expectRange(hall, &Room::margin);
  using L = LifecycleParams;
  for (double L::*field : {&L::lift, &L::lift_time, &L::state_timeout, &L::recovery_time, &L::rate})
    expectRange(L(), field);
  using M = MocapParams;
  for (double M::*field :
       {&M::rate, &M::position_noise, &M::heading_noise, &M::latency, &M::loss, &M::gap_rate, &M::gap_length})
    expectRange(M(), field);
  for (double DesignParams::*field : {&DesignParams::clock, &DesignParams::hold})
    expectRange(DesignParams(), field);
  for (double ReturnParams::*field : {&ReturnParams::burst, &ReturnParams::arrival})
    expectRange(ReturnParams(), field);
  for (double DriveParams::*field : {&DriveParams::start, &DriveParams::tail})
    expectRange(DriveParams(), field);
}

TEST(Ranges, OfWholeNumbersIncludeTheirEnds) {
  for (const int order : {2, 20}) EXPECT_EQ(refusal(DesignParams(), &DesignParams::order, order), "");
  for (const int order : {1, 21})
    EXPECT_EQ(refusal(DesignParams(), &DesignParams::order, order), "order must be between 2 and 20");
  for (const int rows : {0, 1, 1000})
    EXPECT_EQ(refusal(DesignParams(), &DesignParams::rows_per_bit, rows), "");
  EXPECT_NE(refusal(DesignParams(), &DesignParams::rows_per_bit, -1), "");
  for (const int median : {1, 3, 101})
    EXPECT_EQ(refusal(EstimatorParams(), &EstimatorParams::median, median), "");
  for (const int median : {-1, 0, 2, 100, 103})
    EXPECT_EQ(refusal(EstimatorParams(), &EstimatorParams::median, median), "median must be odd, 1 to 101");
}

TEST(Ranges, OpenOnesAreWithoutZero) {
  using E = EstimatorParams;
  for (double E::*field :
       {&E::position_noise, &E::heading_noise, &E::max_gap, &E::linear_jerk, &E::angular_jerk})
    expectPositive(E(), field);
  expectPositive(E(), &E::stamp_noise, true);
  EXPECT_EQ(refusal(E(), &E::gate, 1), "");
  EXPECT_NE(refusal(E(), &E::gate, 0.999), "");
  using G = GroundLinkParams;
  for (double G::*field :
       {&G::command_timeout, &G::state_timeout, &G::keepalive_rate, &G::peer_timeout, &G::send_timeout})
    expectPositive(G(), field);
  for (double G::*field : {&G::recovery_time, &G::craft_timeout}) expectPositive(G(), field, true);
  for (const double good : {0.0, 0.5, 3.0, 10.0})
    EXPECT_EQ(refusal(G(), &G::obedience_timeout, good), "") << good;
  for (const double bad : {-1.0, 0.1, 0.499, 10.01, std::nan("")})
    EXPECT_NE(refusal(G(), &G::obedience_timeout, bad), "") << bad;
  expectPositive(DriveParams(), &DriveParams::duration);
  TrackingParams tracking;
  for (const double good : {0.0, 0.3, kInfinity})
    EXPECT_EQ(refusal(tracking, &TrackingParams::max_error, good), "") << good;
  for (const double bad : {-0.1, std::nan("")})
    EXPECT_NE(refusal(tracking, &TrackingParams::max_error, bad), "") << bad;
  MonitorParams monitor;
  EXPECT_EQ(refusal(monitor, &MonitorParams::window, monitor.horizon), "");
  EXPECT_NE(refusal(monitor, &MonitorParams::window, 0.99 * monitor.horizon), "");
  for (const double bad : {0.0, -1.0, std::nan("")})
    EXPECT_NE(refusal(monitor, &MonitorParams::horizon, bad), "") << bad;
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
