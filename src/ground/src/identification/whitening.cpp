#include "whitening.h"

namespace ground {

Whitening<double> independentErrors(std::size_t samples, const Vector3<double>& deviation) {
  const std::array<double, 3> over = {1 / deviation(0), 1 / deviation(1), 1 / deviation(2)};
  Whitening<double> result;
  result.over_deviation.assign(samples, over);
  return result;
}

Whitening<double> driftingErrors(const std::vector<double>& times, int first, int last,
                                 const Vector3<double>& noise, const Vector3<double>& disturbance) {
  const auto count = static_cast<std::size_t>(last - first + 1);
  Whitening<double> result = independentErrors(count, noise);
  if (disturbance.isZero(0.0)) return result;
  result.foresight.resize(count);
  for (int i = first; i < last; ++i) result.foresight[i - first].step = times[i + 1] - times[i];
  for (int c = 0; c < 3; ++c) {
    const double r = noise(c) * noise(c), q = disturbance(c) * disturbance(c);
    double pp = 0, pv = 0, vv = 0;  // covariance; the initial state is a parameter of its own
    for (std::size_t i = 0; i < count; ++i) {
      Whitening<double>::Foresight& now = result.foresight[i];
      const double s = pp + r, kp = pp / s, kv = pv / s;
      result.over_deviation[i][c] = 1 / std::sqrt(s);
      now.gain_position[c] = kp;
      now.gain_rate[c] = kv;
      vv -= kv * pv;
      pv -= kv * pp;
      pp -= kp * pp;
      const double h = now.step;
      pp += 2 * h * pv + h * h * vv + q * h * h * h / 3;
      pv += h * vv + q * h * h / 2;
      vv += q * h;
    }
  }
  return result;
}

}  // namespace ground
