// Crocoddyl's solvers on the problems of peer_plans.py, with the model of our core.
#include <algorithm>
#include <array>
#include <cmath>
#include <crocoddyl/core/solvers/box-ddp.hpp>
#include <crocoddyl/core/solvers/box-fddp.hpp>
#include <crocoddyl/core/states/euclidean.hpp>
#include <ctime>
#include <memory>
#include <vector>

#include "problem.h"

namespace {

using crocoddyl::ActionDataAbstract;
using Eigen::VectorXd;
using ConstVector = Eigen::Ref<const VectorXd>;

double processorTime() {
  timespec time;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Step k of the plan, with the cost of the inputs and of the state before it; the start has none.
class Step : public crocoddyl::ActionModelAbstract {
 public:
  Step(int k, const PlanProblem* const& problem)
      : crocoddyl::ActionModelAbstract(std::make_shared<crocoddyl::StateVector>(kStates), kInputs),
        k_(k),
        problem_(problem) {
    set_u_lb(VectorXd::Zero(kInputs));
    set_u_ub(VectorXd::Ones(kInputs));
  }

  void calc(const std::shared_ptr<ActionDataAbstract>& data, const ConstVector& x,
            const ConstVector& u) override {
    plan_step(problem_->missing, x.data(), u.data(), data->xnext.data(), nullptr);
    const double turning = u(0) - u(1);
    data->cost =
        stateCost(x) + cost_.step * (cost_.input * u.squaredNorm() + cost_.turning * turning * turning);
  }
  void calc(const std::shared_ptr<ActionDataAbstract>& data, const ConstVector& x) override {
    data->cost = stateCost(x);
    data->xnext = x;
  }
  void calcDiff(const std::shared_ptr<ActionDataAbstract>& data, const ConstVector& x,
                const ConstVector& u) override {
    calcDiff(data, x);
    Eigen::Matrix<double, kStates, kStates + kInputs, Eigen::RowMajor> by;
    double next[kStates];
    plan_step(problem_->missing, x.data(), u.data(), next, by.data());
    data->Fx = by.leftCols<kStates>();
    data->Fu = by.rightCols<kInputs>();
    const double turning = 2 * cost_.step * cost_.turning;
    data->Luu << turning, -turning, -turning, turning;
    data->Luu.diagonal().array() += 2 * cost_.step * cost_.input;
    data->Lu.noalias() = data->Luu * u;
  }
  void calcDiff(const std::shared_ptr<ActionDataAbstract>& data, const ConstVector& x) override {
    data->Lx.setZero();
    data->Lxx.setZero();
    if (k_ == 0) return;
    const double* reference = problem_->references[k_ - 1];
    const double position = 2 * positionWeight(), velocity = 2 * velocityWeight();
    const double c = std::cos(x(2)), s = std::sin(x(2));
    const Eigen::Vector2d over_floor(c * x(3) - s * x(4), s * x(3) + c * x(4));
    const Eigen::Vector2d slip = over_floor - Eigen::Vector2d(reference[2], reference[3]);
    Eigen::Matrix<double, 2, 3> by;
    by << -over_floor.y(), c, -s, over_floor.x(), s, c;
    data->Lx.head<2>() = position * (x.head<2>() - Eigen::Vector2d(reference[0], reference[1]));
    data->Lx.segment<3>(2).noalias() = velocity * by.transpose() * slip;
    data->Lxx(0, 0) = data->Lxx(1, 1) = position;
    data->Lxx.block<3, 3>(2, 2).noalias() = velocity * by.transpose() * by;
  }

  // This model exists for double only.
  std::shared_ptr<crocoddyl::ActionModelBase> cloneAsDouble() const override { return nullptr; }
  std::shared_ptr<crocoddyl::ActionModelBase> cloneAsFloat() const override { return nullptr; }

 private:
  double positionWeight() const { return cost_.step * (k_ == kSteps ? 1 + cost_.end_position : 1); }
  double velocityWeight() const {
    return cost_.step * (cost_.velocity + (k_ == kSteps ? cost_.end_velocity : 0));
  }
  double stateCost(const ConstVector& x) const {
    if (k_ == 0) return 0;
    const double* reference = problem_->references[k_ - 1];
    const double c = std::cos(x(2)), s = std::sin(x(2));
    const double dx = x(0) - reference[0], dy = x(1) - reference[1];
    const double du = c * x(3) - s * x(4) - reference[2], dv = s * x(3) + c * x(4) - reference[3];
    return positionWeight() * (dx * dx + dy * dy) + velocityWeight() * (du * du + dv * dv);
  }

  int k_;
  const PlanProblem* const& problem_;
  const PlanCost cost_ = plan_cost_weights();
};

/// Keeps the inputs and the processor time of each iteration.
struct Watch : crocoddyl::CallbackAbstract {
  double began = 0;
  int count = 0, most = 0;
  double *seconds = nullptr, *inputs = nullptr;

  void operator()(crocoddyl::SolverAbstract& solver) override {
    if (count == most) return;
    seconds[count] = processorTime() - began;
    double* to = inputs + count * kSteps * kInputs;
    for (const VectorXd& u : solver.get_us()) to = std::copy_n(u.data(), kInputs, to);
    ++count;
  }
};

struct Solvers {
  const PlanProblem* problem = nullptr;
  std::shared_ptr<crocoddyl::ShootingProblem> shooting;
  std::unique_ptr<crocoddyl::SolverAbstract> fddp, ddp;
  std::shared_ptr<Watch> watch = std::make_shared<Watch>();
  std::vector<VectorXd> xs, us;

  Solvers() : xs(kSteps + 1, VectorXd::Zero(kStates)), us(kSteps, VectorXd::Zero(kInputs)) {
    std::vector<std::shared_ptr<crocoddyl::ActionModelAbstract>> steps;
    for (int k = 0; k < kSteps; ++k) steps.push_back(std::make_shared<Step>(k, problem));
    shooting = std::make_shared<crocoddyl::ShootingProblem>(VectorXd::Zero(kStates), steps,
                                                            std::make_shared<Step>(kSteps, problem));
    shooting->set_nthreads(1);
    fddp = std::make_unique<crocoddyl::SolverBoxFDDP>(shooting);
    ddp = std::make_unique<crocoddyl::SolverBoxDDP>(shooting);
    for (crocoddyl::SolverAbstract* solver : {fddp.get(), ddp.get()}) {
      solver->setCallbacks({watch});
      solver->set_th_stop(1e-16);  // of costs as small as 1e-6 m^2 s
    }
  }
};

}  // namespace

int crocoddyl_solve(const PlanProblem* problem, int is_fddp, int most, double* seconds, double* inputs,
                    double* cost) {
  static Solvers all;
  all.problem = problem;
  all.watch->count = 0;
  all.watch->most = most;
  all.watch->seconds = seconds;
  all.watch->inputs = inputs;
  for (std::size_t k = 0; k < kSteps; ++k)
    all.us[k] = Eigen::Map<const VectorXd>(problem->inputs[k], kInputs);
  for (std::size_t k = 0; k <= kSteps; ++k)
    all.xs[k] = Eigen::Map<const VectorXd>(problem->states[k], kStates);
  all.watch->began = processorTime();
  all.shooting->set_x0(Eigen::Map<const VectorXd>(problem->start, kStates));
  if (!is_fddp) all.shooting->rollout(all.us, all.xs);  // BoxDDP takes states without gaps
  crocoddyl::SolverAbstract& solver = is_fddp ? *all.fddp : *all.ddp;
  solver.solve(all.xs, all.us, static_cast<std::size_t>(most), !is_fddp);
  *cost = solver.get_cost();
  return all.watch->count;
}
