// Parameters in the core's tables and in the .cfg files for dynamic_reconfigure: the same numbers.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "ground/control/controllers.h"
#include "ground/control/excitation_pilot.h"
#include "ground/estimation/model_monitor.h"
#include "ground/link/ground_link.h"
#include "ground/simulation/experiment.h"
#include "ground/simulation/simulated_lab.h"

namespace ground {
namespace {

/// What a .cfg file says of a number.
struct Configured {
  std::string text, standard;
  double low = 0, high = 0;
};

/// All numbers that the files in cfg add, by their names.
std::map<std::string, Configured> configured(const std::vector<std::string>& files) {
  std::string all;
  for (const std::string& file : files) {
    std::ifstream stream("cfg/" + file);
    EXPECT_TRUE(stream) << file;
    std::stringstream text;
    text << stream.rdbuf();
    all += text.str();
  }
  const std::regex entry(
      "\"(\\w+)\",\\s*(?:double|int)_t,\\s*0,\\s*\"([^\"]*)\",\\s*([^\\s,]+),"
      "\\s*([^\\s,]+),\\s*([^\\s,)]+),?\\s*\\)");
  std::map<std::string, Configured> found;
  for (std::sregex_iterator at(all.begin(), all.end(), entry), end; at != end; ++at)
    found[at->str(1)] = {at->str(2), at->str(3), std::stod(at->str(4)), std::stod(at->str(5))};
  return found;
}

template <class Infos>
int numbersThatAgree(const Infos& infos, const std::map<std::string, Configured>& wanted) {
  int numbers = 0;
  for (const auto& info : infos) {
    const auto at = wanted.find(info.name);
    if (at == wanted.end() || (info.type != "double" && info.type != "int")) continue;
    ++numbers;
    EXPECT_EQ(info.low, at->second.low) << info.name;
    EXPECT_EQ(info.high, at->second.high) << info.name;
    const std::string& standard = at->second.standard;  // some are the name of a variable
    if (std::isalpha(standard[0]) == 0) {
      EXPECT_EQ(std::get<double>(info.standard), std::stod(standard)) << info.name;
    }
    EXPECT_EQ(info.text + " [" + info.unit + "]", at->second.text);
  }
  return numbers;
}

TEST(Tables, AgreeWithTheFilesForDynamicReconfigure) {
  EXPECT_EQ(numbersThatAgree(TrackingGains::table(), configured({"TrajectoryTracking.cfg"})), 6);
  EXPECT_EQ(numbersThatAgree(PredictiveParams::table(),
                             configured({"ModelPredictive.cfg", "observer_parameters.py"})),
            17);
  EXPECT_EQ(numbersThatAgree(ReferenceParams::table(), configured({"tracking_parameters.py"})), 8);
  EXPECT_GE(numbersThatAgree(PrbsParams::table(), configured({"OpenLoopPRBS.cfg"})), 3);
}

/// Numbers of the core and the names that they have in a file.
using Defaults = std::vector<std::pair<std::string, double>>;

void expectDefaults(const std::vector<std::string>& files, const Defaults& defaults) {
  const std::map<std::string, Configured> wanted = configured(files);
  for (const auto& [name, value] : defaults) {
    ASSERT_EQ(wanted.count(name), 1u) << name;
    EXPECT_EQ(value, std::stod(wanted.at(name).standard)) << files[0] << ' ' << name;
  }
}

TEST(Tables, DefaultsOfTheCoreAreThoseOfItsNodes) {
  const EstimatorParams estimator;
  expectDefaults({"MocapState.cfg"}, {{"max_gap", estimator.max_gap},
                                      {"position_noise", estimator.position_noise},
                                      {"heading_noise", estimator.heading_noise},
                                      {"stamp_noise", estimator.stamp_noise},
                                      {"gate", estimator.gate},
                                      {"linear_jerk", estimator.linear_jerk},
                                      {"angular_jerk", estimator.angular_jerk},
                                      {"median", estimator.median}});
  const MocapParams mocap;
  expectDefaults({"Simulator.cfg"}, {{"position_noise", mocap.position_noise},
                                     {"heading_noise", mocap.heading_noise},
                                     {"latency", mocap.latency},
                                     {"loss", mocap.loss},
                                     {"gap_rate", mocap.gap_rate},
                                     {"gap_length", mocap.gap_length},
                                     {"watchdog", SimulatedLab::Params().watchdog}});
  const GroundLinkParams link;
  expectDefaults({"Sender.cfg"}, {{"command_timeout", link.command_timeout},
                                  {"state_timeout", link.state_timeout},
                                  {"recovery_time", link.recovery_time},
                                  {"craft_timeout", link.craft_timeout},
                                  {"obedience_timeout", link.obedience_timeout},
                                  {"keepalive_rate", link.keepalive_rate}});
  const MonitorParams monitor;
  expectDefaults({"LiveComparison.cfg"}, {{"horizon", monitor.horizon}, {"window", monitor.window}});
  const PrbsParams prbs;
  expectDefaults({"OpenLoopPRBS.cfg"}, {{"clock", prbs.clock},
                                        {"duration", prbs.duration},
                                        {"left_low", prbs.left_low},
                                        {"left_high", prbs.left_high},
                                        {"right_low", prbs.right_low},
                                        {"right_high", prbs.right_high}});
  const DesignParams design;
  const ReturnParams returns;
  expectDefaults({"Excitation.cfg"}, {{"clock", design.clock},
                                      {"order", design.order},
                                      {"seed", static_cast<double>(design.seed)},
                                      {"hold", design.hold},
                                      {"rows_per_bit", design.rows_per_bit},
                                      {"burst", returns.burst},
                                      {"arrival", returns.arrival}});
  const DriveParams drive;
  for (const char* file : {"Excitation.cfg", "tracking_parameters.py"})
    expectDefaults({file}, {{"rate", drive.life.rate},
                            {"lift", drive.life.lift},
                            {"lift_time", drive.life.lift_time},
                            {"state_timeout", drive.life.state_timeout},
                            {"recovery_time", drive.life.recovery_time}});
  expectDefaults({"Excitation.cfg"}, {{"duration", drive.duration}});
  const LifecycleParams life;
  expectDefaults({"OpenLoopPRBS.cfg"},
                 {{"lift", life.lift}, {"lift_time", life.lift_time}, {"state_timeout", life.state_timeout}});
  EXPECT_EQ(life.rate, drive.life.rate);
  const Room plain, room = loadRoom("cfg/room/room_4x4.yaml");
  EXPECT_EQ(plain.corners, room.corners);
  EXPECT_EQ(plain.home, room.home);
  EXPECT_EQ(plain.margin, room.margin);
  EXPECT_EQ(plain.braking, room.braking);
  EXPECT_EQ(plain.latency, room.latency);
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
