// Simulations in lanes agree with single simulations, for every effect and every derivative.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "ground/model/effect_registry.h"
#include "ground/model/expression_effect.h"
#include "ground/model/lane_simulation.h"
#include "ground/model/learned_wrench.h"
#include "ground/model/model_file.h"

namespace ground {
namespace {

/// Commands and samples of one lane at random times, different for each seed.
struct Run {
  InputSequence inputs;
  std::vector<double> samples;
  RigidState<double> start;

  explicit Run(unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0, 1);
    double t = -1 + uniform(random);
    for (int i = 0; i < 25 + static_cast<int>(seed % 7); ++i) {
      const bool off = i % 6 == 5;
      inputs.add(t, off ? 0 : uniform(random), off ? 0 : uniform(random), uniform(random));
      t += 0.12 * uniform(random);
    }
    t = 0.1 * uniform(random);
    const int count = 12 + static_cast<int>(5 * uniform(random));
    while (static_cast<int>(samples.size()) < count)
      samples.push_back(t += 0.002 + 0.03 * uniform(random));
    start.eta = {uniform(random), uniform(random), 6 * uniform(random)};
    start.nu = {uniform(random), uniform(random) - 0.5, 4 * uniform(random) - 2};
  }
};

EffectPtr made(const std::string& name) {
  ParameterInfo c;
  c.name = "c";
  if (name == "expression")
    return makeExpressionEffect({name, "c*sin(psi)*u_L", "c*u^2*x*lift", "c*r*t", {c}, {1e-3}});
  if (name == "world") {
    ExpressionDefinition definition{name, "c*x", "-c*y*u", "", {c}, {1e-2}};
    definition.world = true;
    return makeExpressionEffect(definition);
  }
  if (name == "memory")
    return makeExpressionEffect({name, "c*p", "c*q*v", "", {c}, {1e-2}, "-c*p*u_L", "",
                                 {{"p", "(lift*u_L + u + 0.1*t - p)/0.1", 0.2},
                                  {"q", "p - 3*q + 0.1*x + sin(psi)", 0}}});
  if (name == "learned") {
    LearnedTerm place{{"x", "psi", "u"}, {0.5, 1, 0.4}, true, Eigen::MatrixXd(11, 3), {}};
    LearnedTerm input{{"u_L", "t"}, {0.4, 1}, false, Eigen::MatrixXd(11, 2), {}};
    for (LearnedTerm* term : {&place, &input})
      for (int i = 0; i < 11; ++i) {
        for (int j = 0; j < term->centres.cols(); ++j) term->centres(i, j) = std::sin(i + 4 * j);
        for (auto& weights : term->weights) weights.push_back(1e-3 * std::cos(i));
      }
    return makeLearnedWrench({name, {place, input}});
  }
  return makeEffect(name);
}

Model craftWith(const std::vector<std::string>& effects) {
  Model model = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  for (const std::string& name : effects) {
    model.addEffect(made(name));
    const std::vector<double> before = model.coordinates();
    const auto infos = model.parameters();
    std::vector<double> values = model.values();
    for (std::size_t p = 0; p < infos.size(); ++p)
      if (infos[p].name.rfind(name + ".", 0) == 0)
        values[p] = infos[p].fromCoordinate(before[p] + 0.7 * infos[p].scale(model.body));
    model.setValues(values);
  }
  return model;
}

/// Coordinates with derivatives by the last eight parameters.
template <typename T>
std::vector<T> coordinates(const Model& model) {
  const std::vector<double> values = model.coordinates();
  std::vector<T> result(values.begin(), values.end());
  if constexpr (!std::is_same_v<T, ValueOf<T>>)
    for (std::size_t i = 0; i < 8 && i < result.size(); ++i)
      result[result.size() - 1 - i].v[static_cast<int>(i)] = 1.0;
  return result;
}

/// Derivatives of formulas are differences over a step of 6e-6, which amplify rounding.
constexpr double kDifferencesTolerance = 1e-10;

double scaleOf(double a, double b) { return std::max({1.0, std::abs(a), std::abs(b)}); }

/// Measurements of a run at its samples, simulated without lanes.
template <typename One>
std::vector<Measurement<One>> simulateAlone(const Dynamics<One>& dynamics, const Run& run,
                                            bool pose) {
  RigidState<One> state;
  for (int c = 0; c < 3; ++c) {
    valueIn(state.eta(c)) = run.start.eta(c);
    valueIn(state.nu(c)) = run.start.nu(c);
  }
  Simulation<One> simulation(dynamics, run.inputs, state, run.samples[0]);
  if (!pose) simulation.forgetPose();
  std::vector<Measurement<One>> seen;
  for (const double t : run.samples) {
    simulation.advance(t);
    seen.push_back(simulation.measure());
  }
  return seen;
}

/// Simulates `count` runs with and without lanes and compares all measurements; `tolerance` is
/// that of derivatives.
template <typename One, typename Many>
void compare(const Model& model, int count, bool pose, double tolerance) {
  std::vector<Run> runs;
  for (int i = 0; i < count; ++i) runs.emplace_back(10 * count + i);
  std::vector<Lane> lanes;
  for (const Run& run : runs)
    lanes.push_back({&run.inputs, run.samples.data(), static_cast<int>(run.samples.size())});
  const Dynamics<Many> dynamics(model, coordinates<Many>(model));
  const Dynamics<One> alone(model, coordinates<One>(model));
  if (alone.usesPose() && !pose) return;
  const auto varies = [](const auto& delay) {
    if constexpr (std::is_same_v<One, double>)
      return delay > 0;  // a plan for derivatives also works for values
    else
      return !delay.isConstant();
  };
  const LanePlan plan(lanes, valueOf(alone.inputDelay()), varies(alone.inputDelay()),
                      alone.settling());

  RigidState<Many> start;
  for (int i = 0; i < count; ++i)
    for (int c = 0; c < 3; ++c) {
      valueIn(start.eta(c))[i] = runs[static_cast<std::size_t>(i)].start.eta(c);
      valueIn(start.nu(c))[i] = runs[static_cast<std::size_t>(i)].start.nu(c);
    }
  std::vector<std::vector<Measurement<One>>> seen;
  for (const Run& run : runs) seen.push_back(simulateAlone(alone, run, pose));
  std::vector<int> next(runs.size(), 0);
  const auto check = [&](const LanePlan::Sample& sample, const Vector3<Many>& eta,
                         const Vector3<Many>& nu) {
    const auto lane = static_cast<std::size_t>(sample.lane);
    ASSERT_EQ(sample.index, next[lane]++);
    const Measurement<One>& expected = seen[lane][static_cast<std::size_t>(sample.index)];
    for (int c = 0; c < 6; ++c) {
      if (c < 3 && !pose) continue;
      const One& a = c < 3 ? expected.eta(c) : expected.nu(c - 3);
      const Many& b = c < 3 ? eta(c) : nu(c - 3);
      const double value = valueOf(b)[sample.lane];
      ASSERT_NEAR(value, valueOf(a), 1e-12 * scaleOf(value, valueOf(a)))
          << "lane " << lane << ", " << c;
      if constexpr (!std::is_same_v<One, double>)
        for (int d = 0; d < 8; ++d) {
          const double slope = b.v[d][sample.lane];
          ASSERT_NEAR(slope, a.v[d], tolerance * scaleOf(slope, a.v[d]))
              << "derivative " << d << ", lane " << lane << ", " << c;
        }
    }
  };
  plan.run<Many>(dynamics, start, pose,
                 [&](int visit, const Vector3<Many>& eta, const Vector3<Many>& nu) {
                   for (auto sample = plan.begin(visit); sample != plan.end(visit); ++sample)
                     check(*sample, eta, nu);
                 });
  for (std::size_t i = 0; i < runs.size(); ++i)
    EXPECT_EQ(next[i], static_cast<int>(runs[i].samples.size()));
}

void compareAll(const Model& model, double tolerance = 1e-12) {
  for (const int count : {8, 3})
    for (const bool pose : {true, false}) {
      compare<double, Lanes>(model, count, pose, tolerance);
      compare<Jet, LanesJet>(model, count, pose, tolerance);
    }
}

TEST(CosSinBeside, IsAsAccurateAsTheFunctions) {
  for (const double angle : {-40.0, -3.1, 0.0, 0.7, 12.5, 1000.0}) {
    for (const double by : {-3.0, -0.51, -0.4999, -0.1, -1e-9, 0.0, 1e-4, 0.3, 0.4999, 0.51, 2.0}) {
      const double to = angle + by;
      double c, s;
      cosSinBeside(std::cos(angle), std::sin(angle), to - angle, to, c, s);
      EXPECT_NEAR(c, std::cos(to), 4e-16) << angle << " + " << by;
      EXPECT_NEAR(s, std::sin(to), 4e-16) << angle << " + " << by;
      // One lane that is far away must not change the others.
      Lanes all_by(to - angle), all_to(to), cosine, sine;
      all_by[3] = 1.5;
      all_to[3] = angle + 1.5;
      cosSinBeside(Lanes(std::cos(angle)), Lanes(std::sin(angle)), all_by, all_to, cosine, sine);
      for (int lane = 0; lane < Lanes::kCount; ++lane) {
        EXPECT_NEAR(cosine[lane], std::cos(all_to[lane]), 1e-15) << lane;
        EXPECT_NEAR(sine[lane], std::sin(all_to[lane]), 1e-15) << lane;
      }
    }
  }
}

TEST(Lanes, AgreeWithSingleSimulations) { compareAll(craftWith({})); }

TEST(Lanes, AgreeWithSingleSimulationsOfEveryEffect) {
  std::vector<std::string> names = effectNames();
  for (const char* own : {"expression", "world", "memory", "learned"}) names.push_back(own);
  for (const std::string& name : names) {
    SCOPED_TRACE(name);
    compareAll(craftWith({name}), name == "memory" ? kDifferencesTolerance : 1e-12);
  }
}

TEST(Lanes, AgreeWithSingleSimulationsOfSeveralEffects) {
  compareAll(craftWith({"motor_lag", "input_delay", "wind", "quadratic_drag", "marker_offset"}));
  compareAll(craftWith({"motor_lag", "memory", "input_delay"}), kDifferencesTolerance);
  compareAll(craftWith({"com_offset", "thrust_curve", "floor_tilt", "heading_offset"}));
}

TEST(Lanes, ChooseIndividually) {
  Lanes x;
  for (int i = 0; i < Lanes::kCount; ++i) x[i] = i - 3.5;
  const Lanes size = choose(x < Lanes(0.0), [&] { return -x; }, [&] { return x; });
  for (int i = 0; i < Lanes::kCount; ++i) EXPECT_EQ(size[i], std::abs(i - 3.5));
  int calls = 0;
  choose(x < Lanes(9.0), [&] { return ++calls, x; }, [&] { return calls += 100, x; });
  EXPECT_EQ(calls, 1);  // a branch that no lane needs is not evaluated
}

TEST(Lanes, TakeTheirFunctionsFromTheVectorLibrary) {
  Lanes x;
  for (int i = 0; i < Lanes::kCount; ++i) x[i] = 0.3 + 1.7 * i;
  const Lanes sine = sin(x), cosine = cos(x), power = exp(x), root = pow(x, Lanes(0.37)),
              logarithm = log(x);
  for (int i = 0; i < Lanes::kCount; ++i) {
    EXPECT_NEAR(sine[i], std::sin(x[i]), 1e-15);
    EXPECT_NEAR(cosine[i], std::cos(x[i]), 1e-15);
    EXPECT_NEAR(power[i], std::exp(x[i]), 2e-15 * std::exp(x[i]));
    EXPECT_NEAR(root[i], std::pow(x[i], 0.37), 2e-15 * std::pow(x[i], 0.37));
    EXPECT_NEAR(logarithm[i], std::log(x[i]), 2e-15);
  }
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
