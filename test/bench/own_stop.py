#!/usr/bin/python3
"""Tests prove_stop on simulated crafts over watchdog times, mocap noise and seeds; prints a table and
counts wrong verdicts."""

import argparse
import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time

import yaml

ROOT = os.path.realpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "../.."))
WATCHDOGS = [0.1, 0.25, 0.5, 1.0, 0.0]  # [s]; 0: none
NOISES = [0.0003, 0.001]  # standard deviation of the mocap's position [m]


def free_port(kind):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def stack(seed, noise):
    """Runs the launch file on a separate master; yields the environment for its programs."""
    port = free_port(socket.SOCK_STREAM)
    env = dict(os.environ, ROS_MASTER_URI="http://localhost:%d" % port)
    launch = os.path.join(ROOT, "test", "rostest", "resting_craft.launch")
    arguments = ["seed:=%d" % seed, "position_noise:=%g" % noise]
    arguments += ["port:=%d" % free_port(socket.SOCK_DGRAM)]
    process = subprocess.Popen(
        ["roslaunch", "-p", str(port), launch] + arguments,
        env=env,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield env
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def call(env, *command):
    result = subprocess.run(
        command, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True
    )
    return result.stdout


def until(env, what, *command):
    for _ in range(30):
        if what in call(env, *command):
            return
        time.sleep(0.5)
    raise SystemExit("%s does not print %s" % (" ".join(command), what))


def trials(seed, noise, watchdogs):
    """The recorded outcome for each watchdog time."""
    with tempfile.TemporaryDirectory() as folder, stack(seed, noise) as env:
        path = os.path.join(folder, "own_stop.yaml")
        for watchdog in watchdogs:
            set_to = "watchdog=%g" % watchdog
            until(env, "watchdog", "rosrun", "ground", "parameters", "simulator", set_to)
            until(env, "success: True", "rosservice", "call", "/sender/arm", "true")
            output = call(env, "rosrun", "ground", "prove_stop", "-o", path)
            if "added to" not in output:
                raise SystemExit(output)
        with open(path) as file:
            return yaml.safe_load(file)["Tiny Whoover"]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--watchdogs", type=float, nargs="+", default=WATCHDOGS)
    parser.add_argument("--noises", type=float, nargs="+", default=NOISES)
    arguments = parser.parse_args()
    found = {}
    for noise in arguments.noises:
        for seed in range(1, arguments.seeds + 1):
            outcomes = trials(seed, noise, arguments.watchdogs)
            for watchdog, outcome in zip(arguments.watchdogs, outcomes):
                found.setdefault((noise, watchdog), []).append(outcome)
                print("%g m, %g s, seed %d: %s" % (noise, watchdog, seed, outcome["reason"]))
                sys.stdout.flush()
    wrong = total = 0
    print("| noise | watchdog | passed | failed | undecided | off by at most | claimed |")
    print("|---|---|---|---|---|---|---|")
    for (noise, watchdog), outcomes in found.items():
        names = [o["outcome"] for o in outcomes]
        total += len(names)
        wrong += sum(n != ("passed" if watchdog else "failed") for n in names)
        off = [abs(o["stopped_after"] - watchdog) for o in outcomes if "stopped_after" in o]
        claimed = [o["uncertainty"] for o in outcomes if "uncertainty" in o]
        print(
            "| %g mm | %s | %d | %d | %d | %s | %s |"
            % (
                1e3 * noise,
                "%g s" % watchdog if watchdog else "none",
                names.count("passed"),
                names.count("failed"),
                names.count("undecided"),
                "%.0f ms" % (1e3 * max(off)) if off else "",
                "%.0f ms" % (1e3 * max(claimed)) if claimed else "",
            )
        )
    print("%d of %d verdicts wrong or undecided" % (wrong, total))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
