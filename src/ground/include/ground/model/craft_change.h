#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "ground/model/model.h"

namespace ground {

/// What may change of a craft while it flies, as numbers that are 0 for the craft of the model file:
/// relative changes of the force of each thruster, of mass, of the moment of inertia and of all
/// damping, and how far the centre of mass has moved from where it was, forward and to starboard [m].
class CraftChange {
 public:
  /// A parameter of a change.
  struct Parameter {
    std::string name;    ///< such as thruster_left, mass, centre_x
    double least, most;  ///< bounds on what a controller takes
    bool relative;       ///< a share; otherwise [m]
  };

  explicit CraftChange(const Model& model);

  int size() const { return static_cast<int>(parameters_.size()); }
  int thrusters() const { return size() - 5; }  ///< their parameters come first
  int mass() const { return thrusters(); }
  int inertia() const { return mass() + 1; }
  int centre() const { return mass() + 2; }  ///< x, then y
  int drag() const { return mass() + 4; }
  const std::vector<Parameter>& parameters() const { return parameters_; }
  /// The change within its bounds; not finite values become 0.
  Eigen::VectorXd bounded(Eigen::VectorXd change) const;
  /// Whether two changes differ by so much that a controller should take the new one.
  bool differ(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const;
  /// Thrusters that hardly push any more after a change. None of a craft with fewer than three, nor where
  /// fewer than two others are left.
  std::vector<int> dead(const Eigen::VectorXd& change) const;
  /// The part of a change by which thrusters are dead.
  Eigen::VectorXd deadOnly(const Eigen::VectorXd& change) const;
  /// Names of the thrusters that are dead after a change, such as "front_left and back_right".
  std::string deadNames(const Eigen::VectorXd& change) const;
  /// The model with a change, which is bounded first. Throws std::invalid_argument on another size.
  Model apply(const Eigen::VectorXd& change) const;
  /// The model that coordinates() belong to: that of the file with effects at neutral values.
  const Model& model() const { return model_; }
  /// Coordinates for Dynamics of the model with a change.
  template <typename T>
  std::vector<T> coordinates(const std::vector<T>& change) const {
    std::vector<T> all(base_.begin(), base_.end());
    for (const Term& term : terms_) {
      T& value = all[static_cast<std::size_t>(term.coordinate)];
      const T& by = change[static_cast<std::size_t>(term.parameter)];
      if (term.kind == Term::kScaled) value = value * (1.0 + by);
      if (term.kind == Term::kDivided) value = value / (1.0 + by);
      if (term.kind == Term::kGain) value = (1.0 + value) * (1.0 + by) - 1.0;
      if (term.kind == Term::kAdded) value = value + by;
    }
    if (pair_ < 0) return all;
    // The thesis's pair has k (1 + a) and k (1 - a).
    T& a = all[static_cast<std::size_t>(pair_)];
    const T left = (1.0 + a) * (1.0 + change[0]), right = (1.0 - a) * (1.0 + change[1]);
    T& k = all[static_cast<std::size_t>(thrust_)];
    k = k * (0.5 * (left + right));
    a = (left - right) / (left + right);
    return all;
  }

 private:
  /// How a parameter of the change acts on a coordinate of the model.
  struct Term {
    enum Kind { kScaled, kDivided, kGain, kAdded } kind;
    int parameter, coordinate;
  };

  void scale(const std::string& effect, int parameter);

  Model model_;
  std::vector<double> base_;
  std::vector<Parameter> parameters_;
  std::vector<Term> terms_;
  int thrust_;     ///< coordinate of k
  int pair_ = -1;  ///< coordinate of thrust_asymmetry.a for a left and a right thruster, otherwise -1
};

}  // namespace ground
