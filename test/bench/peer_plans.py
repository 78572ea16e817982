#!/usr/bin/python3
"""The optimiser of ModelPredictive beside Crocoddyl, on the same problems in one run (BoxFDDP, BoxDDP;
C++, with the model and the derivatives of our core).

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

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
STEPS, STATES, INPUTS = 40, 6, 2
REFERENCES = 4  # plan_cases.h
SAME = 1 + 1e-4  # costs within this factor are the same
ITERATIONS = 200
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
        command += ["-I" + os.path.join(ours, "../include")]  # structs of parameters
        command += [
            "-L" + ours,
            *("-lground_" + name for name in ("control", "safety", "estimation", "model")),
        ]
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


def contenders(core):
    """The peers that can be used."""
    if not core.has_crocoddyl:
        return {}
    return {"Crocoddyl BoxFDDP": Crocoddyl(core, True), "Crocoddyl BoxDDP": Crocoddyl(core, False)}


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
            for name, peer in peers.items():
                after, plans = peer.solve(problem)
                reached = next((s for s, plan in zip(after, plans) if core.cost(problem, plan) <= same), None)
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
        for name, peer in peers.items():
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
        note = "%.2g ms in the median, %.2g ms in 99%%" % tuple(1e3 * np.quantile(values[:, 1], [0.5, 0.99]))
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
    peers = contenders(core)
    warm(core, peers, arguments.seconds)
    cold(core, peers, arguments.starts)


if __name__ == "__main__":
    ROWS = own_output()
    main()
