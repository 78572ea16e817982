#include "legend.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "ground/nodelets/markers.h"
#include "ground/text_width.h"

namespace ground {
namespace {

constexpr double kRow = 1.55;    // distance between lines, relative to a letter
constexpr double kPatch = 0.8;   // side of a patch of colour, relative to a letter
constexpr double kIndent = 1.3;  // from a patch's left edge to the text, relative to a letter
constexpr double kZ = -0.4;      // above all else; z points down [m]

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

/// Lines of at most some width, relative to a letter, broken at blanks.
LegendLines wrapped(const LegendLines& lines, double width) {
  LegendLines found;
  for (const LegendLine& line : lines) {
    std::istringstream words(line.text);
    std::string text, word, blank(std::min(line.text.size(), line.text.find_first_not_of(' ')), ' ');
    while (words >> word) {
      if (!text.empty() && textWidth(text + blank + word) > width)
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
  lines.push_back({"    noise floor: " + inWords(error.position_noise, error.heading_noise), color});
}

visualization_msgs::MarkerArray legendMarkers(const LegendLines& given, const std::string& frame,
                                              LegendPlace place) {
  using visualization_msgs::Marker;
  visualization_msgs::MarkerArray array;
  array.markers.push_back(makeMarker(frame, "legend", 0, Marker::CUBE, markerColor(palette::kBlack)));
  array.markers.back().action = Marker::DELETEALL;
  if (given.empty()) return array;
  const double letter = place.letter;
  const auto add = [&](int type, const std::string& color, double row, double aside) -> Marker& {
    const int id = static_cast<int>(array.markers.size());
    array.markers.push_back(makeMarker(frame, "legend", id, type, markerColor(color)));
    Marker& m = array.markers.back();
    m.frame_locked = true;
    m.pose.position = markerPoint(place.top - row * kRow * letter, place.left + aside * letter, kZ);
    return m;
  };
  const LegendLines lines = wrapped(given, (place.right - place.left) / letter - kIndent);
  for (const LegendLine& line : lines)
    place.left = std::min(place.left, place.right - letter * (kIndent + textWidth(line.text)));
  double width = 0;
  for (const LegendLine& line : lines) width = std::max(width, kIndent + textWidth(line.text));
  const auto rows = static_cast<double>(lines.size());
  Marker& panel = add(Marker::CUBE, "#ffffff", 0.5 * (rows - 1), 0.5 * width);
  panel.pose.position.z = 0.5 * kZ;
  panel.scale.x = kRow * rows * letter;
  panel.scale.y = width * letter;
  panel.scale.z = 0.001;
  for (std::size_t row = 0; row < lines.size(); ++row) {
    const LegendLine& line = lines[row];
    const auto down = static_cast<double>(row);
    Marker& text = add(Marker::TEXT_VIEW_FACING, palette::kBlack, down, kIndent + 0.5 * textWidth(line.text));
    text.text = line.text;
    text.scale.z = letter;
    if (line.text[0] == ' ') continue;
    Marker& patch = add(Marker::CUBE, line.color, down, 0.5 * kPatch);
    patch.scale.x = patch.scale.y = kPatch * letter;
    patch.scale.z = 0.001;
  }
  return array;
}

}  // namespace ground
