#include "legend.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "ground/nodelets/markers.h"
#include "ground/text_width.h"

namespace ground {
namespace {

constexpr double kLetter = 0.12;  // height [m]
constexpr double kRow = 0.19;     // distance between lines [m]
constexpr double kZ = -0.4;       // above all else; z points down [m]

/// As in "1", "0.25".
std::string seconds(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2g", value);
  return text;
}

/// As in "56 mm, 16 deg".
std::string inWords(double position, double heading) {
  return rounded(1e3 * position) + " mm, " + rounded(180 / M_PI * heading) + " deg";
}

/// Lines of at most some width [m], broken at blanks.
LegendLines wrapped(const LegendLines& lines, double width) {
  LegendLines found;
  for (const LegendLine& line : lines) {
    std::istringstream words(line.text);
    std::string text, word, blank(std::min(line.text.size(), line.text.find_first_not_of(' ')), ' ');
    while (words >> word) {
      if (!text.empty() && kLetter * textWidth(text + blank + word) > width)
        found.push_back({text, line.color}), text.clear(), blank = "    ";
      text += blank + word;
      blank = " ";
    }
    found.push_back({text, line.color});
  }
  return found;
}

}  // namespace

std::string rounded(double value) {
  char text[32];
  const int decimals = std::abs(value) < 0.995 ? 2 : std::abs(value) < 9.95 ? 1 : 0;
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return text;
}

std::string newtons(double value) {
  return value < 0.1 ? rounded(1e3 * value) + " mN" : rounded(value) + " N";
}

void addModel(LegendLines& lines, const ground_msgs::ModelError& error, bool is_better,
              const std::string& color) {
  if (!error.failure.empty()) lines.push_back({error.model + " " + error.failure, palette::kMissing});
  if (!error.excited) {
    lines.push_back({error.model + ": no excitation, the craft hardly moves", color});
    return;
  }
  lines.push_back({error.model + ": " + inWords(error.position_error, error.heading_error) + " after " +
                       seconds(error.horizon) + " s" + (is_better ? ", better" : ""),
                   color});
  lines.push_back({"    noise alone: " + inWords(error.position_noise, error.heading_noise), color});
}

visualization_msgs::MarkerArray legendMarkers(const LegendLines& given, const std::string& frame, double top,
                                              double left, double right) {
  using visualization_msgs::Marker;
  visualization_msgs::MarkerArray array;
  array.markers.push_back(makeMarker(frame, "legend", 0, Marker::CUBE, markerColor(palette::kBlack)));
  array.markers.back().action = Marker::DELETEALL;
  const LegendLines lines = wrapped(given, right - left);
  for (const LegendLine& line : lines) left = std::min(left, right - kLetter * textWidth(line.text));
  for (const LegendLine& line : lines) {
    const int id = static_cast<int>(array.markers.size());
    Marker m = makeMarker(frame, "legend", id, Marker::TEXT_VIEW_FACING, markerColor(line.color));
    m.frame_locked = true;
    m.text = line.text;
    m.scale.z = kLetter;
    m.pose.position = markerPoint(top - (id - 1) * kRow, left + 0.5 * kLetter * textWidth(line.text), kZ);
    array.markers.push_back(m);
  }
  return array;
}

}  // namespace ground
