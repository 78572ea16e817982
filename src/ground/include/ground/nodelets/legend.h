#pragma once

#include <visualization_msgs/MarkerArray.h>

#include <string>
#include <vector>

namespace ground {

/// A text of a legend, and below it a sample of what it explains.
struct LegendEntry {
  enum class Sample {
    kPath,   ///< a line
    kArrow,  ///< an arrow with the length that the text states
    kScale,  ///< squares from small to large values, palette::kScale
    kBar     ///< a bar with the length that the text states
  };

  std::string text;
  Sample sample = Sample::kPath;
  std::string color = "#000000";
  double length = 0.6;  ///< [m]
  double width = 0.03;  ///< [m]

  bool operator==(const LegendEntry& other) const {
    return text == other.text && sample == other.sample && color == other.color && length == other.length &&
           width == other.width;
  }
};

/// Markers of a legend, entries one below the other as seen from above with x upwards; they replace
/// those of an earlier one. x, y: middle of its upper edge in the frame [m].
visualization_msgs::MarkerArrayPtr legendMarkers(const std::vector<LegendEntry>& entries,
                                                 const std::string& frame, double x, double y);

}  // namespace ground
