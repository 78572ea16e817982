#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

#include "ground/estimation/change_monitor.h"

namespace ground {
namespace {

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f", 100 * share);
  return text;
}

}  // namespace

std::string ChangeMonitor::Report::text() const {
  std::string all;
  for (const Change& one : changes) {
    double near = std::abs(one.lower), far = std::abs(one.upper);
    if (one.size < 0) std::swap(near, far);
    const bool same_side = one.lower * one.upper > 0;
    const std::string interval =
        same_side ? percent(near) + " to " + percent(far) : percent(one.lower) + " to " + percent(one.upper);
    char since[48];
    std::snprintf(since, sizeof since, " since %.1f s", one.since - began);
    all += (all.empty() ? "" : "; ") + one.what + (one.size < 0 ? " -" : " +") + percent(std::abs(one.size)) +
           "% (" + interval + ")" + one.details + since +
           (one.alternatives.empty() ? "" : " (or " + one.alternatives + ")");
  }
  return all;
}

}  // namespace ground
