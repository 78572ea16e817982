// Allocation of a wrench to thrusters, against the thesis and against all sets of active bounds.
#include "ground/control/allocation.h"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "ground/model/model_file.h"

namespace ground {
namespace allocation_test {

std::mt19937_64& random() {
  static std::mt19937_64 generator(1);
  return generator;
}
double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random());
}

Thruster someThruster(int number) {
  Thruster one;
  one.name = one.channel = "t" + std::to_string(number);
  one.position = {uniform(-0.2, 0.2), uniform(-0.2, 0.2)};
  // Multiples of 90 degrees make layouts whose thrusters can replace each other.
  one.direction = uniform(0, 1) < 0.5 ? 90 * std::floor(uniform(-2, 2)) : uniform(-180, 180);
  one.least = uniform(0, 1) < 0.4 ? uniform(-1, -0.1) : 0;
  one.most = uniform(0.3, 1);
  one.gain = uniform(0.5, 2);
  const double kind = uniform(0, 1);
  if (kind < 0.3) one.curve.power = uniform(0.5, 2.5);
  if (kind > 0.7) one.curve.table = {{-1, -0.7}, {-0.5, -0.6}, {-0.1, 0}, {0.2, 0}, {0.5, 0.4}, {1, 1}};
  return one;
}

struct Craft {
  ThrusterLayout layout;
  Body<double> body;
};

Craft someCraft(int count) {
  std::vector<Thruster> thrusters;
  for (int i = 0; i < count; ++i) thrusters.push_back(someThruster(i));
  Craft craft{ThrusterLayout(thrusters), {}};
  craft.body.k = uniform(0.05, 2);
  craft.body.l = craft.layout.lever();
  return craft;
}

/// X, Y, N / l of each thruster's force [N] in the columns, and ranges of the forces.
struct Problem {
  Eigen::MatrixXd columns;
  Eigen::VectorXd full, low, high;

  explicit Problem(const Craft& craft) {
    const int n = craft.layout.size();
    columns.resize(3, n);
    full.resize(n);
    low.resize(n);
    high.resize(n);
    for (int i = 0; i < n; ++i) {
      const Thruster& one = craft.layout[i];
      columns.col(i) << craft.layout.forward(i), craft.layout.starboard(i), craft.layout.lever(i);
      full(i) = craft.body.k * one.gain;
      low(i) = full(i) * one.curve.at(one.least);
      high(i) = full(i) * one.curve.at(one.most);
    }
  }
  double effort(const Eigen::VectorXd& force) const { return force.cwiseQuotient(full).squaredNorm(); }
};

/// Calls act(force, columns of free thrusters, their indices) for every set of active bounds;
/// `force` has the bounds of the others and zeros.
template <class Act>
void forEverySet(const Problem& problem, const Act& act) {
  const auto n = static_cast<int>(problem.low.size());
  long sets = 1;
  for (int i = 0; i < n; ++i) sets *= 3;
  for (long set = 0; set < sets; ++set) {
    Eigen::VectorXd force = Eigen::VectorXd::Zero(n);
    std::vector<int> free;
    long rest = set;
    for (int i = 0; i < n; ++i, rest /= 3) {
      if (rest % 3 == 0) free.push_back(i);
      if (rest % 3 == 1) force(i) = problem.low(i);
      if (rest % 3 == 2) force(i) = problem.high(i);
    }
    Eigen::MatrixXd columns(3, static_cast<Eigen::Index>(free.size()));
    for (std::size_t i = 0; i < free.size(); ++i)
      columns.col(static_cast<Eigen::Index>(i)) = problem.columns.col(free[i]);
    act(force, columns, free);
  }
}

bool inside(const Problem& problem, const Eigen::VectorXd& force) {
  const double tolerance = 1e-9 * problem.full.maxCoeff();
  return ((force - problem.low).array() > -tolerance).all() &&
         ((problem.high - force).array() > -tolerance).all();
}

/// The wrench inside the ranges that is closest to a demand.
Eigen::Vector3d closest(const Problem& problem, const Eigen::Vector3d& demand) {
  Eigen::Vector3d best = Eigen::Vector3d::Zero();
  double least = std::numeric_limits<double>::infinity();
  forEverySet(problem,
              [&](Eigen::VectorXd force, const Eigen::MatrixXd& columns, const std::vector<int>& free) {
                if (!free.empty()) {
                  const Eigen::VectorXd solved =
                      columns.completeOrthogonalDecomposition().solve(demand - problem.columns * force);
                  for (std::size_t i = 0; i < free.size(); ++i)
                    force(free[i]) = solved(static_cast<Eigen::Index>(i));
                }
                const Eigen::Vector3d wrench = problem.columns * force;
                if (!inside(problem, force) || (wrench - demand).squaredNorm() >= least) return;
                least = (wrench - demand).squaredNorm();
                best = wrench;
              });
  return best;
}

/// The least sum of squares of the relative forces that give a wrench.
double leastEffort(const Problem& problem, const Eigen::Vector3d& wrench) {
  double least = std::numeric_limits<double>::infinity();
  forEverySet(problem,
              [&](Eigen::VectorXd force, const Eigen::MatrixXd& columns, const std::vector<int>& free) {
                if (!free.empty()) {
                  Eigen::MatrixXd scaled = columns;
                  for (std::size_t i = 0; i < free.size(); ++i)
                    scaled.col(static_cast<Eigen::Index>(i)) *= problem.full(free[i]);
                  const Eigen::VectorXd solved =
                      scaled.completeOrthogonalDecomposition().solve(wrench - problem.columns * force);
                  for (std::size_t i = 0; i < free.size(); ++i)
                    force(free[i]) = problem.full(free[i]) * solved(static_cast<Eigen::Index>(i));
                }
                if ((problem.columns * force - wrench).norm() > 1e-7 * problem.full.maxCoeff()) return;
                if (inside(problem, force)) least = std::min(least, problem.effort(force));
              });
  return least;
}

