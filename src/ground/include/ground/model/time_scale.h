#pragma once

#include "ground/model/model.h"

namespace ground {

/// Time [s] in which full thrust moves a craft by some lengths or turns it round: 1 s for a palm-sized
/// hovercraft, 10 s for a free-flyer. It is rounded, so that models of a craft have the same.
double timeScale(const Model& model);

/// The nearest of 1, 2 and 5 times a power of ten; seconds must be positive.
double roundedTime(double seconds);

}  // namespace ground
