#!/usr/bin/python3
"""The optimiser of ModelPredictive beside peers, on the same problems in one run: Crocoddyl (BoxFDDP, BoxDDP;
C++, with the model and the derivatives of our core), CasADi (FATROP, IPOPT) and acados (SQP with HPIPM).

Warm problems are decisions in flight: each contender starts from our previous plan, moved on by a period.
A peer's time is the processor time until its cost is within 1e-4 of that of our decision (or until it ends).
Cold problems begin far from the reference; the best plan is that of any contender or of 60 random starts.
All costs are those of one function. Prints the rows of bench.py's table, a line of JSON each.

It runs in the peers' interpreter, in a built workspace; --folder is for what is compiled. What cannot be
installed or compiled is left out with a sentence.
"""
import argparse
import ctypes
import json
import os
import subprocess
import sys
import time

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
STEPS, STATES, INPUTS = 40, 6, 2
REFERENCES = 4  # plan_cases.h
SAME = 1 + 1e-4  # costs within this factor are the same
ITERATIONS = 200
SCALE = 1e4  # multiplies costs (1e-5 m^2 s and more) for peers whose tolerances are absolute
Numbers = ctypes.c_double


class Problem(ctypes.Structure):
    """PlanProblem of peer_plans/problem.h."""

    _fields_ = [
        ("start", Numbers * STATES),
        ("missing", Numbers * 3),
        ("references", Numbers * (STEPS * 4)),
        ("inputs", Numbers * (STEPS * INPUTS)),
        ("states", Numbers * ((STEPS + 1) * STATES)),
    ]

    def guess(self):
        """The states and inputs to start from, in arrays."""
        return np.reshape(self.states, (-1, STATES)), np.reshape(self.inputs, (-1, INPUTS))


class Cost(ctypes.Structure):
    """PlanCost of peer_plans/problem.h."""

    _fields_ = [
        (name, Numbers)
        for name in ("step", "velocity", "input", "turning", "end_position", "end_velocity")
    ]


def pointer(array):
    return array.ctypes.data_as(ctypes.c_void_p)


def left_out(name, why):
    print("%s is left out: %s" % (name, why), file=sys.stderr)


class Core:
    """Our planner, and Crocoddyl where its headers are: the library made of peer_plans/*.cpp."""

    def __init__(self, folder):
        os.makedirs(folder, exist_ok=True)
        library = os.path.join(folder, "libplans.so")
        prefix = os.path.join(sys.prefix, "lib", "python%d.%d" % sys.version_info[:2])
        prefix = os.path.join(prefix, "site-packages", "cmeel.prefix")
        self.has_crocoddyl = os.path.isdir(os.path.join(prefix, "include", "crocoddyl"))
        if self.has_crocoddyl:
            try:
                self.compile(library, ["ours.cpp", "crocoddyl.cpp"], prefix)
            except subprocess.CalledProcessError as error:
                self.has_crocoddyl = False
                left_out("Crocoddyl", "it cannot be compiled (%s)" % error)
        else:
            left_out("Crocoddyl", "libcrocoddyl could not be installed from PyPI")
        if not self.has_crocoddyl:
            self.compile(library, ["ours.cpp"], None)
        self.calls = ctypes.CDLL(library)
        self.calls.plan_cost_weights.restype = Cost
        self.calls.plan_flight.restype = ctypes.c_void_p
        self.calls.plan_flight_next.argtypes = [ctypes.c_void_p] * 3
        self.calls.plan_flight_end.argtypes = [ctypes.c_void_p]
        for name in ("plan_flight_next", "plan_cost", "plan_cold_best"):
            getattr(self.calls, name).restype = Numbers

    def compile(self, library, sources, prefix):
        root = os.path.join(HERE, "../..")
        ours = os.path.join(os.environ["CMAKE_PREFIX_PATH"].split(":")[0], "lib")
        command = ["g++", "-std=c++17", "-O3", "-fno-math-errno", "-w", "-Wno-psabi", "-shared", "-fPIC"]
        command += ['-DGROUND_WORKSPACE="%s"' % os.path.abspath(root), "-o", library]
        command += [os.path.join(HERE, "peer_plans", source) for source in sources]
        command += ["-I" + os.path.join(root, "src/ground/include"), "-isystem/usr/include/eigen3"]
        command += ["-L" + ours, "-lground_control", "-lground_estimation", "-lground_model"]
        # The old kind of run path holds for libraries of libraries, too.
        command += ["-Wl,--disable-new-dtags,-rpath," + ours]
        if prefix:
            lib = os.path.join(prefix, "lib")
            command += ["-isystem" + os.path.join(prefix, "include"), "-L" + lib, "-lcrocoddyl"]
            command += ["-Wl,-rpath," + lib]
        subprocess.run(command, check=True)

    def cost(self, problem, inputs):
        return self.calls.plan_cost(ctypes.byref(problem), pointer(np.ascontiguousarray(inputs)))


