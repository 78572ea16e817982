// Measures the peak rate of a core by independent multiply-adds in registers.
#include <chrono>
#include <cstdio>

using Vec8 = double __attribute__((vector_size(64), aligned(64)));

int main() {
  constexpr int kChains = 16, kRounds = 20000000;
  Vec8 x[kChains], a = {}, b = {};
  for (int i = 0; i < 8; ++i) a[i] = 0.999999, b[i] = 1e-9;
  for (Vec8& each : x) each = a;
  double best = 0;
  for (int repetition = 0; repetition < 5; ++repetition) {
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < kRounds; ++i) {
      for (Vec8& each : x) each = each * a + b;
    }
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    const double flops = 2.0 * 8 * kChains * kRounds / seconds.count();
    if (flops > best) best = flops;
  }
  double sum = 0;
  for (const Vec8& each : x) sum += each[0];
  std::printf("%.6g %g\n", best, sum);
  return 0;
}
