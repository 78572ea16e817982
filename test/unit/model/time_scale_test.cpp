// The time scale of a craft: how long full thrust takes to move or turn it.
#include <gtest/gtest.h>

#include "ground/model/capability.h"
#include "ground/model/model_file.h"

namespace ground {
namespace time_scale_test {

TEST(TimeScale, GrowsWithTheCraft) {
  EXPECT_EQ(timeScale(loadModel("cfg/hovercraft/tiny_whoover.yaml")), 1);
  EXPECT_EQ(timeScale(loadModel("cfg/craft/free_flyer.yaml")), 5);
  EXPECT_EQ(timeScale(loadModel("cfg/craft/propeller_ship.yaml")), 20);
}

TEST(TimeScale, OfASlowedCraftIsSlowed) {
  for (const char* file : {"cfg/hovercraft/tiny_whoover.yaml", "cfg/craft/one_fan_rudder.yaml"}) {
    Model model = loadModel(file);
    const double before = timeScale(model);
    model.setValue("k", model.value("k") / 1e4);
    for (const char* damping : {"X_u", "Y_v", "N_r"}) model.setValue(damping, model.value(damping) / 100);
    EXPECT_DOUBLE_EQ(timeScale(model), 100 * before) << file;
  }
}

TEST(TimeScale, IsRounded) {
  EXPECT_DOUBLE_EQ(roundedTime(0.9), 1);
  EXPECT_DOUBLE_EQ(roundedTime(3), 2);
  EXPECT_DOUBLE_EQ(roundedTime(3.5), 5);
  EXPECT_DOUBLE_EQ(roundedTime(0.08), 0.1);
}

}  // namespace time_scale_test
}  // namespace ground
