"""What a person has done on the workbench: a tree of models, roles of runs, and what is known of them."""

import math
import threading
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

from ground import Effect, Model, Predictor, Recording, Room
from ground.checks import findings, quality
from ground.support import quantities
from ground.support.annotations import Document
from ground.support.errors import GroundError
from ground.support.event_file import EventFile
from ground.support.jobs import Jobs
from ground.workshop import work

SCHEMA = "ground/workbench/1"  # of the work file
FIT, HELD_OUT, OFF = "fit", "held out", "off"  # roles of runs
REFIT = ("parameters", "before", "floor", "helps", "reason", "remarks")  # of fits, that a node has
PARAMETER = ("name", "unit", "doc", "lower", "upper")  # what a page shows of one
Entry = Mapping[str, object]  # effect, as model files list it
Ticked = Tuple[List[str], work.Cuts]  # the runs that are fitted, and the spans that are left out


@dataclass(frozen=True)
class Stage:
    """A model of the history, and its errors on the runs that were ticked. None: not known."""

    id: int
    parent: int  # id; 0: none
    kind: str  # how it was made: start, set, fit or add
    what: str  # the same in words
    model: str  # text of the model file
    values: Optional[Dict[str, float]] = None  # that were set
    effect: Any = None  # that was added: a name, several names, or an entry
    parameters: Optional[Dict[str, Dict[str, object]]] = None  # fitted, by name
    before: Optional[work.Errors] = None  # of the model before
    helps: Optional[bool] = None  # whether the effect does
    reason: Optional[str] = None
    remarks: Optional[Sequence[str]] = None  # on the fit
    seconds: float = 0.0  # time over which poses are predicted
    as_is: Optional[work.Errors] = None
    error: Optional[work.Errors] = None  # cross-validated, where it was fitted
    by: str = "as it is"  # what error is
    floor: Optional[work.Errors] = None  # that the noise of poses leaves
    holdout: Optional[work.Errors] = None  # on runs held out
    runs: List[str] = field(default_factory=list)
    cuts: work.Cuts = field(default_factory=dict)

    def entry(self) -> Dict[str, object]:
        """The node as events list it."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def added(self) -> List[Any]:
        """The effects that were added."""
        return self.effect if isinstance(self.effect, list) else [self.effect]


@dataclass(frozen=True)
class SearchState:
    """What a search for missing effects has found."""

    state: str = "none"  # none, running, stopped, failed or done
    rows: Sequence[Mapping[str, object]] = ()
    node: int = 0  # model that it began with
    answer: Sequence[Sequence[str]] = ()
    proposal: Optional[Entry] = None
    next: Optional[Mapping[str, object]] = None  # experiment
    judge: Optional[List[Any]] = None


@dataclass
class Job:
    """Work that goes on."""

    id: int
    kind: str
    node: int  # model that it began with
    ticked: Ticked
    effect: Any
    told: str = "begins"
    done: float = 0
    of: float = 0


class Session:
    """The state of a workbench. Each change is an event: first on the disk, then applied, then shown."""

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
        self.nodes: Dict[int, Stage] = {}
        self.current = 0
        self.roles: Dict[str, str] = {}
        self.cuts: work.Cuts = {}
        self.judge: Optional[List[Any]] = None
        self.search = SearchState()
        self.formula: Entry = {}
        self.running: Dict[int, Job] = {}
        self.last: Dict[str, Mapping[str, object]] = {}  # by kind of job: no model, or why it failed
        self._renewed: Tuple[str, Dict[str, Any]] = ("", {})
        self.opened = 0  # how often held-out runs were seen
        self._ready: Dict[str, Predictor] = {}
        self._quality = {d["name"]: d for d in findings.describe([quality.repaired(r) for r in recordings])}
        runs = {run.name: run.identity for run in recordings}
        if not file.events:
            self._do("begin", schema=SCHEMA, runs=runs, model=model.format())
        elif file.events[0]["runs"] != runs:
            raise GroundError("%s is from other runs: give -o another folder" % file.path)
        for event in file.events:
            self._apply(event)
        if not self.roles:
            roles = {r.name: HELD_OUT if r.name in held_out else FIT for r in recordings}
            self._do("roles", roles=roles)
        if not self.nodes:
            self._add(Stage(1, 0, "start", "the given model", self.given.format()))
        if self.search.state == "running":
            self._do("search", state="stopped")

    # Changes

    def _do(self, kind: str, **content: Any) -> None:
        event = {"event": kind, **content}
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
            node = Stage(**dict(event["node"], cuts=_cuts(event["node"]["cuts"])))
            self.nodes[node.id], self.current = node, node.id
        elif kind == "cuts":
            self.cuts = _cuts(event["cuts"])
        elif kind == "search":
            self.search = replace(self.search, **{k: v for k, v in event.items() if k != "event"})
        elif kind == "opened":
            for name, error in event["errors"].items():
                self.nodes[int(name)] = replace(self.nodes[int(name)], holdout=error)
            self.opened = event["count"]

    # What is known

    def names(self, role: str) -> List[str]:
        """Names of the runs of a role."""
        return [run.name for run in self.recordings if self.roles.get(run.name) == role]

    def predictor(self, names: Sequence[str], cuts: Optional[work.Cuts] = None) -> Predictor:
        """The Predictor of some runs, without what is left out."""
        if not names:
            raise GroundError("no run is ticked for fitting")
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
        return Model.parse(self.nodes[node].model)

    def varied(self, node: int, values: Mapping[str, float]) -> Model:
        """The model of a node with other values."""
        model = self.model_of(node)
        return model.with_values({str(k): float(v) for k, v in values.items()}) if values else model

    def _judged(self, node: Stage, ticked: Ticked, after: Optional[work.Errors] = None) -> Stage:
        """A node with its errors on the runs that are ticked: as it is, and after, cross-validated, where it
        was fitted."""
        ready, model = self.predictor(*ticked), Model.parse(node.model)
        off = asdict(ready.error(model))
        floor = (node.floor if after else None) or self._floor(ticked) or asdict(ready.noise(model))
        node = replace(node, seconds=ready.horizon, floor=floor, runs=ticked[0], cuts=ticked[1])
        return replace(node, as_is=off, error=after or off, by="cross-validated" if after else "as it is")

    def _floor(self, ticked: Ticked) -> Optional[work.Errors]:
        """The noise floor of some runs, by the best model that was judged on them."""
        judged = [n for n in self.nodes.values() if (n.runs, n.cuts) == ticked]
        best = min(judged, key=lambda n: (n.error or {}).get("position_mm") or math.inf, default=None)
        return best.floor if best else None

    def beside_mocap(self, error: work.Errors) -> Dict[str, object]:
        """The noise floor of what is ticked, and its words beside an error."""
        with self.lock:
            floor = self._floor(self.ticked()) or self._now()["floor"]
        return {"floor": floor, "mocap": quantities.beside_mocap(error.values(), floor.values())}

    def ticked(self) -> Ticked:
        """What is ticked now."""
        names = self.names(FIT)
        return names, {name: self.cuts[name] for name in names if name in self.cuts}

    def _now(self) -> Dict[str, Any]:
        """The error of the current model on what is ticked, where that has changed since; else nothing."""
        node, ticked = self.nodes[self.current], self.ticked()
        if (node.runs, node.cuts) == ticked:
            return {}
        key = repr((self.current, node.model, ticked))
        if self._renewed[0] != key:
            made = self._judged(node, ticked)
            now = {"error": made.error, "by": made.by, "floor": made.floor, "as_is": made.as_is}
            self._renewed = key, {**now, "before": None}
        return self._renewed[1]

    def state(self) -> Dict[str, object]:
        """All that a page shows."""
        with self.lock:
            model, now = self.model_of(self.current), self._now()
            own = model.core.parameters()
            return {
                "version": self.version,
                "runs": [self._run(recording) for recording in self.recordings],
                "nodes": [_without(node.entry(), "model") for node in self.nodes.values()],
                "current": self.current,
                "now": {**now, **self.beside_mocap(now.get("error") or self.nodes[self.current].error or {})},
                "effects": list(model.effects),
                "parameters": [{**{k: p[k] for k in PARAMETER}, "value": model[p["name"]]} for p in own],
                "judge": self.judge,
                "search": asdict(self.search),
                "formula": self.formula,
                "opened": self.opened,
                "running": [_without(asdict(job), "effect") for job in self.running.values()],
                "last": self.last,
                "room": None if self.room is None else self.room.corners.tolist(),
            }

    def _run(self, recording: Recording) -> Dict[str, object]:
        d = self._quality[recording.name]
        poses = d["poses"]
        told = "%.1f of %.1f s usable, %.4g Hz, noise %.2g mm" % (
            d["usable"]["duration"], d["usable"]["of"], poses["rate"], 1e3 * poses["noise"]["position"],
        )  # fmt: skip
        return {
            "name": recording.name,
            "role": self.roles.get(recording.name, OFF),
            "quality": told,
            "odd": list(findings.grave(d)),
            "end": d["usable"]["of"],
            "cuts": self.cuts.get(recording.name, []),
        }

    # What a person does

    def set_values(self, node: int, values: Mapping[str, float]) -> None:
        """Other values of parameters: a new model, or a change of the newest one."""
        with self.lock:
            model, own = self.varied(node, values), self.nodes[node]
            is_last = own.kind == "set" and not any(n.parent == node for n in self.nodes.values())
            given = {**(own.values or {}), **values} if is_last else dict(values)
            what = ", ".join("%s %.4g" % item for item in given.items())
            number, parent = (node, own.parent) if is_last else (max(self.nodes) + 1, node)
            self._add(Stage(number, parent, "set", what, model.format(), values=given))

    def _add(self, node: Stage, ticked: Optional[Ticked] = None, after: Optional[work.Errors] = None) -> None:
        self._do("node", node=self._judged(node, ticked or self.ticked(), after).entry())

    def select(self, node: int) -> None:
        """Goes to a model of the history."""
        self.model_of(node)
        self._do("current", current=node)

    def undo(self) -> None:
        """Goes back to the model before."""
        self.select(self.nodes[self.current].parent or self.current)

    def set_role(self, run: str, role: str) -> None:
        """A run is fitted, held out or left alone."""
        with self.lock:
            if run not in self.roles or role not in (FIT, HELD_OUT, OFF):
                raise GroundError("there is no run %s, or role %s" % (run, role))
            roles = {**self.roles, run: role}
            if FIT not in roles.values():
                raise GroundError("at least one run must be fitted")
            self._do("roles", roles=roles)

    def cut(self, run: str, span: Optional[Sequence[float]]) -> None:
        """Leaves a span of a run out of fits; None: nothing."""
        with self.lock:
            if run not in self.roles:
                raise GroundError("there is no run %s" % run)
            spans = [*self.cuts.get(run, []), _span(span)] if span else []
            cuts = {**self.cuts, run: spans}
            work.parts(self.recordings, [run], cuts)  # raises where too little is left
            self._do("cuts", cuts={name: own for name, own in cuts.items() if own})

    def judge_on(self, run: str, span: Optional[Sequence[float]]) -> None:
        """Candidates are judged on a span of a run; None: on all fitted runs."""
        self._do("judge", judge=[run, *_span(span)] if span else None)

    def open(self) -> None:
        """Shows the errors of the current model and the given one on the held-out runs."""
        with self.lock:
            ready = self.predictor(self.names(HELD_OUT), {}) if self.names(HELD_OUT) else None
            if ready is None:
                raise GroundError("no run is held out")
            wanted = {1, self.current, self.nodes[self.current].parent} - {0}
            errors = {str(n): asdict(ready.error(self.model_of(n))) for n in sorted(wanted)}
            self._do("opened", errors=errors, count=self.opened + 1)

    def effect(self, given: Any) -> Any:
        """Effects of the library, one or a list, or formulas by channel as an entry of a model file."""
        model = self.model_of(self.current)
        if not isinstance(given, dict):
            for name in [given] if isinstance(given, str) else given or [given]:
                model = model.with_effect({"name": name})  # raises where there is none, or the model has it
            return given
        if "expression" not in given:
            taken = [name for name in model.effects if name.startswith("formula")]
            formulas = {channel: str(given.get(channel, "")) for channel in ("X", "Y", "N")}
            name = "formula_%d" % (1 + len(taken)) if taken else "formula"
            given = Effect.of_formulas(**formulas, name=name, thrusters=model.thrusters).entry
        model.with_effect(given)  # raises where it is no effect
        return given

    def check(self, given: Entry) -> Dict[str, object]:
        """The entry of a formula, and the units of its parameters. GroundError says what is wrong."""
        entry = self.effect(given)
        self._do("formula", formula=given)
        return {"entry": entry, "units": {k: p["unit"] for k, p in entry["parameters"].items()}}

    # Long work

    def begin(self, kind: str, given: Any = None) -> int:
        """Begins fit, add, try or search on the current model."""
        with self.lock:
            if kind in ("fit", "add") and any(j.kind in ("fit", "add") for j in self.running.values()):
                raise GroundError("a fit is running: wait for it, or stop it")
            for number in [n for n, job in self.running.items() if job.kind == kind]:
                self.stop(number)
            self.last.pop(kind, None)
            node, ticked = self.current, self.ticked()
            effect = self.effect(given) if kind in ("add", "try") else None
            if kind == "search":
                self._do("search", **asdict(SearchState("running", node=node, judge=self.judge)))
            more = {"search": self.judge, "page": given}.get(kind, effect)
            number = self.jobs.begin(kind, self.nodes[node].model, *ticked, more)
            self.running[number] = Job(number, kind, node, ticked, effect)
            self.tell()
            return number

    def stop(self, number: int) -> None:
        """Ends a job; what it has told stays."""
        with self.lock:
            job = self.running.pop(number, None)
            self.jobs.end(number)
            if job and job.kind == "search":
                self._do("search", state="stopped")
            self.tell()

    def heard(self, number: int, kind: str, content: Any) -> None:
        """Takes what a job tells."""
        with self.lock:
            job = self.running.get(number)
            if job is None:
                return
            if kind == "progress":
                job.told, job.done, job.of = content.what, content.done, content.of
            elif kind == "rows":
                self._do("search", rows=content)
            elif kind == "failed":
                self.last[job.kind] = {"failed": content}
                if job.kind == "search":
                    self._do("search", state="failed")
            elif kind == "done":
                try:
                    self._done(job, content)
                except GroundError as error:
                    self.last[job.kind] = {"failed": str(error)}
            elif kind == "ended":
                self.running.pop(number)
            self.tell()

    def _done(self, job: Job, found: Any) -> None:
        if job.kind == "search":
            self._do("search", state="done", **found)
        elif job.kind in ("page", "try"):
            self.last[job.kind] = _without(found, "model")
        else:
            what = "fit" if job.kind == "fit" else "add " + found["effect"]
            known = {name: found[name] for name in REFIT if name in found}
            node = Stage(max(self.nodes) + 1, job.node, job.kind, what, found["model"], **known)
            self._add(replace(node, effect=job.effect), job.ticked, found["after"])


def _without(document: Dict[str, object], name: str) -> Dict[str, object]:
    return {k: v for k, v in document.items() if k != name}


def _cuts(given: Mapping[str, Sequence[Sequence[float]]]) -> work.Cuts:
    return {name: [(start, end) for start, end in spans] for name, spans in given.items()}


def _span(given: Sequence[float]) -> Tuple[float, float]:
    start, end = sorted(float(value) for value in given)
    if not end > start:
        raise GroundError("a stretch needs a length")
    return start, end
