#include <array>
#include <cstddef>
#include <string>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Damping that depends on the position on the floor: force -c(x, y) (u, v). c is interpolated
/// bilinearly between the nodes of a grid and constant beyond its edge. c is negative where the
/// damping is smaller than X_u and Y_v.
///
/// Prior: differences between neighbours are normal with standard deviation scale(), and values are
/// normal with kOwnDeviation times as much. Nodes far from all runs follow their neighbours.
struct FloorFrictionMap {
  static constexpr int kNodes = 5;         ///< along x and along y
  static constexpr double kFirst = -2.0;   ///< x and y of the first node, world_ned [m]
  static constexpr double kSpacing = 1.0;  ///< [m]

  static EffectInfo info() {
    EffectInfo info{"floor_friction_map", "damping that varies over the floor", {}};
    for (int i = 0; i < kNodes; ++i)
      for (int j = 0; j < kNodes; ++j)
        info.parameters.push_back({"c_" + std::to_string(i) + "_" + std::to_string(j), "N s/m",
                                   "damping added at x = " + metres(i) + ", y = " + metres(j), 0, -1e3, 1e3,
                                   scale});
    info.opt_in = true;
    info.penalty = penalty;
    return info;
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const std::array<T, kNodes> x = weights(point.eta.x()), y = weights(point.eta.y());
    T damping(0.0);
    for (int i = 0; i < kNodes; ++i) {
      T along_y(0.0);
      for (int j = 0; j < kNodes; ++j) along_y += y[at(j)] * p[i * kNodes + j];
      damping += x[at(i)] * along_y;
    }
    wrench(0) -= damping * point.nu.x();
    wrench(1) -= damping * point.nu.y();
  }

 private:
  /// Prior standard deviation of a value, relative to that of a difference.
  static constexpr double kOwnDeviation = 3.0;

  static double scale(const Body<double>& b) { return 0.1 * typical::force(b) / typical::speed(b); }
  static std::string metres(int node) {
    return std::to_string(static_cast<int>(kFirst + node * kSpacing)) + " m";
  }

  static Eigen::MatrixXd penalty(const Body<double>& body) {
    const double difference = 1 / (scale(body) * scale(body));
    const double own = difference / (kOwnDeviation * kOwnDeviation);
    constexpr int count = kNodes * kNodes;
    Eigen::MatrixXd W = own * Eigen::MatrixXd::Identity(count, count);
    const auto bind = [&](int a, int b) {
      W(a, a) += difference;
      W(b, b) += difference;
      W(a, b) -= difference;
      W(b, a) -= difference;
    };
    for (int i = 0; i < kNodes; ++i)
      for (int j = 0; j + 1 < kNodes; ++j) {
        bind(i * kNodes + j, i * kNodes + j + 1);
        bind(j * kNodes + i, (j + 1) * kNodes + i);
      }
    return W;
  }

  static std::size_t at(int node) { return static_cast<std::size_t>(node); }

  /// Weights of the nodes along an axis at a position [m]: hat functions, whose sum is 1. At a node
  /// the derivatives are the right-hand ones.
  template <typename T>
  static std::array<T, kNodes> weights(const T& place) {
    constexpr double kEnd = kNodes - 1;
    const T inside = kEnd - notBelowZero(T(kEnd - notBelowZero(T((place - kFirst) / kSpacing))));
    std::array<T, kNodes> weights;
    for (int i = 0; i < kNodes; ++i) {
      const T rising = inside - (i - 1.0), falling = (i + 1.0) - inside;
      const T& nearest = select(rising < falling, rising, falling);
      weights[at(i)] = select(nearest < 0.0, T(0.0), nearest);
    }
    return weights;
  }
};
GROUND_REGISTER_EFFECT(FloorFrictionMap)

}  // namespace ground
