// Extended Kalman filter of one recording, with the disturbance as states of its own.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "free_parameters.h"
#include "ground/identification/disturbance_levels.h"
#include "ground/identification/simulation_error.h"

namespace ground::detail {

constexpr int kLevels = DisturbanceLevels::kCount;

/// Pose, velocity, Ornstein-Uhlenbeck wrench, constant wrench, relative change of thrust.
constexpr int kFilterStates = 13;
using Vector13 = Eigen::Matrix<double, kFilterStates, 1>;
using Matrix13 = Eigen::Matrix<double, kFilterStates, kFilterStates>;

/// What the filter leaves behind at a sample: all that derivatives of its innovations need.
struct FilterSample {
  RigidState<double> predicted, filtered;
  Vector3<double> push;                        ///< wrench that acts until the next sample
  double gain[kFilterStates][3];               ///< of the innovation
  double whitening[3][3];                      ///< inverse of the root of its covariance, lower
  Vector3<double> innovation;
  double seen[3][6];                           ///< derivative of the pose by pose and velocity
  double motion[6][6];                         ///< of the next pose and velocity by these
  double response[6][3];                       ///< of these by a wrench that is held
  double by_thrust[6];                         ///< of these by a relative change of all thrust
  double dt;                                   ///< to the next sample; 0 at the end of a stretch
  double log_density;                          ///< of the pose after those before it; 0 at a start
  bool starts;                                 ///< a stretch: nothing is carried over but trims
  bool capped;                                 ///< counts as noisier than its level says
};

/// What the filter believes at a sample, having seen its pose.
struct FilterBelief {
  int sample = 0;
  Vector13 mean = Vector13::Zero();
  Matrix13 covariance = Matrix13::Zero();
  double log_likelihood = 0;  ///< of the poses so far
  Eigen::MatrixXd sensitivity;  ///< of the mean to free parameters' coordinates over scale
};

/// Derivatives of the log-likelihood of one run, added up over blocks of time.
struct RunScores {
  Eigen::MatrixXd score;        ///< a row a block
  Eigen::MatrixXd information;
  /// The information if not the disturbance's wrench stays the same when parameters change but the
  /// acceleration that was seen. A craft twice as heavy under twice the wrenches moves alike, and
  /// the wrench's level is fitted: only by accelerations does the mass stay as unknown as it is.
  Eigen::MatrixXd by_acceleration;
};

/// The same by the logarithms of the levels.
struct RunLevelScores {
  Eigen::VectorXd score;
  Eigen::MatrixXd information;
};

class DisturbanceFilter {
 public:
  /// The run has to outlive it.
  DisturbanceFilter(const RunData& run, double max_gap);

  /// Filters the run; returns the log-likelihood, not finite where the motion is not. Levels are
  /// those of this run. Fills in `kept`, beliefs whose samples are given in ascending order.
  double run(const Model& model, const DisturbanceLevels& levels, double cap,
             std::vector<FilterBelief>* kept = nullptr);

  /// Derivatives at the last call of run(), by coordinates over scale. Fills in the sensitivity of
  /// the beliefs in `kept`, in ascending order of their samples.
  RunScores scores(const Model& model, const Free& free, double block,
                   std::vector<FilterBelief>* kept = nullptr) const;
  /// By the logarithms of the levels, all samples together.
  RunLevelScores levelScores(const DisturbanceLevels& levels) const;
  /// Whitened innovations' response to wrenches, held from sample to sample, (3 n, columns).
  Eigen::MatrixXd responses(const Eigen::MatrixXd& acting, const std::vector<int>& channels) const;

  /// The log-likelihood of blocks of time; not finite where the motion is not.
  Eigen::VectorXd densities(double block) const;

  const std::vector<FilterSample>& samples() const { return samples_; }
  /// The last sample before the next gap.
  std::size_t lastOfStretch(std::size_t sample) const;
  Vector3<double> whitened(std::size_t sample) const;
  /// Constant states at the end of the run, and their standard deviations: X, Y, N, thrust.
  Eigen::Vector4d constants() const { return constants_.bottomRows<1>(); }
  const Eigen::Vector4d& constantsSigma() const { return constants_sigma_; }
  /// The Ornstein-Uhlenbeck wrench as filtered, one row a sample.
  const Eigen::MatrixX3d& wrench() const { return wrench_; }
  /// The constant states as filtered, one row a sample.
  const Eigen::MatrixX4d& constantsSoFar() const { return constants_; }

 private:
  int blockCount(double block) const;
  int blockOf(std::size_t sample, int blocks) const;

  const RunData& run_;
  const Eigen::MatrixX3d& poses_;
  std::vector<bool> starts_;
  std::vector<FilterSample> samples_;
  Eigen::MatrixX3d wrench_;
  Eigen::MatrixX4d constants_;
  Eigen::Vector4d constants_sigma_;
  DisturbanceLevels levels_;  ///< of the last run()
};

}  // namespace ground::detail
