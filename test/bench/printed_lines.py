#!/usr/bin/python3
"""Runs every experiment that a diagnosis can propose by its printed roslaunch line, in the simulated
room, and compares the inputs on the wire with the design.

Prints for each line how it ended, the number of bursts and edges, and the timing error of the edges on
the wire (median, 99%), without the median delay of the commands around each. Fails if a line does not run
to its end or the median of all errors is above 2 ms.
"""

import argparse
import difflib
import glob
import os
import shlex
import subprocess
import sys
import tempfile

import numpy as np
import rosbag

from ground.analysis import next_experiment
from ground.simulation import experiments

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "rostest"))
from fake_craft import free_port
from wire_proxy import WireProxy

MAX_MEDIAN_ERROR = 2e-3  # median timing error of the edges [s]
STEP = 1e-3  # resolution of an input on the wire
DELAY_WINDOW = 2.0  # half the window over which the delay's median is taken [s]
MIN_MATCHED = 0.9  # share of the changes that must be found on the wire
TIMEOUT = 120.0  # limit for a line [s]
WRAPPER = """<launch>
  <include file="$(find ground)/launch/sim_prbs.launch">
%s
  </include>
  <param name="simulator/sender" value="127.0.0.1:%d"/>
</launch>
"""


def arguments_of(line):
    """Names and values of the arguments of a printed roslaunch line."""
    words = shlex.split(line)
    assert words[:3] == ["roslaunch", "ground", "room_prbs.launch"], line
    return dict(word.split(":=", 1) for word in words[3:])


def fly(arguments, folder):
    """Runs a line with all nodes; returns the bag's path and the packets on the wire."""
    sender, craft, master = free_port(), free_port(), free_port()
    given = dict(arguments, port=sender, record="true", bag_dir=folder, exit_when_done="true")
    args = "\n".join('    <arg name="%s" value="%s"/>' % item for item in given.items())
    path = os.path.join(folder, "line.launch")
    with open(path, "w") as file:
        file.write(WRAPPER % (args, craft))
    wire = WireProxy(sender, craft)
    try:
        environment = dict(os.environ, ROS_MASTER_URI="http://127.0.0.1:%d" % master)
        done = subprocess.run(
            ["roslaunch", "-p", str(master), path],
            env=environment,
            timeout=TIMEOUT,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            universal_newlines=True,
        )
    finally:
        wire.close()
    bags = glob.glob(os.path.join(folder, "*.bag"))
    if len(bags) != 1:
        raise RuntimeError("no bag was recorded:\n" + done.stdout[-2000:])
    return bags[0], wire.packets


def changes(rows):
    """Rows time, left, right at which left or right changes by at least the wire's resolution."""
    rows = np.asarray(rows)
    on_wire = np.floor(rows[:, 1:] / STEP + 0.5)
    moved = np.r_[True, (np.diff(on_wire, axis=0) != 0).any(axis=1)]
    return rows[moved]


def arrivals(commanded, sent):
    """{index of a commanded change: time of its packet [s, time.time()]}."""
    values = [[tuple(row) for row in np.floor(rows[:, 1:] / STEP + 0.5)] for rows in (commanded, sent)]
    found = {}
    for at, there, count in difflib.SequenceMatcher(None, *values, False).get_matching_blocks():
        found.update((at + i, sent[there + i, 0]) for i in range(count))
    if len(found) < MIN_MATCHED * len(commanded):
        message = "only %d of %d changes are on the wire"
        raise RuntimeError(message % (len(found), len(commanded)))
    return found


def expected(design, bursts):
    """Times of the begins of bursts and of the design's edges in them, on the clock of the bag [s]."""
    edges, played, end = changes(design)[:, 0], 0.0, design[-1, 0]
    for begin, until in bursts:
        due = edges[(edges > played + 1e-9) & (edges < played + until - begin)]
        yield begin
        yield from begin + due - played
        later = edges[edges > played + until - begin]
        played = later[0] if len(later) else end


def compared(bag, packets, design):
    """Timing errors [s] of the edges on the wire, number of bursts, and reason of the end."""
    with rosbag.Bag(bag) as file:
        commands = [
            (m.header.stamp.to_sec(), m.left, m.right)
            for _, m, _ in file.read_messages(topics=["/controls"])
        ]
        marks = [
            (m.header.stamp.to_sec(), m.burst) for _, m, _ in file.read_messages(topics=["/bursts"])
        ]
        status = [m for _, m, _ in file.read_messages(topics=["/controller/status"])]
    commanded = changes(commands)
    sent = changes([(p.time, p.left, p.right) for p in packets])
    arrival = arrivals(commanded, sent)
    ends = [time for time, _ in marks[1:]] + [commands[-1][0]]
    bursts = [(begin, end) for (begin, burst), end in zip(marks, ends) if burst]
    stamps = commanded[list(arrival), 0]
    delays = np.array(list(arrival.values())) - stamps  # includes the difference of the clocks
    errors = []
    for time in expected(design, bursts):
        near = int(np.argmin(np.abs(commanded[:, 0] - time)))
        if abs(commanded[near, 0] - time) > 0.02 or near not in arrival:
            continue  # after a return, an edge to a level that is already held changes nothing
        delay = np.median(delays[np.abs(stamps - time) < DELAY_WINDOW])
        errors.append(arrival[near] - time - delay)
    return errors, len(bursts), status[-1].reason


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, help="of each experiment [s] (as printed)")
    parser.add_argument("--only", default="", help="run only experiments whose description contains this")
    options = parser.parse_args()
    everything, failed = [], 0
    lines = [e for e in next_experiment.choices() if options.only in e.input]
    for experiment in lines:
        arguments = arguments_of(experiment.launch())
        if options.duration:
            arguments["duration"] = "%g" % options.duration
        duration = float(arguments["duration"])
        design = experiments.rows(experiment.design, duration, **dict(experiment.options))
        with tempfile.TemporaryDirectory() as folder:
            try:
                off, bursts, reason = compared(*fly(arguments, folder), design)
            except (RuntimeError, subprocess.TimeoutExpired) as error:
                off, bursts, reason = [], 0, str(error)
        flown = "its end" in reason or "done" in reason.lower()
        failed += not flown
        everything += off
        spread = 1e3 * np.quantile(np.abs(off), [0.5, 0.99]) if off else [np.nan, np.nan]
        print(
            "%-60s %2d bursts, %3d edges off by %.2f ms (99%%: %.2f ms): %s"
            % (experiment.input, bursts, len(off), spread[0], spread[1], reason),
            flush=True,
        )
    median, most = np.quantile(np.abs(everything), [0.5, 0.99])
    print(
        "%d of %d lines flown; %d edges off by %.2f ms (median), %.2f ms (99%%)"
        % (len(lines) - failed, len(lines), len(everything), 1e3 * median, 1e3 * most)
    )
    return 1 if failed or median > MAX_MEDIAN_ERROR else 0


if __name__ == "__main__":
    sys.exit(main())