class Crocoddyl:
    def __init__(self, core, fddp):
        self.core, self.fddp = core, fddp
        self.seconds = np.zeros(ITERATIONS)
        self.inputs = np.zeros((ITERATIONS, STEPS * INPUTS))

    def solve(self, problem):
        """Processor time and inputs after each iteration."""
        cost = Numbers()
        count = self.core.calls.crocoddyl_solve(
            ctypes.byref(problem), int(self.fddp), ITERATIONS, pointer(self.seconds),
            pointer(self.inputs), ctypes.byref(cost),
        )  # fmt: skip
        if count and not self.fddp:  # plans of BoxFDDP may have gaps before it has converged
            check("Crocoddyl", cost.value, self.core.cost(problem, self.inputs[count - 1]))
        return self.seconds[:count], self.inputs[:count]


def check(name, theirs, ours):
    if abs(theirs - ours) > 1e-4 * ours:  # gaps and bounds are kept up to a tolerance
        sys.exit("peer_plans: %s computes a cost of %.9g where ours is %.9g" % (name, theirs, ours))


def symbolic(core, casadi):
    """The state after a step of inputs and a missing acceleration, in CasADi's symbols, and the
    velocity over the floor."""
    body = np.zeros(7)
    core.calls.plan_body(pointer(body))
    m, lever, I_z, X_u, Y_v, N_r, k = body
    h = core.calls.plan_cost_weights().step
    x, u = casadi.SX.sym("x", STATES), casadi.SX.sym("u", INPUTS)
    missing = casadi.SX.sym("missing", 3)

    def over_floor(x):
        c, s = casadi.cos(x[2]), casadi.sin(x[2])
        return casadi.vertcat(c * x[3] - s * x[4], s * x[3] + c * x[4])

    def derivative(x):
        return casadi.vertcat(
            over_floor(x),
            x[5],
            x[5] * x[4] + (k * (u[0] + u[1]) - X_u * x[3]) / m,
            -x[5] * x[3] - Y_v * x[4] / m,
            (lever * k * (u[0] - u[1]) - N_r * x[5]) / I_z,
        )

    push = casadi.vertcat(0, 0, 0, h / 2 * missing)  # half before the step, half after it
    begin = x + push
    k1 = derivative(begin)
    k2 = derivative(begin + h / 2 * k1)
    k3 = derivative(begin + h / 2 * k2)
    k4 = derivative(begin + h * k3)
    after = begin + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4) + push
    return x, u, missing, after, over_floor


