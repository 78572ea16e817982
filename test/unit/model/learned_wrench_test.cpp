// The learned wrench: a sum of bells with exact derivatives, zero away from its centres, read strictly.
#include "ground/model/learned_wrench.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <regex>

#include "ground/model/dynamics.h"
#include "ground/model/model_file.h"

namespace ground {
namespace learned_wrench_test {

constexpr char kBody[] =
    "schema: ground/model/1\n"
    "name: test\n"
    "body: {m: 0.06, l: 0.03, I_z: 1.0e-4, X_u: 0.01, Y_v: 0.02, N_r: 3.0e-5, k: 0.06, "
    "input_max: 1}\n"
    "effects:\n";

// clang-format off
constexpr char kLearned[] = R"yaml(  - name: learned_wrench
    scale: 1.5
    terms:
      - arguments: [x, psi]
        widths: [0.3, 0.8]
        frame: world
        centres: [[0.1, 3.0], [-0.2, 0.4]]
        weights: {X: [0.01, -0.02], N: [1.0e-4, 2.0e-4]}
      - arguments: [u_L]
        widths: [0.4]
        centres: [[0.5]]
        weights: {Y: [0.003]}
)yaml";
// clang-format on

Model parsed(const std::string& effects) { return parseModel(kBody + effects, "craft.yaml"); }

Model with(const LearnedWrench& learned, double scale = 1) {
  Model model = parsed("");
  model.addEffect(makeLearnedWrench(learned));
  model.setValue(learned.name + ".scale", scale);
  return model;
}

/// Bells at random places in all three arguments.
LearnedTerm randomTerm(const std::vector<std::string>& arguments, bool world, int count) {
  std::mt19937 random(static_cast<unsigned>(count));
  std::uniform_real_distribution<double> uniform(-1, 1);
  LearnedTerm term;
  term.arguments = arguments;
  term.world = world;
  term.centres.resize(count, static_cast<Eigen::Index>(arguments.size()));
  for (Eigen::Index i = 0; i < term.centres.size(); ++i) term.centres.data()[i] = uniform(random);
  for (std::size_t i = 0; i < arguments.size(); ++i) term.widths.push_back(0.7 + 0.1 * double(i));
  for (auto& weights : term.weights)
    for (int i = 0; i < count; ++i) weights.push_back(0.01 * uniform(random));
  return term;
}

const RigidState<double> kState{{0.2, -0.1, 0.5}, {0.3, -0.2, 0.4}};
const Thrusters<double> kInput{0.6, 0.3};

/// The wrench that the effects of a model add.
Vector3<double> added(const Model& model, const RigidState<double>& state = kState) {
  const Vector3<double> with = Dynamics<double>(model).derivative(1, state, kInput, 1).nu;
  const Vector3<double> bare = Dynamics<double>(parsed("")).derivative(1, state, kInput, 1).nu;
  return Vector3<double>(model.body.m, model.body.m, model.body.I_z).cwiseProduct(with - bare);
}

TEST(LearnedWrench, IsTheSumOfItsBells) {
  const LearnedTerm term = randomTerm({"x", "v", "u_2"}, false, 21);
  Vector3<double> sum(0, 0, 0);
  const Vector3<double> at(0.2, -0.2, 0.3);
  for (int bell = 0; bell < 21; ++bell) {
    const Vector3<double> away =
        (at - term.centres.row(bell).transpose()).cwiseQuotient(Vector3<double>::Map(term.widths.data()));
    const double distance = away.norm(), height = std::pow(1 - distance * distance / 9, 4);
    for (std::size_t c = 0; c < 3 && distance < 3; ++c)
      sum(int(c)) += term.weights[c][std::size_t(bell)] * height;
  }
  const LearnedWrench learned{"rest", {term}};
  for (const double scale : {1.0, 0.4}) EXPECT_LT((added(with(learned, scale)) - scale * sum).norm(), 1e-12);
  const Eigen::MatrixXd values = bells(term, at.transpose());
  for (std::size_t c = 0; c < 3; ++c)
    EXPECT_NEAR((values * Eigen::VectorXd::Map(term.weights[c].data(), 21))(0), sum(int(c)), 1e-15);
}

TEST(LearnedWrench, IsCloseToAGaussianAndZeroFromThreeWidthsOn) {
  LearnedTerm term{{"y"}, {0.2}, false, Eigen::MatrixXd::Constant(1, 1, 0.5), {}};
  term.weights[0] = {1};
  for (double d = -5; d <= 5; d += 0.125) {
    const Eigen::MatrixXd at = Eigen::MatrixXd::Constant(1, 1, 0.5 + 0.2 * d);
    EXPECT_NEAR(bells(term, at)(0, 0), std::exp(-d * d / 2), 0.06) << d;
    if (std::abs(d) >= 3) {
      EXPECT_NEAR(bells(term, at)(0, 0), 0, 1e-60) << d;
    }
  }
  RigidState<double> far = kState;
  far.eta.y() = 40;
  EXPECT_EQ(added(with({"rest", {term}}), far), Vector3<double>(0, 0, 0));
}

TEST(LearnedWrench, IsAbsentAtScaleZero) {
  const LearnedWrench learned{"rest", {randomTerm({"x", "y"}, true, 9)}};
  EXPECT_NE(added(with(learned)), Vector3<double>(0, 0, 0));
  EXPECT_EQ(added(with(learned, 0)), Vector3<double>(0, 0, 0));
}

TEST(LearnedWrench, HasAPeriodOfOneTurn) {
  const Model model = with({"rest", {randomTerm({"psi", "u"}, true, 9)}});
  RigidState<double> state = kState;
  for (const double psi : {0.5, 3.1, -3.1}) {
    state.eta.z() = psi;
    const Vector3<double> once = added(model, state);
    for (const int turns : {-3, 1, 20}) {
      state.eta.z() = psi + 2 * M_PI * turns;
      EXPECT_LT((added(model, state) - once).norm(), 1e-13);
    }
  }
  state.eta.z() = M_PI - 1e-9;
  const Vector3<double> before = added(model, state);
  state.eta.z() = -M_PI + 1e-9;
  EXPECT_LT((added(model, state) - before).norm(), 1e-9);
}

TEST(LearnedWrench, HasAFrameForItsForce) {
  LearnedTerm term = randomTerm({"x", "y"}, false, 5);
  RigidState<double> state = kState;
  const auto force = [&](double psi) {
    state.eta.z() = psi;
    return Vector2<double>(added(with({"rest", {term}}), state).head<2>());
  };
  EXPECT_LT((force(2.0) - force(0.5)).norm(), 1e-12) << "fixed in the body";
  term.world = true;
  EXPECT_LT((bodyToWorld(2.0, force(2.0)) - bodyToWorld(0.5, force(0.5))).norm(), 1e-12);
  EXPECT_GT((force(2.0) - force(0.5)).norm(), 1e-4);
}

TEST(LearnedWrench, DerivativesAgreeWithFiniteDifferences) {
  const std::vector<std::vector<std::string>> sets = {
      {"psi"}, {"x", "y"}, {"u", "v", "r"}, {"x", "y", "psi"}, {"psi", "u_L", "t"}};
  for (const auto& arguments : sets)
    for (const bool world : {false, true}) {
      const Model model = with({"rest", {randomTerm(arguments, world, 17)}}, 0.8);
      const std::vector<double> at = model.coordinates();
      // Derivatives by t, the state and the scale.
      std::vector<Jet> coordinates(at.begin(), at.end());
      coordinates.back().v[7] = 1;
      RigidState<Jet> state;
      Jet t(0.3, 0);
      for (int c = 0; c < 6; ++c)
        (c < 3 ? state.eta(c) : state.nu(c - 3)) = Jet(c < 3 ? kState.eta(c) : kState.nu(c - 3), 1 + c);
      const Vector3<Jet> exact =
          Dynamics<Jet>(model, coordinates).derivative(t, state, {Jet(0.6), Jet(0.3)}, 1).nu;
      for (int d = 0; d < 8; ++d) {
        const auto moved = [&](double h) {
          std::vector<double> values = at;
          if (d == 7) values.back() += h;
          RigidState<double> there = kState;
          if (d > 0 && d < 7) (d < 4 ? there.eta(d - 1) : there.nu(d - 4)) += h;
          return Dynamics<double>(model, values).derivative(0.3 + (d == 0 ? h : 0), there, kInput, 1).nu;
        };
        const Vector3<double> finite = (moved(1e-5) - moved(-1e-5)) / 2e-5;
        for (int c = 0; c < 3; ++c)
          EXPECT_NEAR(exact(c).v[d], finite(c), 1e-7 * std::max(1.0, std::abs(finite(c))))
              << arguments[0] << ' ' << c << " by " << d;
      }
    }
}

TEST(LearnedWrench, IsReadAndWrittenWithoutLoss) {
  const Model model = parsed(kLearned);
  EXPECT_EQ(model.value("learned_wrench.scale"), 1.5);
  const std::string text = formatModel(model);
  EXPECT_NE(text.find("stand-in"), std::string::npos) << text;
  const Model again = parseModel(text, "written");
  EXPECT_EQ(formatModel(again), text);
  EXPECT_EQ(added(again), added(model));
  EXPECT_NE(added(model), Vector3<double>(0, 0, 0));
  const std::string many = formatModel(with({"rest", {randomTerm({"x", "psi", "r"}, true, 150)}}));
  EXPECT_EQ(formatModel(parseModel(many, "written")), many);
}

}  // namespace learned_wrench_test
}  // namespace ground
