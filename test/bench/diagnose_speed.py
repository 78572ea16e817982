#!/usr/bin/python3
"""How long a person waits for `identify diagnose`: to the first line of the verdict and to the page.

Four runs of 8 s with one effect, several and none hidden, and the recordings of 2019-04-16 if --recordings
has them. Prints a table, or one JSON object with --json.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time

import yaml

HERE = os.path.dirname(os.path.abspath(__file__))
MODEL = os.path.join(HERE, "../../cfg/hovercraft/tiny_whoover.yaml")
IDENTIFY = ["rosrun", "ground", "identify"]
INPUTS = [["prbs"], ["prbs", "--clock", "5"], ["multilevel-prbs", "--clock", "8"]]
INPUTS.append(["differential-prbs", "--clock", "10"])
HIDDEN = {
    "nothing": [],
    "motor_lag": [{"name": "motor_lag", "tau": 0.02}],
    "floor_tilt": [{"name": "floor_tilt", "sx": 0.0066, "sy": 0.005}],
    "yaw_bias, input_delay": [{"name": "yaw_bias", "n0": 2e-5}, {"name": "input_delay", "delay": 0.01}],
    "motor_lag, thrust_asymmetry, com_offset": [
        {"name": "motor_lag", "tau": 0.01},
        {"name": "thrust_asymmetry", "a": 0.015},
        {"name": "com_offset", "xg": 8e-4, "yg": 2e-4},
    ],
}
STAMPS = ["2019-04-16-11-24-59", "2019-04-16-11-28-36", "2019-04-16-11-30-28"]
GOALS = {"verdict": 4.0, "page": 6.0, "recordings": 30.0}  # [s]


def record(folder, name, effects, count, seconds):
    """Bags of `count` runs of a craft with hidden effects."""
    with open(MODEL) as file:
        model = yaml.safe_load(file)
    truth = os.path.join(folder, name + ".yaml")
    with open(truth, "w") as file:
        yaml.safe_dump(dict(model, effects=effects), file, sort_keys=False)
    bags = []
    for seed in range(count):
        bags.append(os.path.join(folder, "%s-%d.bag" % (name, seed)))
        place = ["0.3", "-0.2", "%g" % (1.3 * seed)]
        options = [*INPUTS[seed % len(INPUTS)], "--duration", "%g" % seconds, "--seed", str(seed)]
        options += ["--start-pose", *place, "-o", bags[-1]]
        command = [*IDENTIFY, "simulate", "--model", truth, "--input", *options]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return bags


def imported(folder, recordings):
    """Bags of the real recordings; empty where they are not."""
    bags = []
    for stamp in STAMPS:
        tables = [os.path.join(recordings, "%s_%s.csv" % (what, stamp)) for what in ("controls", "pose")]
        if not all(map(os.path.isfile, tables)):
            return []
        bags.append(os.path.join(folder, stamp + ".bag"))
        command = [*IDENTIFY, "import", *tables, "-o", bags[-1]]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return bags


def diagnose(bags, *options):
    """Times of a diagnosis [s]: verdict, page, processor."""
    with tempfile.TemporaryDirectory() as folder:
        out = ["-o", os.path.join(folder, "out"), "--progress", "off"]
        command = [*IDENTIFY, "diagnose", *bags, "--model", MODEL, *out, *options]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        begin = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        process.stdout.readline()
        verdict = time.perf_counter() - begin
        _, complaints = process.communicate()
        page = time.perf_counter() - begin
        if process.returncode:
            sys.exit(complaints.decode())
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = sum(getattr(after, f) - getattr(before, f) for f in ("ru_utime", "ru_stime"))
    return {"verdict": verdict, "page": page, "processor": used}


def waits(folder, recordings, repeats):
    """Times of each case, each several times."""
    found = {}
    for name, effects in HIDDEN.items():
        bags = record(folder, name.replace(", ", "-"), effects, 4, 8)
        found[name] = [diagnose(bags) for _ in range(repeats)]
    bags = imported(folder, recordings) if recordings else []
    if bags:
        found["recordings of 2019-04-16"] = [diagnose(bags)]
    return found


def print_table(waits):
    print("%-42s %10s %10s %10s" % ("diagnosis [s]", "verdict", "page", "processor"))
    for name, repeated in waits.items():
        real = name.startswith("recordings")
        for times in repeated:
            print("%-42s %10.2f %10.2f %10.2f" % (name, *times.values()), end="")
            late = times["page"] > GOALS["recordings" if real else "page"]
            late |= not real and times["verdict"] > GOALS["verdict"]
            print("  late" if late else "")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", metavar="DIR", help="folder of controls_*.csv and pose_*.csv")
    parser.add_argument("--repeats", type=int, default=3, help="of each simulated case (3)")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        result = waits(folder, arguments.recordings, arguments.repeats)
    if arguments.json:
        print(json.dumps(result))
    else:
        print_table(result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