class CasADi:
    """Direct multiple shooting; CasADi interprets the functions."""

    def __init__(self, core, solver):
        import casadi

        self.core, self.name = core, solver
        x, u, missing, after, over_floor = symbolic(core, casadi)
        step = casadi.Function("step", [x, u, missing], [after])
        weights = core.calls.plan_cost_weights()
        parameters = casadi.SX.sym("p", STATES + 3 + 4 * STEPS)
        start, push, references = casadi.vertsplit(
            parameters, [0, STATES, STATES + 3, STATES + 3 + 4 * STEPS]
        )
        states = [casadi.SX.sym("x%d" % k, STATES) for k in range(STEPS + 1)]
        inputs = [casadi.SX.sym("u%d" % k, INPUTS) for k in range(STEPS)]
        # The order that FATROP recognises: step by step, the gap first.
        variables, gaps, cost = [], [], 0
        for k in range(STEPS):
            variables += [states[k], inputs[k]]
            gaps.append(states[k + 1] - step(states[k], inputs[k], push))
            if k == 0:
                gaps.append(states[0] - start)
            reference, end = references[4 * k : 4 * k + 4], k + 1 == STEPS
            cost += weights.input * casadi.sumsqr(inputs[k])
            cost += weights.turning * (inputs[k][0] - inputs[k][1]) ** 2
            cost += (1 + end * weights.end_position) * casadi.sumsqr(
                states[k + 1][:2] - reference[:2]
            )
            cost += (weights.velocity + end * weights.end_velocity) * casadi.sumsqr(
                over_floor(states[k + 1]) - reference[2:]
            )
        variables.append(states[STEPS])
        gaps = casadi.vertcat(*gaps)
        problem = {"x": casadi.vertcat(*variables), "p": parameters, "f": SCALE * weights.step * cost}
        problem["g"] = gaps
        # Interpreted: a compiler takes more than ten minutes for the 40 steps written out.
        options = {"print_time": False}
        options[solver] = {"print_level": 0, "tol": 1e-8, "max_iter": ITERATIONS}
        if solver == "fatrop":
            options.update(structure_detection="auto", equality=[True] * gaps.numel())
        else:
            options[solver]["sb"] = "yes"
        self.solver = casadi.nlpsol(solver, solver, problem, options)
        low = [-np.inf] * STATES + [0] * INPUTS
        high = [np.inf] * STATES + [1] * INPUTS
        self.bounds = {"lbx": low * STEPS + low[:STATES], "ubx": high * STEPS + high[:STATES]}
        self.bounds.update(lbg=0, ubg=0)

    def solve(self, problem):
        states, inputs = problem.guess()
        guess = np.concatenate([np.hstack([states[:-1], inputs]).ravel(), states[-1]])
        parameters = np.concatenate([problem.start, problem.missing, problem.references])
        before = time.thread_time()
        found = self.solver(x0=guess, p=parameters, **self.bounds)
        seconds = time.thread_time() - before
        rows = np.array(found["x"]).ravel()[: STEPS * (STATES + INPUTS)].reshape(STEPS, -1)
        # Interior points may be outside the bounds by the tolerance.
        plan = np.clip(rows[:, STATES:], 0, 1).ravel()
        if self.solver.stats()["success"]:
            check(self.name.upper(), float(found["f"]) / SCALE, self.core.cost(problem, plan))
        return [seconds], [plan]


