// Prints the thesis's table 3.1, repeated over many PRBS sequences and draws of noise.
#include <cstdio>

#include "../unit/artificial_run.h"

int main() {
  using namespace ground;
  constexpr unsigned kSeeds = 200;
  struct Row {
    double epsilon, thesis;  ///< relative noise; largest error in the single run of the thesis [%]
  };
  std::printf("table 3.1: largest error of any parameter, %u runs of 4 s each, from 0.2 each\n", kSeeds);
  std::printf("%8s %20s %20s %22s %10s\n", "epsilon", "least squares", "objective (3.4)",
              "intervals that hold", "thesis");
  std::printf("%8s %10s %9s %10s %9s %11s %10s %10s\n", "", "median", "worst", "median", "worst", "squares",
              "(3.4)", "one run");
  for (const Row& row : {Row{0, 1.0}, Row{0.1, 5.4}, Row{0.3, 4.0}, Row{0.5, 51.2}}) {
    const auto squares = studyNoise(row.epsilon, kSeeds, FitOptions::Objective::kLeastSquares);
    const auto thesis = studyNoise(row.epsilon, kSeeds, FitOptions::Objective::kThesis);
    std::printf("%8.1f %9.2f%% %8.2f%% %9.2f%% %8.2f%%", row.epsilon, 100 * squares.median,
                100 * squares.largest, 100 * thesis.median, 100 * thesis.largest);
    if (row.epsilon > 0)  // an exact fit has no uncertainty
      std::printf(" %10.1f%% %9.1f%%", squares.coverage.percent(), thesis.coverage.percent());
    else
      std::printf(" %11s %10s", "-", "-");
    std::printf(" %9.1f%%\n", row.thesis);
  }
}
