#include "ground/model/tunable.h"

#include <cstdio>

namespace ground {

std::string TunableInfo::rangeError(const Setting& setting) const {
  const double* const value = std::get_if<double>(&setting);
  if (!value || (*value >= low && *value <= high)) return "";
  char range[100];
  std::snprintf(range, sizeof range, " must be between %g and %g", low, high);
  char given[40];
  std::snprintf(given, sizeof given, ", not %g", *value);
  return name + range + (unit.empty() || unit == "-" ? "" : " " + unit) + given;
}

}  // namespace ground
