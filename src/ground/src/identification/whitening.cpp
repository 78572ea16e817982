#include "whitening.h"

#include <cmath>

namespace ground {

Whitening::Whitening(const std::vector<double>& times, int first, int last,
                     const Vector3<double>& noise, const Vector3<double>& disturbance)
    : white_(disturbance.isZero(0.0)) {
  const auto samples = static_cast<std::size_t>(last - first + 1);
  deviation_.resize(samples);
  gain_position_.resize(samples);
  gain_rate_.resize(samples);
  step_.assign(samples, 0.0);
  for (int i = first; i < last; ++i) step_[i - first] = times[i + 1] - times[i];
  for (int c = 0; c < 3; ++c) {
    const double r = noise(c) * noise(c), q = disturbance(c) * disturbance(c);
    double pp = 0, pv = 0, vv = 0;  // covariance; the initial state is a parameter of its own
    for (std::size_t i = 0; i < samples; ++i) {
      const double s = pp + r, kp = pp / s, kv = pv / s;
      deviation_[i](c) = std::sqrt(s);
      gain_position_[i](c) = kp;
      gain_rate_[i](c) = kv;
      vv -= kv * pv;
      pv -= kv * pp;
      pp -= kp * pp;
      const double h = step_[i];
      pp += 2 * h * pv + h * h * vv + q * h * h * h / 3;
      pv += h * vv + q * h * h / 2;
      vv += q * h;
    }
  }
}

void Whitening::apply(Eigen::Ref<Eigen::MatrixXd> rows) const {
  for (Eigen::Index column = 0; column < rows.cols(); ++column) {
    double* at = rows.col(column).data();
    Vector3<double> drift = Vector3<double>::Zero(), rate = Vector3<double>::Zero();
    for (std::size_t i = 0; i < deviation_.size(); ++i, at += 3) {
      Eigen::Map<Vector3<double>> row(at);
      if (white_) {
        row.array() /= deviation_[i].array();
        continue;
      }
      const Vector3<double> innovation = row - drift;
      row = innovation.cwiseQuotient(deviation_[i]);
      drift += gain_position_[i].cwiseProduct(innovation);
      rate += gain_rate_[i].cwiseProduct(innovation);
      drift += step_[i] * rate;
    }
  }
}

}  // namespace ground
