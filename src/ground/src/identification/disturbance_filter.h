// Extended Kalman filter along one recording, with the disturbance as additional states.
#pragma once

#include <Eigen/Core>
#include <array>
#include <set>
#include <vector>

#include "free_parameters.h"
#include "ground/identification/grey_box.h"
#include "inertial_steps.h"

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

/// A correction of the filter's state by three measured numbers.
struct Correction {
  Eigen::Matrix<double, kFilterStates + 1, 3> gain;     ///< Kalman gain; its last row is zero
  Eigen::Matrix<double, kSensorErrors, 3> sensor_gain;  ///< that of the sensors' errors
  Matrix3<double> whitening;  ///< inverse Cholesky factor of the innovation's covariance
  Vector3<double> innovation;
  double log_density;  ///< log-density of the numbers given those before them; 0 at a start
  /// Factor by which the variance of the numbers' noise was increased (GreyBoxOptions::cap); 1 if not.
  double inflation;

  bool capped() const { return inflation > 1; }
  Vector3<double> whitened() const { return whitening * innovation; }
  /// Share of the numbers in scores. The log-density of capped ones falls with the logarithm of their
  /// squared distance D, by 3/2 log D, that of others by D/2.
  double weight() const { return capped() ? 3 / whitened().squaredNorm() : 1; }
};

/// Output of the filter at a sample: everything that derivatives of its innovations need.
struct FilterSample : Correction {
  RigidState<double> predicted, filtered;
  Vector3<double> push;                   ///< wrench that acts until the next sample, body
  Rotation<double> middle;                ///< by the heading in the middle of the step
  Matrix3<double> seen;                   ///< derivative of the measured pose by the pose
  Eigen::Matrix<double, 6, 6> motion;     ///< derivative of the next pose and velocity by these
  Eigen::Matrix<double, 6, 3> held;       ///< derivative of these by a held acceleration
  Eigen::Matrix<double, 6, 3> response;   ///< derivative of these by a held wrench
  Eigen::Matrix<double, 6, 1> by_thrust;  ///< derivative of these by a relative change of all thrust
  double dt;                              ///< time to the next sample; 0 at the end of a stretch [s]
  bool starts;                            ///< first sample of a stretch: only the trims are carried over
};

/// Correction by what is inertial over the step that ends at a sample, before that by its pose.
struct InertialSample : Correction {
  bool used = false;                           ///< else nothing was measured in this step
  RigidState<double> to;                       ///< predicted state at the step's end
  Eigen::Matrix<double, 3, 6> by_from, by_to;  ///< derivative by pose and velocity at its start and end
  SensorRows by_errors;                        ///< derivative by the sensors' errors
  /// Covariance of the state before and after the step with the numbers.
  Eigen::Matrix<double, kFilterStates + 1, 3> with_before, with;
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
  explicit DisturbanceFilter(const RunData& run);

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
  /// Response of the innovations of whitened(), row by row, to wrenches held from sample to sample.
  /// Three columns of `acting` a wrench: X, Y, N.
  Eigen::MatrixXd responses(const Eigen::MatrixXd& acting) const;

  /// The log-likelihood of blocks of time [s], at most one block a sample.
  Eigen::VectorXd densities(double block) const;

  const std::vector<FilterSample>& samples() const { return samples_; }
  /// The last sample before the next gap.
  std::size_t lastOfStretch(std::size_t sample) const;
  /// Whitened innovations, a row a sample: of the pose, then of what is inertial in the step before it if
  /// the run has that, zeros where none was measured.
  Eigen::MatrixXd whitened() const;
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
  /// The InertialSample of a sample; null if it has none.
  const InertialSample* inertialAt(std::size_t sample) const {
    return inertial_.empty() || !inertial_[sample].used ? nullptr : &inertial_[sample];
  }

  const RunData& run_;
  const Eigen::MatrixX3d& poses_;
  std::vector<bool> starts_;
  std::vector<FilterSample> samples_;
  InertialSteps steps_;
  std::vector<InertialSample> inertial_;  ///< empty if the run has nothing inertial
  Eigen::MatrixX3d wrench_;
  Eigen::MatrixX4d constants_;
  Eigen::Vector4d constants_sigma_;
  DisturbanceLevels levels_;  ///< levels of the last run()
};

}  // namespace ground::detail
