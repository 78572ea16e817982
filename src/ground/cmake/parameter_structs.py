"""Writes C++ structs of the parameters that cfg/*.cfg describe: parameter_structs.py CFG HEADERS.

For each struct below it writes HEADERS/NAME.h. A member's default, meaning, unit and range are those of
the .cfg file. Parameters with a list of values (edit_method) are left out: their kinds have tables in C++.
"""

import re
import runpy
import sys
import types
from pathlib import Path

# struct: .cfg file, groups in it, comment
STRUCTS = {
    "EstimatorFields": ("MocapState", "Poses Kalman", "Noise of poses, and the filter."),
    "ObserverParams": ("ModelPredictive", "Observer", "Noise levels of a DisturbanceObserver."),
    "TrackingGains": ("TrajectoryTracking", "Gains", "Gains of the tracking law (4.7)."),
    "PlanParams": ("ModelPredictive", "Plan", "The horizon of plans, and the work of a decision."),
    "PlanWeights": (
        "ModelPredictive",
        "Weights",
        "Cost of a plan: weights of squared errors and inputs, relative to that of the position, 1 per m^2.",
    ),
    "PrbsParams": ("OpenLoopPRBS", "Sequence Levels", "Timing and levels of a binary sequence."),
    "ReferenceFields": ("TrajectoryTracking", "Reference", "Parameters of all kinds of references."),
    "LifecycleFields": ("TrajectoryTracking", "Common", "Parameters that all controllers share."),
    "GroundLinkFields": ("Sender", "Safety Link", "Timeouts and rates of the link."),
    "MocapFields": ("Simulator", "Mocap", "Quality of the simulated motion capture."),
}

HEADER = """#pragma once
// Written by cmake/parameter_structs.py from cfg/%(file)s.cfg.

#include <string>

#include "ground/model/tunable.h"

namespace ground {

/// %(comment)s
struct %(name)s {
%(members)s

  static const Tunables<%(name)s>& table() {
    static const Tunables<%(name)s> table = {
%(rows)s
    };
    return table;
  }
  /// Error message; empty if all values are in their ranges.
  std::string validate() const { return rangeError(table(), *this); }
};

}  // namespace ground
"""


class Generator:
    """The part of dynamic_reconfigure's ParameterGenerator that .cfg files use; keeps their groups."""

    def __init__(self):
        self.groups = {}

    def add_group(self, name):
        generator = Generator()
        self.groups[name] = generator.fields = []
        return generator

    def add(self, name, kind, level, text, default=None, low=0, high=0, edit_method=""):
        if not edit_method:
            self.fields.append((name, kind, text, default, low, high))

    def const(self, *_):
        return "kinds"

    enum = const

    def generate(self, *_):
        Generator.last = self.groups


def groups_in(path):
    """name of a group -> its fields (name, type, text, default, low, high)"""
    stub = types.ModuleType("dynamic_reconfigure.parameter_generator_catkin")
    stub.ParameterGenerator = Generator
    for kind in ("double", "int", "bool", "str"):
        setattr(stub, kind + "_t", kind)
    sys.modules["dynamic_reconfigure"] = types.ModuleType("dynamic_reconfigure")
    sys.modules[stub.__name__] = stub
    try:
        runpy.run_path(str(path))
    except SystemExit:
        pass
    return Generator.last


def literal(value):
    if isinstance(value, (bool, str)):
        return '"%s"' % value if isinstance(value, str) else str(value).lower()
    return "%.10g" % value


def write(name, cfg, headers):
    file, groups, comment = STRUCTS[name]
    found = groups_in(cfg / (file + ".cfg"))
    members, rows = [], []
    for field, kind, text, default, low, high in sum((found[group] for group in groups.split()), []):
        cpp = "std::string" if kind == "str" else kind
        members.append("  %s %s = %s;  ///< %s" % (cpp, field, literal(default), text))
        meaning, unit = re.fullmatch(r"(.*?)(?: \[(.*)\])?", text).groups()
        row = '        {{"%s", "%s", "%s", %s, %s}, &%s::%s},'
        rows.append(row % (field, unit or "", meaning, literal(low), literal(high), name, field))
    texts = dict(name=name, file=file, comment=comment, members="\n".join(members), rows="\n".join(rows))
    path = headers / (name + ".h")
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file() or path.read_text() != HEADER % texts:  # builds nothing without a change
        path.write_text(HEADER % texts)


if __name__ == "__main__":
    sys.dont_write_bytecode = True
    for struct in STRUCTS:
        write(struct, *map(Path, sys.argv[1:]))
