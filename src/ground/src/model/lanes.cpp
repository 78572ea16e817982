#include "ground/model/lanes.h"

// These declarations let the compiler replace the loops below by the vector functions of glibc
// (libmvec).
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define GROUND_VECTOR_FUNCTION __attribute__((simd("notinbranch"), const))
#else
#define GROUND_VECTOR_FUNCTION
#endif

extern "C" {
GROUND_VECTOR_FUNCTION double sin(double) noexcept;
GROUND_VECTOR_FUNCTION double cos(double) noexcept;
GROUND_VECTOR_FUNCTION double exp(double) noexcept;
GROUND_VECTOR_FUNCTION double log(double) noexcept;
GROUND_VECTOR_FUNCTION double pow(double, double) noexcept;
}

namespace ground {
namespace lanes {

#define GROUND_ELEMENTWISE(function)                                      \
  void function(const Lanes& a, Lanes& result) {                          \
    const double* from = reinterpret_cast<const double*>(&a);             \
    double out[Lanes::kCount];                                            \
    for (int i = 0; i < Lanes::kCount; ++i) out[i] = ::function(from[i]); \
    for (int i = 0; i < Lanes::kCount; ++i) result[i] = out[i];           \
  }
GROUND_ELEMENTWISE(sin)
GROUND_ELEMENTWISE(cos)
GROUND_ELEMENTWISE(exp)
GROUND_ELEMENTWISE(log)
#undef GROUND_ELEMENTWISE

void pow(const Lanes& base, const Lanes& exponent, Lanes& result) {
  const double* from = reinterpret_cast<const double*>(&base);
  const double* power = reinterpret_cast<const double*>(&exponent);
  double out[Lanes::kCount];
  for (int i = 0; i < Lanes::kCount; ++i) out[i] = ::pow(from[i], power[i]);
  for (int i = 0; i < Lanes::kCount; ++i) result[i] = out[i];
}

}  // namespace lanes
}  // namespace ground
