"""What was done, as a script in Python and in shell that gives the same numbers, and what else is saved."""

import os
import shlex
from typing import List, Mapping

from ground.support import files
from ground.workshop.session import Session, Stage

CALL = "rosrun ground identify %s --model %s -o %s --force%s"
HEAD = '''"""What was done on the workbench. It prints the error of each model: predictions after %g s."""

import ground

read = %s
recordings = {run.name: run for run in ground.read(read%s)}


def runs(names, cuts):
    """The runs fitted to, without what was left out."""
    return [recordings[n].without(*cuts[n]) if cuts.get(n) else recordings[n] for n in names]


def show(number, what, error):
    """A line of the history."""
    print("%%d %%s: %%.6g mm, %%.6g deg" %% (number, what, error.position_mm, error.heading_deg))


models = {}
%s'''


def path_to(session: Session, node: int) -> List[Stage]:
    """The models from the first to one of the history."""
    return [*path_to(session, session.nodes[node].parent), session.nodes[node]] if node else []


def python(session: Session, reading: Mapping[str, object]) -> str:
    """All of the history, in Python."""
    lines = ["given = ground.Model.parse(%r)" % session.nodes[1].model]
    for number, node in sorted(session.nodes.items()):
        at = "runs(%r, %r)" % (node.runs, node.cuts)
        before, kind = "models[%d]" % node.parent, node.kind
        as_is = "ground.Predictor(given, %s).error(models[%d])" % (at, number)
        if kind == "start":
            lines.append("models[1] = given")
        elif kind == "set":
            varied = "%s.with_values(%r)" % (before, node.values)
            lines.append("models[%d] = ground.Model.parse(%s.format())" % (number, varied))
        elif kind == "fit":
            lines.append("free = %r" % list(node.parameters or ()))
            lines.append("found = ground.fit(%s, %s, free=free)" % (before, at))
        else:
            for effect in node.added():
                lines.append("found = ground.add(%s, ground.Effect.of(%r), %s)" % (before, effect, at))
                before = "ground.Model.parse(found.model.format())"
        if kind in ("fit", "add"):
            key = "fitted" if kind == "fit" else "with"
            lines.append("models[%d] = ground.Model.parse(found.model.format())" % number)
            as_is = "found.prediction.errors[%r]" % key
        lines.append("show(%d, %r, %s)" % (number, node.what, as_is))
    lines.append('models[%d].save("model.yaml", force=True)' % session.current)
    paths = sorted({os.path.abspath(run.path) for run in session.recordings})
    options = "".join(", %s=%r" % item for item in reading.items())
    return HEAD % (session.nodes[1].seconds, paths, options, "\n".join(lines)) + "\n"


def shell(session: Session, reading: Mapping[str, object]) -> str:
    """The way to the current model, as command lines."""
    import yaml

    lines = ["#!/bin/sh", "# What was done on the workbench, up to model %d." % session.current, "set -e"]
    by_name = {run.name: os.path.abspath(run.path) for run in session.recordings}
    options = ""
    for name, value in reading.items():
        values = value if isinstance(value, (list, tuple)) else [value]
        options += " --%s %s" % (name.replace("_", "-"), " ".join(shlex.quote(str(one)) for one in values))
    for node in path_to(session, session.current):
        file = "step_%d.yaml" % node.id
        before, kind = "step_%d.yaml" % node.parent, node.kind
        if kind in ("start", "set"):
            lines += ["cat > %s <<'MODEL'" % file, node.model.rstrip("\n"), "MODEL"]
            continue
        bags = " ".join(shlex.quote(by_name[name]) for name in node.runs)
        spans = [(name, *span) for name in node.runs for span in node.cuts.get(name, ())]
        cuts = [shlex.quote("%s=%.9g,%.9g" % span) for span in spans]
        more = options + (" --leave-out %s" % " ".join(cuts) if cuts else "")
        if kind == "fit":
            more += " --free " + " ".join(node.parameters or ())
            lines.append(CALL % ("fit " + bags, before, file, more))
            continue
        for effect in node.added():
            name = effect if isinstance(effect, str) else "effect_%d.yaml" % node.id
            if not isinstance(effect, str):
                lines += ["cat > %s <<'EFFECT'" % name, yaml.safe_dump(effect, sort_keys=False) + "EFFECT"]
            after = file if effect == node.added()[-1] else "step_%d_%s.yaml" % (node.id, effect)
            lines.append(CALL % ("add %s %s" % (name, bags), before, after, more))
            before = after
    return "\n".join([*lines, "cp step_%d.yaml model.yaml" % session.current]) + "\n"


def save(session: Session, folder: str, reading: Mapping[str, object]) -> None:
    """Writes model and scripts into the folder, and begins the job that writes the page."""
    with session.lock:
        texts = {"script.py": python(session, reading), "script.sh": shell(session, reading)}
        texts["model.yaml"] = session.model_of(session.current).format()
        for name, text in texts.items():
            files.write_text(os.path.join(folder, name), text, force=True)
        session.begin("page", {"folder": folder, "given": session.given.format(), "files": list(texts)})
