#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "ground/identification/disturbance_levels.h"
#include "ground/identification/simulation_error.h"

namespace ground {

/// A model and the levels of the disturbance: a point of the search space.
struct GreyBoxPoint {
  Model model;
  DisturbanceLevels levels;
  /// Logarithm of the factor on the disturbance of each run; empty means a factor of 1 for all
  /// runs.
  std::vector<double> log_scales;
};

struct GreyBoxOptions {
  std::vector<std::string> free;  ///< parameters to fit; empty means only the levels
  bool levels = true;             ///< whether to fit the levels
  std::vector<std::string> held;  ///< levels that are not fitted (DisturbanceLevels::names)
  /// Limit of a pose's squared Mahalanobis distance (3 degrees of freedom). The noise of a pose
  /// beyond it is increased so that its distance equals the limit. Infinity: Gaussian likelihood.
  double cap = 25;
  /// Whether the start is near the maximum. Otherwise the search begins with a Gaussian likelihood and
  /// lowers the limit in steps.
  bool warm = false;
  int max_iterations = 60;
  int threads = 1;
  double least_gain = 0.01;  ///< gain of the log-posterior below which the search ends
};

/// Wrench and relative change of thrust that are constant within a run and differ between runs.
struct RunTrim {
  Vector3<double> wrench, wrench_sigma;  ///< X, Y [N], N [N m], and standard deviations
  double thrust, thrust_sigma;           ///< relative change, and its standard deviation
};

struct GreyBoxFit {
  GreyBoxPoint point;
  double log_likelihood = 0;   ///< log-likelihood of the poses
  double log_posterior = 0;    ///< with the priors of levels and parameters
  std::vector<double> by_run;  ///< log-likelihood of each run
  std::vector<RunTrim> trims;
  Eigen::MatrixXd information;              ///< Fisher information of coordinates over scale
  std::vector<double> scale;                ///< scale of each free parameter's coordinate
  std::vector<FittedParameter> parameters;  ///< the free parameters, with intervals
  Eigen::MatrixXd level_information;        ///< Fisher information of log levels, with the prior
  int iterations = 0;
  bool converged = false;
};

/// First and second derivatives of the log-likelihood at a point, for score tests (Rao 1948).
struct GreyBoxScores {
  std::vector<double> scale;    ///< scales; derivatives are by coordinate / scale
  Eigen::MatrixXd score;        ///< first derivatives, a row for each block of time
  std::vector<int> run;         ///< run of each block
  Eigen::MatrixXd information;  ///< Fisher information: minus the expected second derivatives
};

/// Output of the filter along one run.
struct GreyBoxResiduals {
  /// Innovations of the pose and, of a run with inertial samples, of their mean over the step before
  /// it (n, 3 or 6); independent, of variance one if the model is true. Zero: no inertial sample.
  Eigen::MatrixXd whitened;
  std::vector<bool> scored;    ///< false at the first pose of a stretch
  Eigen::MatrixXd states;      ///< filtered x, y [m], psi [rad], u, v [m/s], r [rad/s], (n, 6)
  Eigen::MatrixX3d wrench;     ///< filtered disturbance in both frames without trim, body [N], [N m]
  Eigen::MatrixX4d constants;  ///< filtered trim: X, Y [N], N [N m], relative change of thrust
  Eigen::MatrixXd responses;   ///< response of the whitened innovations, row by row
};

/// The wrench of the disturbance along a run given all its poses, without the wrench of the thrust's change:
/// X, Y [N], N [N m], body, one row a sample.
struct SmoothedWrench {
  Eigen::MatrixX3d wrench, sigma;  ///< and its standard deviations
};

struct ForecastOptions {
  std::vector<int> starts;       ///< samples of the run, ascending
  std::vector<double> horizons;  ///< horizon from each start [s]
  /// The scale of the run's disturbance is only the expected one. The forecast averages over seven values
  /// about it, weighted by the prior and by the likelihood of the poses up to each start.
  bool unknown_scale = false;
  /// Uncertain parameters, with information and scale as in GreyBoxFit; all others count as known.
  std::vector<std::string> free;
  Eigen::MatrixXd information;
  std::vector<double> scale;
  double part = 0.9;  ///< fraction of the draws inside a band
  int draws = 99;
  /// Standard deviations of the noise of smoothed u, v [m/s], r [rad/s].
  Vector3<double> velocity_noise = Vector3<double>::Zero();
  double cap = 25;  ///< see GreyBoxOptions
  unsigned seed = 1;
};

/// Prediction of a run from one sample, without later poses: a row for each sample, beginning with
/// the start. Columns: measured x, y [m], psi [rad], u, v [m/s], r [rad/s], including noise.
struct Forecast {
  int first;                        ///< sample of the run at which it starts
  Eigen::MatrixXd mean, deviation;  ///< (n, 6)
  Eigen::MatrixXd low, high;        ///< ends of the band, (n, 6)
};

/// Stochastic grey-box likelihood of recorded poses (Kristensen, Madsen and Jorgensen 2004): the
/// disturbance is a part of the model.
///
///     eta' = R(psi) nu,  M nu' = tau(nu, inputs) + d + R(psi)' d_w + b + s tau_thrust,
///     z = h(eta) + e,  w = (psi', a_x, a_y) + e_w
///
/// w: yaw rate and specific force at the IMU's place, means over the step between two poses, of runs that
/// have InertialData.
/// d is an Ornstein-Uhlenbeck plus a white wrench in the body frame, d_w an Ornstein-Uhlenbeck
/// force in the room's. The wrench b and the
/// relative change of thrust s are constant in a run and normal over the runs. e is white noise of
/// the poses.
///
/// An extended Kalman filter runs along each recording; its innovations and their covariances give
/// the likelihood. Parameters move by Gauss-Newton steps on the whitened innovations with fixed
/// filter gains, which depend on the parameters only through the linearisation. Levels move by
/// exact Fisher scoring. The two alternate, because their joint information is zero. After a gap
/// the filter restarts the motion and keeps b and s.
///
///     const GreyBox box({run}, model.body);
///     GreyBoxOptions options;
///     options.free = {"k", "I_z"};
///     const GreyBoxFit fit = box.fit(box.start(model), options);
///     const std::vector<FittedParameter> found = box.intervals(fit, options);
///
/// Likelihoods of two fits compare only with the same runs, noise of poses and cap. Begin at start(): from
/// low levels the search may not come back.
class GreyBox {
 public:
  /// The priors of the levels are relative to the craft's full thrust. Throws std::invalid_argument
  /// if there is no run or checkRun() refuses one. All functions throw it
  /// on invalid arguments, and std::runtime_error if the model's motion along a run is not finite.
  GreyBox(std::vector<RunData> runs, const Body<double>& craft);

