// Extended Kalman filter along one recording, with the disturbance as additional states.
#pragma once

#include <Eigen/Core>
#include <array>
#include <set>
#include <vector>

#include "free_parameters.h"
#include "ground/identification/grey_box.h"

namespace ground::detail {

constexpr int kLevels = DisturbanceLevels::kCount;

/// Pose, velocity, Ornstein-Uhlenbeck wrench (body), Ornstein-Uhlenbeck force (room), constant
/// wrench, relative change of thrust.
constexpr int kFilterStates = 15;
// First states of:
constexpr int kSlow = 6;       ///< the Ornstein-Uhlenbeck processes
constexpr int kRoom = 9;       ///< those of the force in the room
constexpr int kConstant = 11;  ///< the constants of a run
constexpr int kThrust = 14;    ///< the last of them
using FilterVector = Eigen::Matrix<double, kFilterStates, 1>;
using FilterMatrix = Eigen::Matrix<double, kFilterStates, kFilterStates>;

/// Output of the filter at a sample: everything that derivatives of its innovations need.
struct FilterSample {
  RigidState<double> predicted, filtered;
  Vector3<double> push;                              ///< wrench that acts until the next sample, body
  Rotation<double> middle;                           ///< by the heading in the middle of the step
  Eigen::Matrix<double, kFilterStates + 1, 3> gain;  ///< Kalman gain; its last row is zero
  Matrix3<double> whitening;  ///< inverse Cholesky factor of the innovation's covariance
  Vector3<double> innovation;
  Matrix3<double> seen;                   ///< derivative of the measured pose by the pose
  Eigen::Matrix<double, 6, 6> motion;     ///< derivative of the next pose and velocity by these
  Eigen::Matrix<double, 6, 3> held;       ///< derivative of these by a held acceleration
  Eigen::Matrix<double, 6, 3> response;   ///< derivative of these by a held wrench
  Eigen::Matrix<double, 6, 1> by_thrust;  ///< derivative of these by a relative change of all thrust
  double dt;                              ///< time to the next sample; 0 at the end of a stretch [s]
  double log_density;                     ///< log-density of the pose given those before it; 0 at a start
  bool starts;                            ///< first sample of a stretch: only the trims are carried over
  /// Factor by which the variance of the pose's noise was increased (GreyBoxOptions::cap); 1 if not.
  double inflation;

  bool capped() const { return inflation > 1; }
  Vector3<double> whitened() const { return whitening * innovation; }
  /// Share of the pose in scores. The log-density of a capped pose falls with the logarithm of its
  /// squared distance D, by 3/2 log D, that of others by D/2.
  double weight() const { return capped() ? 3 / whitened().squaredNorm() : 1; }
};

/// Filtered state at a sample: its distribution given the poses up to and including the sample.
struct FilterBelief {
  int sample = 0;
  FilterVector mean = FilterVector::Zero();
  FilterMatrix covariance = FilterMatrix::Zero();
  double log_likelihood = 0;    ///< log-likelihood of the poses so far
  Eigen::MatrixXd sensitivity;  ///< derivative of the mean by free coordinates over scale
};

/// Derivatives of the log-likelihood of one run by coordinates over scale, summed over blocks of
/// time.
struct RunScores {
  Eigen::MatrixXd score;  ///< a row a block
  Eigen::MatrixXd information;
  /// Information if parameters change while the accelerations by the disturbance stay the same,
  /// instead of its wrenches. A craft twice as heavy under twice the wrenches has the same motion,
  /// and the level of the wrench is fitted, so only this information shows that the mass is not
  /// identifiable.
  Eigen::MatrixXd by_acceleration;
};

/// Derivatives of the log-likelihood of one run by the logarithms of the levels.
struct RunLevelScores {
  Eigen::VectorXd score;
  Eigen::MatrixXd information;
};

/// Returns the log-likelihood of a run or of several. Throws std::runtime_error if it is not finite.
double requireFinite(double log_likelihood);

class DisturbanceFilter {
 public:
  /// The run must outlive the filter.
  DisturbanceFilter(const RunData& run, double max_gap);

  /// Filters the run; returns the log-likelihood, which is not finite if the motion is not. Then all
  /// other functions are undefined; see requireFinite(). `levels` are those of this run. Fills in
  /// the beliefs in `kept`, whose samples are given in ascending order.
  [[nodiscard]] double run(const Model& model, const DisturbanceLevels& levels, double cap,
                           std::vector<FilterBelief>* kept = nullptr);

  /// The wrench of the disturbance given all poses: run(), and back by Rauch, Tung and Striebel (1965).
  /// Throws std::runtime_error if the motion is not finite.
  SmoothedWrench smooth(const Model& model, const DisturbanceLevels& levels, double cap);

  /// Derivatives at the last call of run(), by coordinates over scale. Fills in the sensitivity of
  /// the beliefs in `kept`, in ascending order of their samples.
  RunScores scores(const Model& model, const Free& free, double block,
                   std::vector<FilterBelief>* kept = nullptr) const;
  /// Derivatives by the logarithms of the levels, over all samples; zero for the levels `held`.
  RunLevelScores levelScores(const DisturbanceLevels& levels, const std::set<int>& held = {}) const;
  /// Response of the whitened innovations to wrenches held from sample to sample, (3 n, columns).
  /// Three columns of `acting` a wrench: X, Y, N.
  Eigen::MatrixXd responses(const Eigen::MatrixXd& acting) const;

  /// The log-likelihood of blocks of time [s], at most one block a sample.
  Eigen::VectorXd densities(double block) const;

  const std::vector<FilterSample>& samples() const { return samples_; }
  /// The last sample before the next gap.
  std::size_t lastOfStretch(std::size_t sample) const;
  Vector3<double> whitened(std::size_t sample) const { return samples_[sample].whitened(); }
  /// Constant states at the end of the run, and their standard deviations: X, Y, N, thrust.
  Eigen::Vector4d constants() const { return constants_.bottomRows<1>(); }
  const Eigen::Vector4d& constantsSigma() const { return constants_sigma_; }
  /// The filtered Ornstein-Uhlenbeck wrench and force, body, one row a sample.
  const Eigen::MatrixX3d& wrench() const { return wrench_; }
  /// The filtered constant states, one row a sample.
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
  DisturbanceLevels levels_;  ///< levels of the last run()
};

}  // namespace ground::detail
