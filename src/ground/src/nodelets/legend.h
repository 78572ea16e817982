#pragma once

#include <ground_msgs/ModelError.h>
#include <visualization_msgs/MarkerArray.h>

#include <string>
#include <vector>

namespace ground {

/// A line of the legend of rviz, with the colour of what it explains.
struct LegendLine {
  std::string text, color;
  bool operator==(const LegendLine& other) const { return text == other.text && color == other.color; }
};

using LegendLines = std::vector<LegendLine>;

/// Adds how far a model is off, beside the noise floor, and since when it has failed.
void addModel(LegendLines& lines, const ground_msgs::ModelError& error, bool is_better,
              const std::string& color);
/// Two digits, as in "0.45", "62", "560".
std::string rounded(double value);
/// A force, as in "62 mN", "0.56 N".
std::string newtons(double value);

/// Where a legend is in a frame as seen from above, with x upwards and y to the right [m].
struct LegendPlace {
  double top, left, right;
  double letter;  ///< height of a letter
};

/// Markers of lines one below the other on a white panel, left-aligned, each after a patch of its colour
/// unless it continues the line above (it begins with a blank then). They replace earlier ones. Lines are
/// broken before the right edge; a word that would reach beyond it moves all lines to the left.
visualization_msgs::MarkerArray legendMarkers(const LegendLines& given, const std::string& frame,
                                              LegendPlace place);

}  // namespace ground
