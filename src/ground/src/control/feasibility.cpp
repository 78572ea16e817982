#include "ground/control/feasibility.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace ground {
namespace {

constexpr int kInstants = 4000;
constexpr double kTolerance = 0.01;   // relative to full thrust and to full moment
constexpr double kNegligible = 1e-3;  // relative to full thrust; with less, any heading is possible

struct Demand {
  double thrust = 0;  ///< size of the force along which the craft must head [N]
  double heading = 0, yaw_rate = 0;
  double surge = 0;  ///< force of the thrusters [N]
};

Demand demand(const ReferencePoint& at, const Body<double>& body) {
  const Vector2<double> push = body.m * at.p_ddot + body.Y_v * at.p_dot;
  const Vector2<double> change = body.m * at.p_dddot + body.Y_v * at.p_ddot;
  const double size = push.norm();
  if (size == 0) return {};
  const Vector2<double> along = push / size;
  return {size, std::atan2(push.y(), push.x()),
          (push.x() * change.y() - push.y() * change.x()) / (size * size),
          along.dot(body.m * at.p_ddot + body.X_u * at.p_dot)};
}

template <typename... Args>
std::string format(const char* text, Args... args) {
  char buffer[240];
  std::snprintf(buffer, sizeof buffer, text, args...);
  return buffer;
}

}  // namespace

std::string infeasibility(const ReferenceTrajectory& reference, const Body<double>& body) {
  const double most = 2 * body.k * body.input_max, full_moment = body.l * most / 2;
  const double duration = reference.extent();
  const double h = duration / kInstants;
  std::string message;
  double worst = kTolerance;
  const auto report = [&](double excess, const std::string& text) {
    if (excess <= worst) return;
    worst = excess;
    message = text;
  };
  Demand last;
  double last_time = 0;
  for (int i = 0; i < kInstants; ++i) {
    const double t = (i + 0.5) * h;
    const Demand now = demand(reference.at(t), body);
    if (now.thrust < kNegligible * most) continue;
    if (now.surge > most)
      report(now.surge / most - 1,
             format("at %.2f s it takes a thrust of %.3g N, but full thrust is %.3g N", t,
                    now.surge, most));
    if (now.surge < 0)
      report(-now.surge / most,
             format("at %.2f s it takes a backward thrust of %.3g N, but the thrusters only push "
                    "forward",
                    t, -now.surge));
    // The heading follows the force. A jump of the heading would take an infinite moment.
    const double turned = std::abs(wrapAngle(now.heading - last.heading));
    if (last.thrust > 0 && turned > 1 && t - last_time < 0.25)
      report(10 + turned,
             format("at %.2f s the craft would have to turn by %.0f degrees within %.2f s", t,
                    turned * 180 / M_PI, t - last_time));
    const double before = demand(reference.at(t - h / 4), body).yaw_rate;
    const double after = demand(reference.at(t + h / 4), body).yaw_rate;
    const double moment = body.I_z * (after - before) / (h / 2) + body.N_r * now.yaw_rate;
    const double limit = body.l * std::max(0.0, std::min(now.surge, most - now.surge));
    report(
        (std::abs(moment) - limit) / full_moment,
        format("at %.2f s it takes a yaw moment of %.3g N m, but with a thrust of %.3g N the limit "
               "is %.3g N m",
               t, std::abs(moment), now.surge, limit));
    last = now;
    last_time = t;
  }
  return message.empty() ? "" : "the craft cannot follow it exactly: " + message;
}

}  // namespace ground