class Acados:
    """Sequential quadratic programming with HPIPM, by the library in comma-deps-acados."""

    def __init__(self, core, folder):
        import acados
        import casadi

        self.core = core
        package = os.path.dirname(acados.__file__)
        root = os.path.join(folder, "acados")  # laid out as acados's templates expect
        os.makedirs(os.path.join(root, "interfaces/acados_template"), exist_ok=True)
        for source, target in [
            ("acados_template", "interfaces/acados_template/acados_template"),
            ("install/lib", "lib"),
            ("install/include", "include"),
            ("install/bin", "bin"),
        ]:
            if not os.path.exists(os.path.join(root, target)):
                os.symlink(os.path.join(package, source), os.path.join(root, target))
        os.environ["ACADOS_SOURCE_DIR"] = root
        os.environ["TERA_PATH"] = os.path.join(root, "bin/t_renderer")
        for name in ("blasfeo", "hpipm", "qpOASES_e"):
            ctypes.CDLL(os.path.join(root, "lib", "lib%s.so" % name), mode=ctypes.RTLD_GLOBAL)
        from acados.acados_template import AcadosModel, AcadosOcp, AcadosOcpSolver

        x, u, missing, after, over_floor = symbolic(core, casadi)
        reference = casadi.SX.sym("reference", 4)
        weights = core.calls.plan_cost_weights()
        problem, model = AcadosOcp(), AcadosModel()
        model.name, model.x, model.u, model.disc_dyn_expr = "craft", x, u, after
        model.p = casadi.vertcat(missing, reference)
        model.cost_y_expr_e = casadi.vertcat(x[:2] - reference[:2], over_floor(x) - reference[2:])
        model.cost_y_expr = casadi.vertcat(model.cost_y_expr_e, u, u[0] - u[1])
        problem.model, problem.dims.N = model, STEPS
        cost = problem.cost
        cost.cost_type = cost.cost_type_e = "NONLINEAR_LS"
        state = np.array([1, 1, weights.velocity, weights.velocity])
        end = np.array([weights.end_position] * 2 + [weights.end_velocity] * 2)
        turning = [weights.input] * INPUTS + [weights.turning]
        cost.W = SCALE * 2 * weights.step * np.diag(np.concatenate([state, turning]))
        cost.W_e = SCALE * 2 * weights.step * np.diag(state + end)
        cost.yref, cost.yref_e = np.zeros(len(cost.W)), np.zeros(len(cost.W_e))
        problem.constraints.lbu, problem.constraints.ubu = np.zeros(INPUTS), np.ones(INPUTS)
        problem.constraints.idxbu = np.arange(INPUTS)
        problem.constraints.x0 = np.zeros(STATES)
        problem.parameter_values = np.zeros(7)
        options = problem.solver_options
        options.qp_solver, options.hessian_approx = "PARTIAL_CONDENSING_HPIPM", "GAUSS_NEWTON"
        options.integrator_type, options.nlp_solver_type = "DISCRETE", "SQP"
        options.nlp_solver_max_iter, options.tf = ITERATIONS, float(STEPS)
        problem.acados_include_path = os.path.join(root, "include")
        problem.acados_lib_path = os.path.join(root, "lib")
        problem.code_export_directory = os.path.join(folder, "acados_code")
        self.solver = AcadosOcpSolver(problem, json_file=os.path.join(folder, "acados.json"))

    def solve(self, problem):
        states, inputs = problem.guess()
        references = np.reshape(problem.references, (-1, 4))
        missing = np.array(problem.missing)
        for bound in ("lbx", "ubx"):
            self.solver.set(0, bound, np.array(problem.start))
        for k in range(STEPS + 1):
            # The state before the first step has no reference: its cost is a constant.
            self.solver.set(k, "p", np.concatenate([missing, references[max(k - 1, 0)]]))
            self.solver.set(k, "x", states[k])
            if k < STEPS:
                self.solver.set(k, "u", inputs[k])
        before = time.thread_time()
        self.solver.solve()
        seconds = time.thread_time() - before
        plan = np.clip([self.solver.get(k, "u") for k in range(STEPS)], 0, 1)
        return [seconds], [plan.ravel()]


def contenders(core, folder):
    """The peers that can be used, and every how many warm problems each is asked."""
    found = {}
    if core.has_crocoddyl:
        found["Crocoddyl BoxFDDP"] = (Crocoddyl(core, True), 1)
        found["Crocoddyl BoxDDP"] = (Crocoddyl(core, False), 1)
    makers = {
        "CasADi FATROP": lambda: CasADi(core, "fatrop"),
        "CasADi IPOPT": lambda: CasADi(core, "ipopt"),
        "acados SQP": lambda: Acados(core, folder),
    }
    for name, make in makers.items():
        try:
            found[name] = (make(), 20)
        except Exception as error:  # third-party code fails in its own ways
            left_out(name, str(error).strip().split("\n")[-1] or type(error).__name__)
    return found


def row(name, values, unit, goal=None, note=""):
    values = np.atleast_1d(np.asarray(values, float)).tolist()
    print(json.dumps({"name": name, "values": values, "unit": unit, "goal": goal, "note": note}),
          file=ROWS, flush=True)  # fmt: skip


