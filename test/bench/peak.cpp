// Measures the peak rate of a core by independent multiply-adds in registers.
#include <chrono>
#include <cstdio>

#include "ground/model/registers.h"

int main() {
  using ground::registers::Register;
  // More chains than a core has multiply-adds in flight, few enough for 16 registers.
  constexpr int kChains = 10, kRounds = 20000000, kNumbers = sizeof(Register) / sizeof(double);
  Register x[kChains];
  const Register a = ground::registers::filled<Register>(0.999999),
                 b = ground::registers::filled<Register>(1e-9);
  for (Register& each : x) each = a;
  double best = 0;
  for (int repetition = 0; repetition < 5; ++repetition) {
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < kRounds; ++i) {
      for (Register& each : x) each = each * a + b;
    }
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    const double flops = 2.0 * kNumbers * kChains * kRounds / seconds.count();
    if (flops > best) best = flops;
  }
  double sum = 0;
  for (const Register& each : x) sum += each[0];
  std::printf("%.6g %g\n", best, sum);
  return 0;
}