TEST(Allocation, GivesThePairTheInputsOfTheThesis) {
  const Model model = loadModel("cfg/hovercraft/mvwt.yaml");
  const Body<double>& body = model.body;
  const Allocation allocation(*model.thrusters, body);
  for (int i = 0; i < 10000; ++i) {
    const double force = uniform(-30, 30), torque = uniform(-5, 5);
    const Vector2<double> wanted =
        Vector2<double>(force + torque / body.l, force - torque / body.l) / (2 * body.k);
    const Allocation::Output out = allocation.run({force, 0, torque});
    for (int j = 0; j < 2; ++j) {
      ASSERT_NEAR(out.wanted(j), wanted(j), 1e-8 * std::abs(wanted(j)));
      ASSERT_NEAR(out.inputs(j), std::clamp(wanted(j), 0.0, body.input_max), 1e-8);
    }
  }
}

TEST(Allocation, FindsTheClosestWrenchAndThenTheLeastEffort) {
  int saturated = 0, met = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const Craft craft = someCraft(1 + trial % 8);
    const Problem problem(craft);
    const Allocation allocation(craft.layout, craft.body);
    const double reach = uniform(0.1, 2) * craft.body.k;
    Eigen::Vector3d demand(uniform(-reach, reach), uniform(-reach, reach), uniform(-reach, reach));
    if (trial % 2 == 0) demand = problem.columns * (0.7 * problem.high + 0.1 * problem.low);
    const Vector3<double> per_lever(1, 1, craft.body.l);
    const Allocation::Output out = allocation.run(demand.cwiseProduct(per_lever));
    // The forces of the inputs, by the layout itself.
    Eigen::VectorXd force(craft.layout.size());
    const Thrusters<double> forces = craft.layout.forces(out.inputs);
    for (int i = 0; i < force.size(); ++i) force(i) = craft.body.k * forces(i);
    const Thrusters<double> clipped = craft.layout.clipped(out.inputs, craft.body.input_max);
    for (int i = 0; i < force.size(); ++i) ASSERT_NEAR(clipped(i), out.inputs(i), 1e-12);
    const Eigen::Vector3d given = problem.columns * force;
    ASSERT_LT((given.cwiseProduct(per_lever) - out.wrench).norm(), 1e-9 * problem.full.maxCoeff());

    const Eigen::Vector3d best = closest(problem, demand);
    ASSERT_LT((given - demand).norm(), (best - demand).norm() + 1e-4 * problem.full.maxCoeff()) << trial;
    const double effort = leastEffort(problem, best);
    ASSERT_LT(problem.effort(force), effort * (1 + 1e-4) + 1e-9) << trial;
    saturated += (best - demand).norm() > 1e-3 * reach;
    met += (best - demand).norm() < 1e-6 * reach;
  }
  EXPECT_GT(saturated, 50);
  EXPECT_GT(met, 50);
}

TEST(Allocation, SaysWhatItWantedOnlyIfItCannotGiveIt) {
  const Model table = loadModel("cfg/craft/air_table.yaml");
  const Allocation allocation(*table.thrusters, table.body);
  const Allocation::Output light = allocation.run({0.2, -0.1, 0.02});
  EXPECT_LT((light.wrench - Vector3<double>(0.2, -0.1, 0.02)).norm(), 1e-6);
  for (int i = 0; i < 8; ++i) EXPECT_EQ(light.wanted(i), light.inputs(i));
  const Allocation::Output heavy = allocation.run({10, 0, 0});
  EXPECT_NEAR(heavy.wrench.x(), 1, 1e-6) << "two jets of 0.5 N push forward";
  EXPECT_GT(*std::max_element(heavy.wanted.begin(), heavy.wanted.end()), 1);
}

TEST(InputFor, InvertsForceCurves) {
  ForceCurve table;
  table.table = {{-1, -0.7}, {-0.5, -0.6}, {-0.1, 0}, {0.2, 0}, {0.5, 0.4}, {1, 1}};
  ForceCurve power;
  power.power = 1.7;
  for (const ForceCurve& curve : {ForceCurve(), table, power}) {
    for (int i = 0; i < 100; ++i) {
      const double force = uniform(-0.7, 1);
      EXPECT_NEAR(curve.at(inputFor(curve, force)), force, 1e-12);
    }
    EXPECT_EQ(inputFor(curve, 0), 0);
    EXPECT_GT(inputFor(curve, 2), 1);
    EXPECT_LT(inputFor(curve, -2), -1);
  }
  EXPECT_NEAR(inputFor(table, 1e-12), 0.2, 1e-9) << "the end of the dead zone";
  ForceCurve forward;  // there is no input with a force backwards
  forward.table = {{0, 0}, {0.2, 0}, {1, 1}};
  EXPECT_EQ(inputFor(forward, -0.5), 0);
  EXPECT_NEAR(inputFor(forward, 0.5), 0.6, 1e-12);
  table.table = {{-1, -0.7}, {-0.5, -0.7}, {0, 0}, {0.5, 0.5}, {0.75, 0.5}, {1, 1}};
  EXPECT_EQ(inputFor(table, 0.5), 0.5) << "the least input with that force";
}

}  // namespace allocation_test
}  // namespace ground
