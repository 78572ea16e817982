#pragma once

#include <string>
#include <utility>
#include <vector>

#include "ground/model/symbol.h"

namespace ground {

using NamedSymbols = std::vector<std::pair<std::string, Symbol>>;

/// A formula of a model file, written into the Trace of this thread. Throws std::invalid_argument if it
/// has something that cannot be written down.
Symbol symbolOf(const std::string& formula, const NamedSymbols& variables);

}  // namespace ground