def warm(core, peers, seconds):
    times, missed = {name: [] for name in ("ground", *peers)}, dict.fromkeys(peers, 0)
    inputs = np.zeros(STEPS * INPUTS)
    for reference in range(REFERENCES):
        flight = core.calls.plan_flight(reference)
        problem = Problem()
        for decision in range(int(seconds / 0.02)):
            took = core.calls.plan_flight_next(flight, ctypes.byref(problem), pointer(inputs))
            if decision == 0:
                continue
            times["ground"].append(took)
            same = SAME * core.cost(problem, inputs)
            for name, (peer, every) in peers.items():
                if decision % every:
                    continue
                after, plans = peer.solve(problem)
                reached = next(
                    (s for s, plan in zip(after, plans) if core.cost(problem, plan) <= same), None
                )
                missed[name] += reached is None
                times[name].append(after[-1] if reached is None and len(after) else reached or 0)
        core.calls.plan_flight_end(flight)
    ours = np.quantile(times["ground"], [0.5, 0.999])
    for name, values in times.items():
        median, most = np.quantile(values, [0.5, 0.999])
        note = "99.9%%: %.3g ms" % (1e3 * most)
        if name != "ground":
            note += "; %.1f and %.1f times ground" % (median / ours[0], most / ours[1])
            note += "; cost not reached in %.2g%%" % (100 * missed[name] / len(values))
        row("plan in flight, " + name, 1e3 * np.array(values), "ms", None, note)
    if "Crocoddyl BoxFDDP" in times:
        peer = np.quantile(times["Crocoddyl BoxFDDP"], [0.5, 0.999])
        row("plan in flight, ground / BoxFDDP, median", ours[0] / peer[0], "", 0.7)
        row("plan in flight, ground / BoxFDDP, 99.9%", ours[1] / peer[1], "")


def cold(core, peers, count):
    decisions = 50
    costs, seconds = np.zeros((count, decisions)), np.zeros((count, decisions))
    best = np.zeros(count)
    theirs = {name: np.zeros((count, 2)) for name in peers}  # cost, seconds
    problem = Problem()
    for i in range(count):
        core.calls.plan_cold(i, ctypes.byref(problem), pointer(costs[i]), pointer(seconds[i]))
        best[i] = core.calls.plan_cold_best(ctypes.byref(problem), i)
        for name, (peer, _) in peers.items():
            after, plans = peer.solve(problem)
            theirs[name][i] = np.inf, 0
            if len(after):
                theirs[name][i] = core.cost(problem, plans[-1]), after[-1]
    for values in [costs[:, -1], *(values[:, 0] for values in theirs.values())]:
        best = np.fmin(best, values)

    def far(values):
        return 100 * np.mean(~(values <= 1.01 * best))

    for decision in (1, 5, 10, 20, 50):
        note = "%.2g ms in the median, %.2g ms in 99%%" % tuple(
            1e3 * np.quantile(seconds[:, decision - 1], [0.5, 0.99])
        )
        goal = 10 if decision == decisions else None
        row("cold plans 1%% above the best, ground, decision %d" % decision,
            far(costs[:, decision - 1]), "%", goal, note)  # fmt: skip
    for name, values in theirs.items():
        note = "%.2g ms in the median, %.2g ms in 99%%" % tuple(
            1e3 * np.quantile(values[:, 1], [0.5, 0.99])
        )
        row("cold plans 1%% above the best, %s" % name, far(values[:, 0]), "%", None, note)


def own_output():
    """Standard output for rows alone: compilers and solvers print to it, too."""
    rows = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", required=True, help="for what is compiled")
    parser.add_argument("--seconds", type=float, default=20, help="length of each flight")
    parser.add_argument("--starts", type=int, default=240, help="number of cold starts")
    arguments = parser.parse_args()
    folder = os.path.abspath(arguments.folder)
    core = Core(folder)
    peers = contenders(core, folder)
    warm(core, peers, arguments.seconds)
    cold(core, peers, arguments.starts)


if __name__ == "__main__":
    ROWS = own_output()
    main()
