#pragma once

#include <algorithm>
#include <utility>

#include "ground/simulation/model_craft.h"

namespace ground {

/// What is wrong with a craft.
enum class CraftFault { kDeaf, kSwapped, kLeftOff, kRightOff, kNoLift };

/// A craft that moves by a model, and from some time on not as it is commanded.
class FaultyCraft : public ModelCraft {
 public:
  FaultyCraft(const Model& model, const Params& params, CraftFault fault, double from)
      : ModelCraft(model, params), fault_(fault), from_(from) {}
  void command(const Thrusters<double>& thrusters, double lift) override {
    Thrusters<double> heard = thrusters;
    const bool fails = now_ >= from_;
    if (fails && fault_ == CraftFault::kDeaf) std::fill(heard.begin(), heard.end(), 0.0);
    if (fails && fault_ == CraftFault::kSwapped) std::swap(heard(0), heard(1));
    if (fails && fault_ == CraftFault::kLeftOff) heard(0) = 0;
    if (fails && fault_ == CraftFault::kRightOff) heard(1) = 0;
    const bool falls = fails && (fault_ == CraftFault::kDeaf || fault_ == CraftFault::kNoLift);
    ModelCraft::command(heard, falls ? 0 : lift);
  }
  void advance(double time) override {
    now_ = time;
    ModelCraft::advance(time);
  }

 private:
  CraftFault fault_;
  double from_, now_ = 0;
};

}  // namespace ground
