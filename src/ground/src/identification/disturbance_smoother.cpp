// Rauch-Tung-Striebel smoother of the disturbance filter.
#include <Eigen/Cholesky>

#include "disturbance_filter.h"
#include "filter_steps.h"

namespace ground::detail {
namespace {

using WrenchByState = Eigen::Matrix<double, 3, kFilterStates>;

/// The states at one sample and the next one given the poses until the first and what is inertial between
/// them.
struct Prediction {
  FilterVector before, mean;
  FilterMatrix covariance_before, covariance;
  FilterMatrix across;  ///< covariance of the next state with the first

  Prediction(const FilterBelief& from, const FilterSample& s, const FilterSample& next,
             const InertialSample* inertial, const Random& random)
      : before(from.mean), mean(from.mean), covariance_before(from.covariance) {
    FilterMatrix F = FilterMatrix::Identity();
    Covariance moved;
    moved.P.topLeftCorner<kFilterStates, kFilterStates>() = from.covariance;
    if (next.starts) {  // only the constants of the run are carried over
      F.topRows<kConstant>().setZero();
      mean.segment<kProcesses>(kSlow).setZero();
      moved.start(random, false);
    } else if (s.dt > 0) {
      const Random::Step step = random.over(s.dt);
      F.topRows<6>() = motionByState(s, step).leftCols<kFilterStates>();
      F.diagonal().segment<kProcesses>(kSlow) = step.left;
      mean.segment<kProcesses>(kSlow).array() *= step.left;
      moved.move(s, step);
    }
    covariance = moved.P.topLeftCorner<kFilterStates, kFilterStates>();
    across = F * from.covariance;
    if (inertial) correct(*inertial);
    mean.head<6>() << next.predicted.eta, next.predicted.nu;
  }

 private:
  void correct(const InertialSample& s) {
    using ByState = Eigen::Matrix<double, kFilterStates, 3>;
    const ByState with_before = s.with_before.topRows<kFilterStates>();
    const ByState gain_before = with_before * s.whitening.transpose() * s.whitening;
    const ByState gain = s.gain.topRows<kFilterStates>(), with = s.with.topRows<kFilterStates>();
    before += gain_before * s.innovation;
    mean += gain * s.innovation;
    covariance_before -= gain_before * with_before.transpose();
    covariance -= gain * with.transpose();
    across -= gain * with_before.transpose();
  }
};

/// The derivative of the wrench in the body frame by the state, at a heading.
WrenchByState wrenchByState(double heading) {
  WrenchByState W = WrenchByState::Zero();
  W.middleCols<3>(kSlow).setIdentity();
  W.middleCols<3>(kConstant).setIdentity();
  W.col(kRoom).head<2>() = worldToBody<double>(heading, Vector2<double>(1, 0));
  W.col(kRoom + 1).head<2>() = worldToBody<double>(heading, Vector2<double>(0, 1));
  return W;
}

}  // namespace

SmoothedWrench DisturbanceFilter::smooth(const Model& model, const DisturbanceLevels& levels, double cap) {
  std::vector<FilterBelief> filtered(samples_.size());
  for (std::size_t k = 0; k < filtered.size(); ++k) filtered[k].sample = static_cast<int>(k);
  requireFinite(run(model, levels, cap, &filtered));
  const Random random(levels, run_.noise);
  const auto count = static_cast<Eigen::Index>(filtered.size());
  SmoothedWrench result{Eigen::MatrixX3d(count, 3), Eigen::MatrixX3d(count, 3)};
  FilterVector x = filtered.back().mean;
  FilterMatrix P = filtered.back().covariance;
  for (std::size_t k = filtered.size(); k-- > 0;) {
    if (k + 1 < filtered.size()) {
      // x_k|n = x_k|k + G (x_k+1|n - x_k+1|k), P_k|n = P_k|k + G (P_k+1|n - P_k+1|k) G',
      // G = P_k|k F' P_k+1|k^-1; scaled, because the states differ by orders of magnitude.
      const Prediction next(filtered[k], samples_[k], samples_[k + 1], inertialAt(k + 1), random);
      const FilterVector scale = next.covariance.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
      const FilterMatrix even = scale.asDiagonal() * next.covariance * scale.asDiagonal();
      const FilterMatrix across = scale.asDiagonal() * next.across;
      const FilterMatrix G = (scale.asDiagonal() * even.ldlt().solve(across)).transpose();
      x = next.before + G * (x - next.mean);
      P = next.covariance_before + G * (P - next.covariance) * G.transpose();
    }
    const WrenchByState W = wrenchByState(x(2));
    result.wrench.row(static_cast<Eigen::Index>(k)) = W * x;
    result.sigma.row(static_cast<Eigen::Index>(k)) =
        (W * P * W.transpose()).diagonal().cwiseMax(0).cwiseSqrt();
  }
  return result;
}

}  // namespace ground::detail
