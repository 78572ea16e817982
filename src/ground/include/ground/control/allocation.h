#pragma once

#include <vector>

#include "ground/control/box_minimum.h"
#include "ground/model/body.h"
#include "ground/model/model.h"

namespace ground {

/// Control allocation: the commands of a craft's thrusters that give a demanded wrench, each within
/// its range and through the inverse of its force curve.
///
/// The forces F minimise, within the ranges of all thrusters,
///
///     wX (X - X*)^2 + wY (Y - Y*)^2 + wN ((N - N*) / l)^2 + e sum (F_i / (k gain_i))^2
///
/// with a small e: the error of the wrench comes first, then the squares of the forces relative to
/// the forces at input 1 (the commands, if force curves are linear). It is the weighted least squares
/// of Harkegard, Efficient active set algorithms for solving constrained least squares problems in
/// aircraft control allocation, CDC 2002. Allocates no memory after construction. One thread at a
/// time.
///
/// The wrench of a craft with rudders or turning thrusters is not linear in their angles. It minimises the
/// same errors over the inputs, e times whose squares are the effort, by Gauss-Newton steps from several
/// starts; forces are forces on a craft at rest, with the effects on its angles.
class Allocation {
 public:
  /// Weights of the squared errors of X, Y and N / l. Equal weights give the pair the inputs of
  /// thesis (4.8), each clipped.
  struct Weights {
    double surge = 1, sway = 1, yaw = 1;
  };
  /// What the thrusters give.
  struct Output {
    Thrusters<double> inputs;  ///< within the ranges, in the model's units
    /// The inputs if they give the demanded wrench; if not, the least-squares solution
    /// without ranges.
    Thrusters<double> wanted;
    Vector3<double> wrench;  ///< X, Y [N], N [N m] of the inputs
  };

  Allocation(const ThrusterLayout& layout, const Body<double>& body) : Allocation(layout, body, Weights()) {}
  Allocation(const ThrusterLayout& layout, const Body<double>& body, const Weights& weights);
  /// With the effects on the angles of a craft.
  Allocation(const Model& model, const Weights& weights);

  /// Inputs for a wrench: X, Y [N], N [N m], body.
  Output run(const Vector3<double>& wrench) const;
  /// What the thrusters give for far too large a demand of X, Y, N / l along `direction`, such as
  /// (1, 0, 0) for full forward thrust.
  Output most(const Vector3<double>& direction) const;

 private:
  using Forces = PerThruster;

  using Columns = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxThrusters>;

  Thrusters<double> inputsOf(const Forces& force) const;
  Output steered(const Vector3<double>& demand) const;
  double descend(const Vector3<double>& demand, Forces& input) const;
  double cost(const Vector3<double>& demand, const Forces& input, const Vector3<double>& given) const;
  Vector3<double> wrenchAt(const Forces& input, Columns* slopes) const;

  ThrusterLayout layout_;
  double lever_;  ///< l [m]
  Vector3<double> weights_;
  /// X, Y, N / l of a force of 1 N.
  Columns columns_;
  Forces full_;        ///< force at input 1 [N]
  Forces low_, high_;  ///< range [N]
  mutable BoxMinimum problem_;
  BoxMinimum::Square hessian_;

  // For a craft with rudders or turning thrusters:
  double k_;  ///< thrust per unit input [N]
  std::vector<Steered<double>> steering_;
  std::vector<Steered<Jet>> slopes_;
};

/// The input at which a force curve has a value, the smallest in size if there are several. Beyond
/// the range of a table it grows in proportion.
double inputFor(const ForceCurve& curve, double force);

}  // namespace ground
