"""What a person has done on the workbench: a tree of models, roles of runs, and what is known of them."""

import threading
from dataclasses import asdict
from typing import Any, Dict, List, Optional, Sequence, Tuple

from ground import Effect, Model, Predictor, Recording, Room
from ground.checks import findings, quality
from ground.support.annotations import Document
from ground.support.errors import GroundError
from ground.support.event_file import EventFile
from ground.support.jobs import Jobs
from ground.workshop import work

SCHEMA = "ground/workbench/1"  # of the work file
FIT, HELD_OUT, OFF = "fit", "held out", "off"  # roles of runs


class Session:
    """The state of a workbench. Each change is an event: on the disk first, then applied, then shown on the
    pages."""

    def __init__(
        self,
        recordings: Sequence[Recording],
        model: Model,
        held_out: Sequence[str],
        room: Optional[Room],
        file: EventFile,
        jobs: Jobs,
    ) -> None:
        self.recordings, self.room, self._file = list(recordings), room, file
        self.given, self.jobs = model, jobs
        self.lock, self._building = threading.RLock(), threading.Lock()
        self.changed = threading.Condition(self.lock)
        self.version = 0
        self.nodes: Dict[int, Document] = {}
        self.current = 0
        self.roles: Dict[str, str] = {}
        self.cuts: work.Cuts = {}
        self.judge: Optional[List[Any]] = None
        self.search: Document = {"state": "none", "rows": []}
        self.formula: Document = {}
        self.running: Dict[int, Document] = {}
        self.last: Dict[str, Document] = {}  # by kind of job, what makes no model, or why it failed
        self._renewed: Tuple[str, Document] = ("", {})
        self.opened = 0  # how often held-out runs were seen
        self._ready: Dict[str, Predictor] = {}
        self._quality = {d["name"]: d for d in findings.describe([quality.repaired(r) for r in recordings])}
        runs = {run.name: run.identity for run in recordings}
        if not file.events:
            self._do({"event": "begin", "schema": SCHEMA, "runs": runs, "model": model.format()})
        elif file.events[0]["runs"] != runs:
            raise GroundError("%s is of other runs: give -o another folder" % file.path)
        for event in file.events:
            self._apply(event)
        if not self.roles:
            roles = {r.name: HELD_OUT if r.name in held_out else FIT for r in recordings}
            self._do({"event": "roles", "roles": roles})
        if not self.nodes:
            self._add(0, "start", "the given model", self.given.format())
        if self.search["state"] == "running":
            self._do({"event": "search", "state": "stopped"})

    # Changes

    def _do(self, event: Document) -> None:
        with self.lock:
            self._file.add(event)
            self._apply(event)
            self.tell()

    def tell(self) -> None:
        """Lets the pages fetch the state."""
        with self.changed:
            self.version += 1
            self.changed.notify_all()

    def end(self) -> None:
        """Hears nothing any more."""
        with self.lock:
            self.running.clear()

    def wait(self, seen: int, seconds: float) -> int:
        """The number of the state, as soon as it is not the one that was seen, or after a time."""
        with self.changed:
            self.changed.wait_for(lambda: self.version != seen, seconds)
            return self.version

    def _apply(self, event: Document) -> None:
        kind = event["event"]
        if kind == "begin":
            self.given = Model.parse(event["model"])
        elif kind in ("roles", "judge", "formula", "current"):
            setattr(self, kind, event[kind])
        elif kind == "node":
            self.nodes[event["node"]["id"]] = event["node"]
            self.current = event["node"]["id"]
        elif kind == "cuts":
            self.cuts = {name: [(a, b) for a, b in spans] for name, spans in event["cuts"].items()}
        elif kind == "search":
            self.search = {**self.search, **{k: v for k, v in event.items() if k != "event"}}
        elif kind == "opened":
            for name, error in event["errors"].items():
                self.nodes[int(name)]["holdout"] = error
            self.opened = event["count"]

    # What is known

    def names(self, role: str) -> List[str]:
        """Names of the runs of a role."""
        return [run.name for run in self.recordings if self.roles.get(run.name) == role]

    def predictor(self, names: Sequence[str], cuts: Optional[work.Cuts] = None) -> Predictor:
        """The Predictor of some runs, without what is left out."""
        if not names:
            raise GroundError("no run is ticked to be fitted")
        cuts = self.cuts if cuts is None else cuts
        key = repr((list(names), sorted((name, cuts[name]) for name in names if name in cuts)))
        with self._building:
            if key not in self._ready:
                if len(self._ready) > 40:
                    self._ready.clear()
                self._ready[key] = Predictor(self.given, work.parts(self.recordings, names, cuts))
            return self._ready[key]

    def model_of(self, node: int) -> Model:
        """The model of a node; GroundError if there is none."""
        if node not in self.nodes:
            raise GroundError("there is no model %s" % node)
        return Model.parse(self.nodes[node]["model"])

    def varied(self, node: int, values: Document) -> Model:
        """The model of a node with other values."""
        model = self.model_of(node)
        return model.with_values({str(k): float(v) for k, v in values.items()}) if values else model

    def _judged(
        self, node: Document, after: Optional[Document] = None, ticked: Optional[Document] = None
    ) -> Document:
        """A node with its error on the runs that are ticked: as it is; after: cross-validated, where it was
        fitted; ticked: what was ticked then."""
        ticked = ticked or self.ticked()
        ready, model = self.predictor(ticked["runs"], ticked["cuts"]), Model.parse(node["model"])
        off = asdict(ready.error(model))
        before = self.nodes.get(node["parent"])  # other values hardly change the floor
        floor = node.get("floor") or (before["floor"] if before else asdict(ready.noise(model)))
        return {
            **node,
            "seconds": ready.horizon,
            "as_is": off,
            "error": after or off,
            "by": "cross-validated" if after else "as it is",
            "floor": floor,
            **ticked,
        }

    def ticked(self) -> Document:
        """The runs that are fitted, and what of them is left out."""
        names = self.names(FIT)
        return {"runs": names, "cuts": {n: [list(s) for s in self.cuts[n]] for n in names if n in self.cuts}}

    def _now(self) -> Document:
        """The error of the current model on what is ticked, where that has changed since; else nothing."""
        node, ticked = self.nodes[self.current], self.ticked()
        if all(node[key] == ticked[key] for key in ticked):
            return {}
        key = repr((self.current, node["model"], ticked))
        if self._renewed[0] != key:
            made = self._judged(node)
            self._renewed = key, {name: made[name] for name in ("error", "by", "floor", "as_is")}
        return {**self._renewed[1], "before": None}

    def state(self) -> Document:
        """All that a page shows."""
        with self.lock:
            model = self.model_of(self.current)
            return {
                "version": self.version,
                "runs": [self._run(recording) for recording in self.recordings],
                "nodes": [{k: v for k, v in node.items() if k != "model"} for node in self.nodes.values()],
                "current": self.current,
                "now": self._now(),
                "effects": list(model.effects),
                "parameters": [
                    {
                        "value": model[p["name"]],
                        **{k: p[k] for k in ("name", "unit", "doc", "lower", "upper")},
                    }
                    for p in model.core.parameters()
                ],
                "judge": self.judge,
                "search": self.search,
                "formula": self.formula,
                "opened": self.opened,
                "running": [{k: v for k, v in j.items() if k != "effect"} for j in self.running.values()],
                "last": self.last,
                "room": None if self.room is None else self.room.corners.tolist(),
            }

    def _run(self, recording: Recording) -> Document:
        d = self._quality[recording.name]
        poses = d["poses"]
        told = "%.1f of %.1f s usable, %.4g Hz, noise %.2g mm" % (
            d["usable"]["duration"], d["usable"]["of"], poses["rate"], 1e3 * poses["noise"]["position"],
        )  # fmt: skip
        odd = list(findings.grave(d))
        return {
            "name": recording.name,
            "role": self.roles.get(recording.name, OFF),
            "quality": told,
            "odd": odd,
            "end": d["usable"]["of"],
            "cuts": self.cuts.get(recording.name, []),
        }

    # What a person does

    def set_values(self, node: int, values: Document) -> None:
        """Other values of parameters: a new model, or a change of the newest one."""
        with self.lock:
            model, own = self.varied(node, values), self.nodes[node]
            is_last = own["kind"] == "set" and not any(n["parent"] == node for n in self.nodes.values())
            given = {**own.get("values", {}), **values} if is_last else dict(values)
            self._add(
                own["parent"] if is_last else node,
                "set",
                ", ".join("%s %.4g" % item for item in given.items()),
                model.format(),
                id=node if is_last else None,
                values=given,
            )

    def _add(
        self,
        parent: int,
        kind: str,
        what: str,
        model: str,
        after: Optional[Document] = None,
        ticked: Optional[Document] = None,
        **more: Any,
    ) -> None:
        number = more.pop("id", None) or max(self.nodes, default=0) + 1
        node = {"id": number, "parent": parent, "kind": kind, "what": what, "model": model, **more}
        self._do({"event": "node", "node": self._judged(node, after, ticked)})

    def select(self, node: int) -> None:
        """Goes to a model of the history."""
        self.model_of(node)
        self._do({"event": "current", "current": node})

    def undo(self) -> None:
        """Goes back to the model before."""
        parent = self.nodes[self.current]["parent"]
        if parent:
            self._do({"event": "current", "current": parent})

    def set_role(self, run: str, role: str) -> None:
        """A run is fitted, held out or left alone."""
        with self.lock:
            if run not in self.roles or role not in (FIT, HELD_OUT, OFF):
                raise GroundError("there is no run %s, or role %s" % (run, role))
            roles = {**self.roles, run: role}
            if FIT not in roles.values():
                raise GroundError("at least one run has to be fitted")
            self._do({"event": "roles", "roles": roles})

    def cut(self, run: str, span: Optional[Sequence[float]]) -> None:
        """Leaves a span of a run out of fits; None: nothing."""
        with self.lock:
            if run not in self.roles:
                raise GroundError("there is no run %s" % run)
            spans = [*self.cuts.get(run, []), _span(span)] if span else []
            cuts = {**self.cuts, run: spans}
            work.parts(self.recordings, [run], cuts)  # raises where too little is left
            self._do({"event": "cuts", "cuts": {name: own for name, own in cuts.items() if own}})

    def judge_on(self, run: str, span: Optional[Sequence[float]]) -> None:
        """Candidates are judged on a span of a run; None: on all fitted runs."""
        self._do({"event": "judge", "judge": [run, *_span(span)] if span else None})

    def open(self) -> None:
        """Shows the errors of the current model and the given one on the held-out runs."""
        with self.lock:
            ready = self.predictor(self.names(HELD_OUT), {}) if self.names(HELD_OUT) else None
            if ready is None:
                raise GroundError("no run is held out")
            wanted = {1, self.current, self.nodes[self.current]["parent"]} - {0}
            errors = {str(n): asdict(ready.error(self.model_of(n))) for n in sorted(wanted)}
            self._do({"event": "opened", "errors": errors, "count": self.opened + 1})

    def effect(self, given: Any) -> Any:
        """An effect of the library by name, or formulas by channel as an entry of a model file."""
        model = self.model_of(self.current)
        if isinstance(given, str):
            model.with_effect({"name": given})  # raises where the library has none, or the model has it
            return given
        if "expression" not in given:
            taken = [name for name in model.effects if name.startswith("formula")]
            formulas = {channel: str(given.get(channel, "")) for channel in ("X", "Y", "N")}
            name = "formula_%d" % (1 + len(taken)) if taken else "formula"
            given = Effect.of_formulas(**formulas, name=name, thrusters=model.thrusters).entry
        model.with_effect(given)  # raises where it is no effect
        return given

    def check(self, given: Document) -> Document:
        """What is known at once of a formula: its parameters with their units. GroundError says what is
        wrong."""
        entry = self.effect(given)
        self._do({"event": "formula", "formula": given})
        return {"entry": entry, "units": {k: p["unit"] for k, p in entry["parameters"].items()}}

    # Long work

    def begin(self, kind: str, given: Any = None) -> int:
        """Begins fit, add, try or search on the current model."""
        with self.lock:
            if kind in ("fit", "add") and any(j["kind"] in ("fit", "add") for j in self.running.values()):
                raise GroundError("a fit is going on: wait for it, or stop it")
            for number in [n for n, j in self.running.items() if j["kind"] == kind]:
                self.stop(number)
            self.last.pop(kind, None)
            node, ticked, effect = self.current, self.ticked(), None
            if kind in ("add", "try"):
                effect = self.effect(given)
            if kind == "search":
                self._do({"event": "search", "state": "running", "rows": [], "node": node, "answer": [],
                          "proposal": None, "next": None, "judge": self.judge})  # fmt: skip
            more = {"search": self.judge, "page": given}.get(kind, effect)
            number = self.jobs.begin(kind, self.nodes[node]["model"], ticked["runs"], ticked["cuts"], more)
            job = {"id": number, "kind": kind, "node": node, "told": "begins"}
            self.running[number] = {**job, "effect": effect, "ticked": ticked}
            self.tell()
            return number

    def stop(self, number: int) -> None:
        """Ends a job; what it has told stays."""
        with self.lock:
            job = self.running.pop(number, None)
            self.jobs.end(number)
            if job and job["kind"] == "search":
                self._do({"event": "search", "state": "stopped"})
            self.tell()

    def heard(self, number: int, kind: str, content: Any) -> None:
        """Takes what a job tells."""
        with self.lock:
            job = self.running.get(number)
            if job is None:
                return
            if kind == "progress":
                job.update(told="%(what)s" % content, done=content["done"], of=content["of"])
            elif kind == "rows":
                self._do({"event": "search", "rows": content})
            elif kind == "failed":
                self.last[job["kind"]] = {"failed": content}
                if job["kind"] == "search":
                    self._do({"event": "search", "state": "failed"})
            elif kind == "done":
                try:
                    self._done(job, content)
                except GroundError as error:
                    self.last[job["kind"]] = {"failed": str(error)}
            elif kind == "ended":
                self.running.pop(number)
            self.tell()

    def _done(self, job: Document, found: Document) -> None:
        kind, node = job["kind"], job["node"]
        if kind == "search":
            self._do({"event": "search", "state": "done", **found})
        elif kind in ("try", "page"):
            self.last[kind] = {k: v for k, v in found.items() if k != "model"}
        else:
            what = "fit" if kind == "fit" else "add " + found["effect"]
            more = {
                k: found[k]
                for k in ("parameters", "before", "floor", "helps", "reason", "remarks")
                if k in found
            }
            if kind == "add":
                more["effect"] = job["effect"]
            self._add(node, kind, what, found["model"], found["after"], job["ticked"], **more)


def _span(given: Sequence[float]) -> Tuple[float, float]:
    start, end = sorted(float(value) for value in given)
    if not end > start:
        raise GroundError("a stretch needs a length")
    return start, end
