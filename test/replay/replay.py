#!/usr/bin/python3
"""make replay: recordings through reader, repair, fit and diagnosis, compared with the last release.

Each case of cases.yaml gives numbers and words. Those that differ from released.json are printed; a case that
differs needs a line with `replay: CASE` in CHANGELOG.md, above that release, that says why. Exit status 1
without one. --release writes what the cases give now, for the version of package.xml.
"""

import argparse
import json
import math
import pathlib
import sys
import tempfile

import numpy as np
import yaml

import ground
from ground import _core
from ground.checks import findings
from ground.data import import_csv
from ground.data.measured import repaired
from ground.support.progress import Work

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
RELEASED = HERE / "released.json"
TOLERANCE = 0.01  # relative difference of a number that needs no reason: other processors round otherwise
SIMULATED = "cfg/hovercraft/tiny_whoover.yaml"
INPUTS = [("prbs", {}), ("prbs", {"clock": 5.0}), ("multilevel-prbs", {"clock": 8.0})]
INPUTS.append(("differential-prbs", {"clock": 10.0}))


def simulated(effects):
    """Four runs of 8 s of a craft with effects."""
    craft = ground.Model.load(ROOT / SIMULATED)
    for effect in effects:
        craft = craft + ground.Effect(**effect)
    for seed, (design, clock) in enumerate(INPUTS):
        start = (0.3, -0.2, 1.3 * seed)
        yield ground.simulate(
            craft, design, duration=8.0, seed=seed, start_pose=start, name="run%d" % seed, **clock
        )


def recorded(case, folder):
    """The runs of a case; none where the files are not there."""
    if "exports" in case:
        for pose in sorted(ROOT.parent.glob(case["exports"])):
            controls = pose.with_name(pose.name.replace("pose_", "controls_"))
            bag = pathlib.Path(folder) / (pose.stem + ".bag")
            import_csv.write_bag(str(controls), str(pose), str(bag))
            yield from ground.read(bag)
    else:
        found = sorted(ROOT.parent.glob(case["files"]))
        yield from ground.read(found, mapping=placed(case["mapping"])) if found else ()


def placed(path):
    """The path of a file of the workspace, or beside it."""
    return str((ROOT.parent if path.startswith("shared/") else ROOT) / path)


def numbers(model, runs):
    """What reader, repair, fit and diagnosis give, by name."""
    described = findings.describe(repaired(runs, Work()))
    nu = np.concatenate([run.motion.nu for run in runs])
    sizes = np.column_stack([np.hypot(nu[:, 0], nu[:, 1]), np.abs(nu[:, 2])])
    fastest = np.nanmax(sizes, axis=0, initial=0.0).tolist()
    found = {
        "poses": sum(len(run.pose_times) for run in runs),
        "usable [s]": sum(d["usable"]["duration"] for d in described),
        "noise of positions [mm]": 1e3 * max(d["poses"]["noise"]["position"] for d in described),
        "noise of headings [mrad]": 1e3 * max(d["poses"]["noise"]["heading"] for d in described),
        "speed [m/s]": math.sqrt(np.nanmean((nu[:, :2] ** 2).sum(axis=1))),
        "rate of turn [rad/s]": math.sqrt(np.nanmean(nu[:, 2] ** 2)),
        "largest speed [m/s]": fastest[0],
        "largest rate of turn [rad/s]": fastest[1],
        "suspected": sorted({s["kind"] for d in described for s in d["suspicions"]}),
    }
    diagnosis = ground.diagnose(model, runs)
    nominal = diagnosis.report["nominal"]["parameters"]
    found.update({"refit " + name: one["value"] for name, one in nominal.items()})
    found.update({"verdict": diagnosis.verdict, "effects": sorted(diagnosis.effects)})
    found.update({"error before": diagnosis.error[0], "error after": diagnosis.error[-1]})
    return found


def tried(case, folder):
    """The numbers of a case; its refusal where ground refuses it; None without its files."""
    try:
        if isinstance(case, list):
            return numbers(ground.Model.load(ROOT / SIMULATED), list(simulated(case)))
        runs = list(recorded(case, folder))
        return numbers(ground.Model.load(placed(case["model"])), runs) if runs else None
    except ground.GroundError as refusal:
        return {"refused": str(refusal).replace(str(ROOT.parent), "..")}


def differences(before, now):
    """Names whose value differs by more than rounding."""
    for name in {**before, **now}:
        a, b = before.get(name), now.get(name)
        if isinstance(a, float) and isinstance(b, float):
            if not math.isclose(a, b, rel_tol=TOLERANCE, abs_tol=1e-12):
                yield name, a, b
        elif a != b:
            yield name, a, b


def reasons(version):
    """What the change log says of the versions after this one."""
    return (ROOT / "CHANGELOG.md").read_text().split("\n## [%s]" % version)[0]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", metavar="CASE", nargs="+", help="of cases.yaml")
    parser.add_argument("--release", action="store_true", help="keep what the cases give now")
    arguments = parser.parse_args()
    listed = yaml.safe_load((HERE / "cases.yaml").read_text())
    cases = {**listed["simulated"], **listed["recorded"]}
    kept = json.loads(RELEASED.read_text())
    released, unexplained, said = kept["cases"], 0, reasons(kept["version"])
    for name in arguments.only or cases:
        with tempfile.TemporaryDirectory() as folder:
            now = tried(cases[name], folder)
        if now is None:
            print("%-20s left out: its recordings are not there" % name, flush=True)
            continue
        changed = list(differences(released.get(name, {}), now))
        explained = "replay: " + name in said
        unexplained += bool(changed) and not explained and not arguments.release
        verdict = (
            "as released" if not changed else "differs, as the change log says" if explained else "differs"
        )
        print("%-20s %s" % (name, verdict), flush=True)
        for what, a, b in changed:
            print("  %-26s %s -> %s" % (what, a, b), flush=True)
        released[name] = now
    if arguments.release:
        kept["version"] = _core.version
        RELEASED.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n")
    elif unexplained:
        print("%d cases differ: say why in CHANGELOG.md, in a line with `replay: CASE`" % unexplained)
    return 1 if unexplained else 0


if __name__ == "__main__":
    sys.exit(main())
