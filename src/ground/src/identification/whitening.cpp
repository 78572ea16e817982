#include "whitening.h"

#include <cmath>
#include <cstring>

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

template <typename V>
void Whitening::filter(double* rows, Eigen::Index stride) const {
  V drift[3] = {}, rate[3] = {};
  for (std::size_t i = 0; i < deviation_.size(); ++i)
    for (int c = 0; c < 3; ++c, rows += stride) {
      V row;
      std::memcpy(&row, rows, sizeof row);
      const V innovation = row - drift[c];
      row = innovation / deviation_[i](c);
      std::memcpy(rows, &row, sizeof row);
      if (white_) continue;
      rate[c] += gain_rate_[i](c) * innovation;
      drift[c] += gain_position_[i](c) * innovation + step_[i] * rate[c];
    }
}

void Whitening::apply(Eigen::VectorXd& errors) const { filter<double>(errors.data(), 1); }

void Whitening::apply(Derivatives& columns) const {
  for (Eigen::Index first = 0; first < columns.cols(); first += 8)
    filter<Vec8>(columns.data() + first, columns.cols());
}

}  // namespace ground
