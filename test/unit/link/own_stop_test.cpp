// The remark at arming on whether the craft has been shown to stop by itself.
#include "ground/link/own_stop.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <string>

namespace ground {
namespace own_stop_test {

const std::string kUnproven = "it is not proven that this craft stops by itself (rosrun ground prove_stop)";

class OwnStopTest : public testing::Test {
 protected:
  void TearDown() override { std::remove(path_.c_str()); }
  std::string remark(const std::string& text) {
    std::ofstream(path_) << text;
    return ownStopRemark(path_, "Tiny Whoover");
  }
  static std::string trial(const std::string& outcome, const std::string& simulated = "false") {
    return "- {date: '2026-01-02T03:04:05', outcome: " + outcome + ", simulated: " + simulated +
           ", stopped_after: 0.2}\n";
  }

  const std::string path_ = testing::TempDir() + "own_stop_" + std::to_string(getpid()) + ".yaml";
};

TEST_F(OwnStopTest, IsUnprovenWithoutATrialOfThisCraft) {
  EXPECT_EQ(ownStopRemark(path_, "Tiny Whoover"), kUnproven);
  EXPECT_EQ(ownStopRemark("/", "Tiny Whoover"), kUnproven);
  for (const char* text : {"", "{}", "[]", "3", "Tiny Whoover: 3", "Tiny Whoover: [3]", "a: [",
                           "Tiny Whoover: [{outcome: passed}]"})
    EXPECT_EQ(remark(text), kUnproven) << text;
  EXPECT_EQ(remark("Another:\n" + trial("passed")), kUnproven);
}

TEST_F(OwnStopTest, UsesTheNewestDecidedTrialOfTheRealCraft) {
  const std::string craft = "Tiny Whoover:\n";
  const std::string failed =
      "this craft FAILED to stop by itself on 2026-01-02T03:04:05 "
      "(rosrun ground prove_stop)";
  EXPECT_EQ(remark(craft + trial("passed")), "");
  EXPECT_EQ(remark(craft + trial("failed")), failed);
  EXPECT_EQ(remark(craft + trial("passed") + trial("failed")), failed);
  EXPECT_EQ(remark(craft + trial("failed") + trial("passed")), "");
  EXPECT_EQ(remark(craft + trial("passed") + trial("undecided")), "");
  EXPECT_EQ(remark(craft + trial("undecided")), kUnproven);
  EXPECT_EQ(remark(craft + trial("passed", "true")), kUnproven);
  EXPECT_EQ(remark(craft + trial("passed") + trial("failed", "true")), "");
}

}  // namespace own_stop_test
}  // namespace ground
