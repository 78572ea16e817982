#pragma once

#include <Eigen/LU>
#include <memory>
#include <optional>

#include "ground/model/simulation.h"
#include "ground/simulation/battery.h"
#include "ground/simulation/disturbance_source.h"
#include "ground/simulation/plant.h"

namespace ground {

/// A craft that moves by a Model, under a disturbance and dry friction of the floor while its lift
/// is off.
class ModelCraft : public Plant {
 public:
  /// A force that acts for some time.
  struct Push {
    Vector2<double> force{0, 0};  ///< world_ned [N]
    double from = 0, until = 0;   ///< [s]
  };
  struct Params {
    RigidState<double> initial;    ///< initial state
    double start = 0.0;            ///< initial time [s]
    unsigned long seed = 1;        ///< for the disturbance
    Disturbance disturbance = {};  ///< Model::disturbance is not used
    /// Deceleration by dry friction of the floor while the lift is off [m/s^2].
    double braking = 2.0;
    BatteryParams battery = {};  ///< its voltage acts by effects of the model, such as battery_voltage
    Push push = {};              ///< besides the disturbance
  };

  /// Throws std::invalid_argument if the disturbance is bad.
  ModelCraft(const Model& model, const Params& params);

  void command(const Thrusters<double>& thrusters, double lift) override;
  void advance(double time) override;
  RigidState<double> state() const override { return moving_->simulation.state(); }
  RigidState<double> derivative() const override;
  Measurement<double> measurement() const override { return moving_->simulation.measure(); }
  Vector3<double> wrench() const override;
  double voltage() const override { return battery_ ? battery_->voltage() : 0; }

  /// Replaces the model; pose and velocity stay. Throws std::invalid_argument, and keeps the old
  /// model, if the acceleration by the new one is not finite.
  void setModel(const Model& model);

 private:
  /// The simulation of a model.
  struct Moving {
    Moving(const Model& model, const InputSequence& inputs, const RigidState<double>& state, double time)
        : dynamics(model), simulation(dynamics, inputs, state, time), mobility(dynamics.mass().inverse()) {}
    Dynamics<double> dynamics;
    Simulation<double> simulation;
    Matrix3<double> mobility;  ///< inverse of the mass matrix
  };

  Model onThisRun(Model model) const;
  double time() const { return moving_->simulation.time(); }
  bool pushed() const { return time() < params_.push.until; }
  /// Time at which the push begins or ends [s].
  double nextPush() const { return time() < params_.push.from ? params_.push.from : params_.push.until; }
  bool disturbed() const { return source_ || pushed(); }
  bool sits() const { return untouched_ || (lift_ && *lift_ == 0); }
  Vector3<double> friction() const;
  /// Advances the simulation, and the battery, to a time.
  void simulate(double until);

  Params params_;
  std::optional<DisturbanceSource> source_;
  std::optional<Battery> battery_;
  Vector3<double> wrench_ = Vector3<double>::Zero();
  double next_wrench_;       ///< time of the next change of wrench_ [s]
  unsigned long drawn_ = 0;  ///< number of changes of wrench_
  Model model_;
  InputSequence inputs_;
  std::unique_ptr<Moving> moving_;
  /// Input of the lift fan; no value before the first lift, so that a craft can start in motion.
  std::optional<double> lift_;
  /// Whether wind, a tilted floor or the like would move the craft, which rests on the floor without
  /// any input so far.
  bool untouched_ = false;
};

}  // namespace ground
