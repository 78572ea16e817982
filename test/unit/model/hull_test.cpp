// Crafts on water, and loads that crafts carry: limits, invariance, energy.
#include <gtest/gtest.h>

#include <random>
#include <string>

#include "../crafts.h"
#include "ground/model/dynamics.h"

namespace ground {
namespace hull_test {

RigidState<double> moving(double u, double v, double r, double psi = 0) {
  RigidState<double> state;
  state.eta << 0.3, -0.2, psi;
  state.nu << u, v, r;
  return state;
}

Vector3<double> accelerationOf(const Dynamics<double>& dynamics, const RigidState<double>& state) {
  return dynamics.derivative(0, state, {0.4, 0.7}, {1.0, std::nullopt}).nu;
}

/// Wrench that an effect adds to the craft, which is not coupled.
Vector3<double> added(const Model& model, const RigidState<double>& state) {
  const Vector3<double> change =
      accelerationOf(Dynamics<double>(model), state) - accelerationOf(Dynamics<double>(tinyWhoover()), state);
  return change.cwiseProduct(Vector3<double>(model.body.m, model.body.m, model.body.I_z));
}

TEST(CrossFlowDrag, IsThatOfAPlateAcrossAndOfATurningBar) {
  Model model = withValues(tinyWhoover(), {{"cross_flow_drag.fore", 0.02}, {"cross_flow_drag.aft", 0.03}});
  model.body.hull_length = 0.2;
  const double half = 0.1, v = -0.4, r = 3;
  const Vector3<double> across = added(model, moving(0.3, v, 0)), turning = added(model, moving(0.3, 0, r));
  EXPECT_NEAR(across.x(), 0, 1e-12);
  EXPECT_NEAR(across.y(), 0.05 * v * v, 1e-12);
  EXPECT_NEAR(across.z(), -0.01 * half / 2 * v * v, 1e-12);
  EXPECT_NEAR(turning.y(), 0.01 * half * half * r * r / 3, 1e-12);
  EXPECT_NEAR(turning.z(), -0.05 * half * half * half * r * r / 4, 1e-12);
}

TEST(CrossFlowDrag, TakesEnergyFromEveryMotion) {
  const Model model = withValues(tinyWhoover(), {{"cross_flow_drag.fore", 0.02}, {"cross_flow_drag.aft", 0}});
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int trial = 0; trial < 200; ++trial) {
    const RigidState<double> state = moving(uniform(random), uniform(random), 10 * uniform(random));
    EXPECT_LT(added(model, state).dot(state.nu), 1e-12);
  }
}

/// In a frame that moves with the water, a craft moves as it does in water at rest.
TEST(Current, CarriesTheCraftAsAMovingFrameDoes) {
  const Model still = withValues(tinyWhoover(), {{"added_mass.mx", 0.01},
                                                 {"added_mass.my", 0.05},
                                                 {"com_offset.xg", 0.006},
                                                 {"com_offset.yg", -0.004},
                                                 {"quadratic_drag.cx", 0.02},
                                                 {"quadratic_drag.cy", 0.05},
                                                 {"quadratic_drag.cr", 1e-5},
                                                 {"hull_lift.yv", 0.03},
                                                 {"hull_lift.yr", -0.002},
                                                 {"hull_lift.nv", 0.001},
                                                 {"hull_lift.nr", 2e-4}});
  const Vector2<double> water(0.3, -0.5);
  const Model carried = withValues(still, {{"current.wx", water.x()}, {"current.wy", water.y()}});
  const Model blown = withValues(still, {{"wind.wx", water.x()}, {"wind.wy", water.y()}});
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-1, 1);
  double air = 0;
  for (int trial = 0; trial < 50; ++trial) {
    const double r = 3 * uniform(random), psi = 3 * uniform(random);
    const RigidState<double> over_ground = moving(uniform(random), uniform(random), r, psi);
    const Vector2<double> w = worldToBody<double>(psi, water);
    RigidState<double> through_water = over_ground;
    through_water.nu.head<2>() -= w;
    const Vector3<double> wanted =
        accelerationOf(Dynamics<double>(still), through_water) + Vector3<double>(r * w.y(), -r * w.x(), 0);
    EXPECT_LT((accelerationOf(Dynamics<double>(carried), over_ground) - wanted).norm(), 1e-9);
    air += (accelerationOf(Dynamics<double>(blown), over_ground) - wanted).norm();
  }
  EXPECT_GT(air, 1) << "wind does not move the added mass";
}

TEST(PayloadOf, ACraftActsAsAHeavierCraftWithAnotherCentre) {
  const Payload payload{0.03, {0.02, -0.01}, 2e-5};
  const Model light = withValues(tinyWhoover(), {{"floor_tilt.sx", 0.02}, {"floor_tilt.sy", -0.01}});
  const double m = light.body.m, all = m + payload.mass;
  const Vector2<double> centre = payload.mass * payload.place / all;
  Model heavy = withValues(light, {{"com_offset.xg", centre.x()}, {"com_offset.yg", centre.y()}});
  heavy.body.m = all;
  heavy.body.I_z +=
      payload.inertia + m * centre.squaredNorm() + payload.mass * (payload.place - centre).squaredNorm();
  const RigidState<double> state = moving(0.4, -0.3, 5, 0.7);
  const Dynamics<double> loaded(light, payload);
  EXPECT_LT((accelerationOf(loaded, state) - accelerationOf(Dynamics<double>(heavy), state)).norm(), 1e-10);
  EXPECT_EQ(loaded.body().m, all);
  EXPECT_EQ(accelerationOf(Dynamics<double>(light, Payload()), state),
            accelerationOf(Dynamics<double>(light), state));
}

TEST(Hull, IsReadAndWrittenAndMustHaveALength) {
  Model model = tinyWhoover();
  EXPECT_EQ(formatModel(model).find("hull"), std::string::npos);
  model.body.hull_length = 7;
  const std::string text = formatModel(model);
  EXPECT_EQ(parseModel(text, "again").body.hull_length, 7);
  std::string wrong = text;
  wrong.replace(wrong.find("length: 7"), 9, "length: 0");
  const std::string said = refusal([&] { parseModel(wrong, "a file"); });
  EXPECT_NE(said.find("length"), std::string::npos) << said;
  EXPECT_NE(said.find("line"), std::string::npos) << said;
}

TEST(Surroundings, AreKnownOfEachEffect) {
  const auto of = [](const char* name) { return std::string(nameOf(makeEffect(name)->info().surroundings)); };
  EXPECT_EQ(of("skirt_friction"), "lift");
  EXPECT_EQ(of("floor_tilt"), "floor");
  EXPECT_EQ(of("current"), "water");
  EXPECT_EQ(of("added_mass"), "any");
}

}  // namespace hull_test
}  // namespace ground
