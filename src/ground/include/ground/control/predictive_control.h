#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "ground/control/effect_use.h"
#include "ground/control/tracking_controller.h"
#include "ground/control/trajectory_optimizer.h"
#include "ground/estimation/disturbance_observer.h"
#include "ground/model/tunable.h"

namespace ground {

/// How far to look ahead, what to want, and how long to think.
struct PredictiveParams {
  double horizon = 2.0;        ///< [s]
  int steps = 40;              ///< of the horizon
  int iterations = 4;          ///< most improvements of the plan in one decision
  double lost = 0.02;          ///< error of a plan beyond which others are tried, too, rms [m]
  int search_iterations = 12;  ///< most improvements of other plans in one decision
  PlanWeights weights;
  ObserverParams observer;

  static const Tunables<PredictiveParams>& table();  ///< weights and observer included
  std::string validate() const;                      ///< what is wrong; empty when nothing is
};

/// Nonlinear model predictive control with the whole model, effects included.
///
/// An observer estimates velocity and the missing acceleration, so that a wrong model
/// leaves no lasting error; it also predicts the state at which the inputs will act, which makes
/// up for latency, delay and lag. A plan is carried on from decision to decision and improved a few
/// times (real-time iterations). The craft cannot brake: where the plan leads astray, others that
/// turn it left or right first are tried. Work in one decision is bounded and allocates nothing.
/// Without a finite state or plan the thrust is cut.
class PredictiveControl : public TrackingController {
 public:
  static EffectUse effectUse(const Model& model) { return wholeModelUse(model); }

  /// Throws std::invalid_argument when parameters are bad or the model has too many actuator
  /// states.
  PredictiveControl(const Model& model, const PredictiveParams& params);

  /// Takes effect with the next decision; allocates when the horizon changes. Throws alike.
  void setParams(const PredictiveParams& params);
  void avoid(const PlanWalls& walls) override;
  void reset() override;
  void commanded(double time, const Vector2<double>& thrusters, double lift) override;
  Vector2<double> position(const RigidState<double>& measured) const override;
  Vector2<double> decide(const Observation& observation) override;
  Vector2<double> wanted() const override { return wanted_; }

  /// Improvements of plans in the last decision.
  int improvements() const { return improvements_; }
  /// The plan of the last decision.
  const TrajectoryOptimizer& plan() const { return *plan_; }

 private:
  /// The beginning of a plan: a turn, as fast as it can be, and then thrust.
  struct Seed {
    double turn = 0;    ///< [rad], positive to starboard
    double thrust = 0;  ///< share of what there is
  };

  void carryOn(double time);
  void search();
  void makeSeeds();
  void follow(const Seed& seed);
  double turnTime(double angle) const;

  Model model_;
  Dynamics<Jet> seen_;  ///< what the mocap makes of the state
  PredictiveParams params_;
  double input_max_;
  DisturbanceObserver observer_;
  std::unique_ptr<TrajectoryOptimizer> plan_, other_;
  std::vector<ReferencePoint> references_;
  DisturbanceObserver::Estimate start_;
  bool has_plan_ = false;
  double plan_time_ = 0;  ///< at which the plan begins [s]
  std::array<Seed, 14> seeds_;
  std::size_t next_seed_ = 0;
  int improvements_ = 0;
  std::optional<PlanWalls> walls_;
  Vector2<double> wanted_ = Vector2<double>::Zero();
};

}  // namespace ground
