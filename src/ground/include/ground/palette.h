#pragma once

#include <array>

namespace ground::palette {

/// Colours "#rrggbb" of everything that ground draws: pages, pictures, curves and rviz. They are
/// the colours of Okabe and Ito, "Color Universal Design" (2008), which people with protanopia,
/// deuteranopia and tritanopia distinguish.
constexpr const char *kBlack = "#000000", *kOrange = "#e69f00", *kSkyBlue = "#56b4e9", *kGreen = "#009e73",
                     *kBlue = "#0072b2", *kVermillion = "#d55e00", *kPurple = "#cc79a7";

constexpr const char* kMeasured = kBlack;
/// Models, by their order; a fifth has the first colour again, with other dashes.
constexpr std::array<const char*, 4> kModels = {kVermillion, kBlue, kPurple, kSkyBlue};
constexpr const char* kReference = kGreen;  ///< what is wanted: the reference, the noise floor
/// Thrusters, by their order in the model.
constexpr std::array<const char*, 4> kThrusters = {kSkyBlue, kOrange, kGreen, kPurple};
constexpr const char* kMissing = kPurple;  ///< missing force and moment

/// Scale from small to large, of which lightness alone tells the value: viridis, by van der Walt and
/// Smith (2015).
constexpr std::array<const char*, 10> kScale = {"#440154", "#482878", "#3e4989", "#31688e", "#26828e",
                                                "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"};

}  // namespace ground::palette
