#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "ground/control/effect_use.h"
#include "ground/control/tracking_controller.h"
#include "ground/control/trajectory_optimizer.h"
#include "ground/estimation/disturbance_observer.h"
#include "ground/parameters/PlanParams.h"

namespace ground {

/// Parameters of PredictiveControl.
struct PredictiveParams : PlanParams, PlanWeights, ObserverParams {
  static const Tunables<PredictiveParams>& table();
  std::string validate() const { return rangeError(table(), *this); }  ///< error message, or empty
};

/// Nonlinear model predictive control with the whole model, effects included.
///
/// An observer estimates velocity and missing acceleration, so that a wrong model leaves no
/// constant error. It also predicts the state at the time when the inputs will act, which
/// compensates latency, delay and lag. A plan is continued from decision to decision and improved a
/// few times each (real-time iterations). Most crafts cannot brake: if the plan does not follow the
/// reference, others that first turn the craft left or right are tried, two at a time. A decision
/// takes bounded work and allocates no memory. With a clock, it ends at a deadline with the best
/// plan so far, which is at least as good as the continued plan. Without a finite state or plan the
/// thrust is zero.
class PredictiveControl : public TrackingController {
 public:
  static EffectUse effectUse(const Model& model) { return wholeModelUse(model); }

  /// Throws std::invalid_argument if parameters are bad or the model has too many effect states.
  PredictiveControl(const Model& model, const PredictiveParams& params);

  /// Takes effect with the next decision; allocates if the horizon changes. Throws
  /// std::invalid_argument if parameters are bad.
  void setParams(const PredictiveParams& params);
  void avoid(const PlanWalls& walls) override;
  void setClock(TimeBudget::Clock clock) override { budget_.setClock(std::move(clock)); }
  void reset() override;
  void commanded(double time, const Thrusters<double>& thrusters, double lift) override;
  Vector2<double> position(const RigidState<double>& measured) const override;
  void observe(const Observation& observation) override;
  std::string objection() const override;
  Thrusters<double> decide(const Observation& observation) override;
  Thrusters<double> wanted() const override { return wanted_; }

  /// Number of improvements of plans in the last decision.
  int improvements() const { return improvements_; }
  /// The plan of the last decision.
  const TrajectoryOptimizer& plan() const { return *best_.plan; }

 private:
  static constexpr std::size_t kSeeds = 14;
  /// The beginning of a plan: the fastest possible turn, then thrust.
  struct Seed {
    double turn = 0;    ///< [rad], positive to starboard
    double thrust = 0;  ///< relative to full thrust
  };

  /// The plan in use, or one that may replace it; both are continued and improved.
  struct Contender {
    std::unique_ptr<TrajectoryOptimizer> plan;
    std::optional<double> time;  ///< start of the plan [s]; no value before it has one
  };

  void warmStart(double time);
  void search(double time);
  void endSearch();
  bool beginAtSeed(TrajectoryOptimizer& plan);
  void makeSeeds(TrajectoryOptimizer& plan);
  void rateSeeds(TrajectoryOptimizer& plan);
  void follow(const Seed& seed, TrajectoryOptimizer& plan) const;
  Thrusters<double> inputsOf(const Seed& seed, double from, const TrajectoryOptimizer& plan) const;
  bool improve(TrajectoryOptimizer& plan, int iterations);
  double turnTime(double angle) const;

  /// The inputs that turn the craft fastest to one side.
  struct Turn {
    Thrusters<double> inputs;
    double moment;  ///< [N m]
  };
  Turn turnTo(bool starboard) const;

  Model model_;
  Thrusters<double> forward_;  ///< inputs of full forward thrust
  double full_thrust_;         ///< [N]
  std::array<Turn, 2> turns_;  ///< to port, to starboard
  Dynamics<Jet> seen_;         ///< for the state from its measurement
  PredictiveParams params_;
  DisturbanceObserver observer_;
  TimeBudget budget_;
  Contender best_;
  std::array<Contender, 2> others_;
  std::vector<ReferencePoint> references_;
  DisturbanceObserver::Estimate start_;
  std::array<Seed, kSeeds> seeds_;
  std::array<double, kSeeds> seed_costs_{};  ///< [m^2 s]
  bool has_seeds_ = false;                   ///< whether seeds and costs are this decision's
  std::array<bool, kSeeds> is_tried_{};      ///< seeds from which plans began in this search
  int improvements_ = 0;
  std::optional<PlanWalls> walls_;
  Thrusters<double> wanted_;
};

}  // namespace ground
