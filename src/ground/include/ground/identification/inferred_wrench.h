#pragma once

#include <Eigen/Core>
#include <vector>

#include "ground/identification/run_data.h"

namespace ground {

/// How the missing wrench of a model is taken to vary.
enum class WrenchNature {
  kRandomWalk,  ///< a state that drifts: what is inferred over time
  kWhite        ///< without memory: whatever has memory stays in the innovations
};

/// Noise levels of the filter, standard deviations.
struct WrenchNoise {
  double force = 0;     ///< X and Y: random walk [N/sqrt(s)] or white [N sqrt(s)]
  double moment = 0;    ///< N: random walk [N m/sqrt(s)] or white [N m sqrt(s)]
  double position = 0;  ///< of measured x and y [m]
  double heading = 0;   ///< of the measured psi [rad]
};

/// Measured poses minus their predictions by the model from the poses before.
struct Innovations {
  /// Ahead, to starboard and in heading, each divided by its standard deviation: white and of
  /// variance one when the model is true. Outliers are as large as the limit beyond which their
  /// pose counts as noisier. One row a sample.
  Eigen::MatrixX3d normalised;
  std::vector<bool> valid;  ///< false while a stretch's initial state is being found
  double log_likelihood = 0;
};

/// Missing wrench X, Y [N], N [N m] of a model, in its body frame.
struct InferredWrench {
  Eigen::MatrixX3d wrench;  ///< one row a sample
  Eigen::MatrixX3d sigma;   ///< its standard deviations
  /// Response of this estimator to given wrenches, a column each: what it would infer of them from
  /// the same poses.
  Eigen::MatrixXd responses;
};

/// Missing wrench of a model along a run. The state (x, y, psi, u, v, r) is augmented by the wrench
/// (X, Y, N); it is found from the poses by Kalman filter and Rauch-Tung-Striebel smoother. The
/// model is linearised along the run's smoothed motion, exactly (by Jets through the integrator,
/// inputs changing when they do); the remainder is of second order in the motion's error over one
/// sample. After a gap everything starts anew.
class WrenchFilter {
 public:
  /// Poses are the run's measured ones, headings wrapped or not; the model is linearised along its
  /// smoothed motion. Throws std::invalid_argument when lengths differ, a value is not finite or
  /// times descend, std::runtime_error when the model's motion is not finite.
  WrenchFilter(const Model& model, const RunData& run, double max_gap = 0.1);

  /// The noise levels under which the poses are likeliest (innovation form of the likelihood),
  /// within a factor of about 1.3. Outliers count as if their pose had been as noisy as it takes.
  WrenchNoise likeliestNoise(WrenchNature nature) const;

  /// Innovations of the filter at given noise levels.
  Innovations innovations(WrenchNature nature, const WrenchNoise& noise) const;

  /// The random-walk wrench from all poses. `acting`: a column for each wrench whose response is
  /// wanted, its size at each sample, held until the next; `channels` says on which of X, Y, N
  /// (0, 1, 2) each acts; a column of the responses is on the same channel. Throws
  /// std::invalid_argument when their sizes differ or a channel is none of these.
  InferredWrench smooth(const WrenchNoise& noise, const Eigen::MatrixXd& acting = {},
                        const std::vector<int>& channels = {}) const;

  /// The part of the model's own wrench that the thrusters' inputs cause, one row a sample.
  const Eigen::MatrixX3d& modelThrust() const { return thrust_; }
  /// Stretches without a gap: first sample of each, then the number of samples.
  const std::vector<int>& stretches() const { return stretches_; }

 private:
  using Vector9 = Eigen::Matrix<double, 9, 1>;
  using Matrix9 = Eigen::Matrix<double, 9, 9>;
  using Matrix39 = Eigen::Matrix<double, 3, 9>;

  /// One sample, and the way to the next.
  struct Sample {
    Vector3<double> deviation;  ///< of the pose from what is seen at the linearisation point
    Matrix39 seen;              ///< by the state
    double heading;             ///< of the body's axes [rad]
    Matrix9 transition;
    Vector9 offset;  ///< of the model from the next linearisation point
    double dt;
  };
  struct Pass;
  class Lineariser;

  void linearise(const Model& model, const RunData& run, const Eigen::MatrixX3d& poses);
  Matrix9 initialCovariance(WrenchNature nature, const WrenchNoise& noise) const;
  Matrix9 processNoise(const Sample& sample, WrenchNature nature, const WrenchNoise& noise) const;
  Innovations filter(WrenchNature nature, const WrenchNoise& noise, Pass* pass) const;
  void respond(const Pass& pass, const Eigen::MatrixXd& acting, const std::vector<int>& channels,
               Eigen::MatrixXd& responses) const;

  std::vector<Sample> samples_;
  std::vector<int> stretches_;
  Eigen::MatrixX3d thrust_;
  double force_scale_, moment_scale_;
};

}  // namespace ground
