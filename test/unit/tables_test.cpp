// Parameters in the core's tables and in the .cfg files for dynamic_reconfigure: the same numbers.
#include <gtest/gtest.h>

#include <cctype>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>
#include <string>

#include "ground/control/controllers.h"

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
  const std::regex entry("\"(\\w+)\",\\s*(?:double|int)_t,\\s*0,\\s*\"([^\"]*)\",\\s*([^\\s,]+),"
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

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