  /// Start of a search: the prior's medians, except for a disturbance of 10% of full thrust, and a
  /// force of 3% in the room. If levels start low, the filter trusts the model too much and diverges.
  GreyBoxPoint start(const Model& model) const;

  /// Maximises the posterior from a start, which must have positive levels.
  GreyBoxFit fit(const GreyBoxPoint& start, const GreyBoxOptions& options) const;

  /// The free parameters of a fit under the same options, with 95% intervals that include the
  /// uncertainty of the levels: Student's t with degrees of freedom by Satterthwaite (1946). The
  /// intervals in GreyBoxFit take the levels as known. Throws std::invalid_argument if the levels
  /// were not fitted.
  std::vector<FittedParameter> intervals(const GreyBoxFit& fit, const GreyBoxOptions& options) const;

  /// Log-likelihood of each run at a point, by blocks of about `block` seconds.
  std::vector<Eigen::VectorXd> likelihood(const GreyBoxPoint& point, double cap, double block,
                                          int threads) const;

  /// Derivatives by the named parameters, by blocks of about `block` seconds.
  GreyBoxScores scores(const GreyBoxPoint& point, const std::vector<std::string>& parameters, double cap,
                       double block, int threads) const;

  /// Filters one run. `acting`: wrenches over time whose responses to compute, a column each, held
  /// from each sample to the next. Each wrench has three columns of `acting`: X, Y [N], N [N m], body.
  GreyBoxResiduals residuals(const GreyBoxPoint& point, int run, double cap,
                             const Eigen::MatrixXd& acting) const;

  /// The wrench that the model lacks along one run, given all its poses (Rauch, Tung and Striebel 1965).
  SmoothedWrench smooth(const GreyBoxPoint& point, int run, double cap) const;

  /// Predicts one run from each start to the horizon, the next gap or the end of the run. The
  /// filtered state at the start is the Gaussian of motion, wrench and trims given the poses so
  /// far. Motions of the stochastic model are drawn from it, because a linearised covariance is too
  /// large once the heading is uncertain by a radian (2.6 times in position after 4 s on real
  /// runs). Uncertain parameters are drawn, too, and shift the filtered state.
  std::vector<Forecast> forecast(const GreyBoxPoint& point, int run, const ForecastOptions& options) const;

  const std::vector<RunData>& runs() const { return runs_; }

 private:
  /// Throws std::invalid_argument if there is no such run.
  std::size_t indexOf(int run) const;
  /// Throws std::invalid_argument unless the levels of all runs and the cap are valid.
  void check(const GreyBoxPoint& point, double cap) const;

  std::vector<RunData> runs_;
  LevelPrior prior_;
};

}  // namespace ground
