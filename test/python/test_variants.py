"""The core for each kind of processor: the loader chooses one, and all give the same results."""
import json
import os
import subprocess
import sys

import pytest
from conftest import MODEL, ROOT

WIDE = ["-AVX512F", "-AVX512CD", "-AVX512VL", "-AVX512DQ", "-AVX512BW"]
# (folder of the core, features that the processor does not have)
KINDS = [("plain", WIDE + ["-AVX2"]), ("x86-64-v3", WIDE), ("x86-64-v4", [])]
PROGRAM = """
import json, sys
import numpy as np
from ground import _core

model = _core.load_model(sys.argv[1])
for effect, values in {"motor_lag": {"tau": 0.04}, "quadratic_drag": {"cx": 0.002, "cy": 0.002, "cr": 1e-6},
                       "wind": {"wx": 0.1, "wy": -0.2}}.items():
    model.add_effect(effect)
    for name, value in values.items():
        model.set_value(effect + "." + name, value)
bits = np.array(_core.make_prbs(9, 3), float)[:60]
rows = np.column_stack([np.arange(60) / 15, bits, np.ones(60)])
times = np.arange(401) / 100
motion = _core.simulate(model, rows, times, np.zeros(3), np.zeros(3))
noise = 0.05 * np.random.RandomState(1).randn(len(times), 3)
run = _core.RunData("run", times, motion["eta"], motion["nu"] + noise * motion["nu"].std(axis=0), rows)
windows = _core.cut_windows(run, 0, 0, 1e9, 0.5)
fit = _core.SimulationError([run], windows).fit(model, ["I_z", "k", "Y_v", "motor_lag.tau", "wind.wx"])
with open("/proc/self/maps") as maps:
    core = [line.split()[-1] for line in maps if "libground_model" in line][0]
print(json.dumps({"core": core, "end": list(motion["eta"][-1]) + list(motion["nu"][-1]),
                  "fit": [p["value"] for p in fit["parameters"]]}))
"""


def plain_folder():
    """Folder of the plain core in a build for this processor only, else None."""
    for prefix in os.environ["CMAKE_PREFIX_PATH"].split(":"):
        folder = os.path.join(prefix, "lib", "plain")
        if os.path.isfile(os.path.join(folder, "libground_model.so")):
            return folder
    return None


def results(without, first=None):
    """Results of PROGRAM while features of the processor are masked; `first` is searched first."""
    tunables = "glibc.cpu.hwcaps=" + ",".join(without) if without else ""
    environment = dict(os.environ, GLIBC_TUNABLES=tunables)
    if first:
        environment["LD_LIBRARY_PATH"] = first + ":" + os.environ.get("LD_LIBRARY_PATH", "")
    out = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(MODEL)],
        check=True,
        stdout=subprocess.PIPE,
        env=environment,
        cwd=str(ROOT),
    ).stdout
    return json.loads(out)


def test_all_kinds_give_the_same_results():
    plain = plain_folder()
    if plain:
        found = {"plain": results([], plain), "native": results([])}
    else:
        found = {kind: results(without) for kind, without in KINDS}
    cores = {kind: f["core"] for kind, f in found.items()}
    assert "glibc-hwcaps" not in cores["plain"]
    if len(set(cores.values())) == 1:
        assert not plain, cores
        pytest.skip("this processor or C library supports one kind of core only")
    for kind, core in cores.items():
        print(kind, core)
        assert "glibc-hwcaps" not in core or os.path.exists(core)
    for kind in cores:
        assert found[kind]["end"] == pytest.approx(found["plain"]["end"], rel=1e-11, abs=1e-11)
        assert found[kind]["fit"] == pytest.approx(found["plain"]["fit"], rel=1e-6)
