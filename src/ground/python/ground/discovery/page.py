"""report.html of a discovery: its result first, then the story flight by flight.

It is made from the Story and the files of its folder, at any time of a discovery.
"""

import os
from typing import Dict, List, Optional

import numpy as np

from ground import _core
from ground.annotations import Array
from ground.discovery.story import CONFIRM, Finding, Flight, Flown, PRESENT, SLIGHT, Story, TRACK
from ground.discovery import figures, words
from ground.reports import appearance, page, report
from ground.discovery.words import PURPOSES, error, millimetres
from ground.reports.words import number, sentence

NAME = "report.html"  # in the folder of a discovery
MAX_OPEN = 8  # flights that are all shown at once
COLORS = {"": appearance.LESS, **report.COLORS}  # by verdict; empty: before the first


def write(story: Story, folder: str, room: Optional[_core.RoomPlan] = None) -> str:
    """Writes the page into the folder of a discovery, in place of an earlier one; returns its path.

    room: whose walls are drawn. Files of the folder that are missing or damaged are left out.
    GroundError when the page cannot be written.
    """
    made = _StoryPage(story, folder, room)
    path = os.path.join(folder, NAME)
    made.sheet().write(path, COLORS.get(story.verdict, appearance.LESS), force=True)
    return path


class _StoryPage:
    """Puts the page together."""

    def __init__(self, story: Story, folder: str, room: Optional[_core.RoomPlan]) -> None:
        self._story = story
        self._folder = folder
        self._room = room
        self._models = {v.label: self._model(v.file) for v in story.versions}
        self._given = self._models[story.versions[0].label] if story.versions else None
        self._sheet = page.Page("Discovery of %s" % story.craft)

    def sheet(self) -> page.Page:
        """The page."""
        story, sheet = self._story, self._sheet
        sheet.add("<h1>Missing physics of %s</h1>" % page.text(story.craft or "the craft"))
        sheet.paragraph(" ".join(words.summary(story, self._given)), "verdict")
        if story.activity and not story.ended:
            sheet.paragraph("Now: %s." % story.activity.rstrip("."))
        self._fall()
        self._belief()
        self._flights()
        self._checks()
        self._go_on()
        self._found_models()
        files = [v.file for v in story.versions] + [f.recording for f in story.flights]
        inputs = [path for path in map(self._place, files) if path]
        room = ["room: %s" % story.room] * bool(story.room)
        report.add_origin(sheet, inputs, room)
        return sheet

    def _place(self, file: str) -> str:
        """Path of a file of the folder; empty if there is none."""
        path = os.path.join(self._folder, file)
        return path if file and os.path.exists(path) else ""

    def _model(self, file: str) -> Optional[_core.Model]:
        """The model in a file; None if it cannot be read."""
        path = self._place(file)
        try:
            return _core.load_model(path) if path else None
        except RuntimeError:
            return None

    def _inputs(self, plan: Flight) -> Optional[Array]:
        """Rows of time, inputs, lift of a flight; None where there are none."""
        path = self._place(plan.inputs)
        try:
            rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2) if path else np.empty((0, 0))
        except (OSError, ValueError):
            return None
        return rows if len(rows) and rows.shape[1] >= 3 else None

    def _fall(self) -> None:
        sheet, story = self._sheet, self._story
        sheet.heading("The error from flight to flight")
        figure = figures.errors(story)
        if figure is None:
            sheet.paragraph("No model has predicted a flight yet.")
            return
        sheet.figure(figure)
        labels = [v.label for v in figures.shown(story)]
        fitted = {v.label: v.after for v in story.versions}
        rows = []
        for flown in (flown for flown in story.flights if flown.errors):
            cells: List[object] = [flown.flight.number]
            for label in labels:
                known = error(flown.errors[label]) if label in flown.errors else ""
                cells.append(known + " *" * (known != "" and flown.flight.number <= fitted[label]))
            rows.append([*cells, number(flown.floor)])
        head = ["#%s%s" % (n, " (in the controller)" * (n == story.in_use)) for n in labels]
        sheet.table(["flight", *head, "#floor"], rows)
        if any(str(cell).endswith("*") for row in rows for cell in row):
            sheet.paragraph("*: a flight that the model was fitted to.", "caption")

    def _belief(self) -> None:
        sheet = self._sheet
        sheet.heading("The belief in each effect")
        figure = figures.beliefs(self._story)
        if figure is None:
            sheet.paragraph("No flight has been diagnosed yet.")
            return
        sheet.figure(figure)
        last = {b.effect: b for f in self._story.findings for b in f.beliefs}
        ranked = [last[name] for name in figures.ranked(self._story)]
        own = {name: words for f in self._story.findings for name, words in f.words.items()}
        rows = [
            [
                words.in_words(b.effect, own, self._given),
                b.state,
                "" if b.state == SLIGHT else "%.1f%%" % (100 * b.probability),
                "" if b.share is None or b.state not in (PRESENT, SLIGHT) else _percent(b.share),
                "%.3g" % b.visibility,
            ]
            for b in ranked
        ]
        counts = ["%d %s" % (sum(b.state == s for b in ranked), s) for s in figures.STATES]
        sheet.fold("The effects in words", ", ".join(counts), False)
        found = set(self._story.findings[-1].effects)
        chosen = [i for i, b in enumerate(ranked) if b.effect in found]
        heads = ["effect", "=state", "#acts and matters", "#share of the error", "#visibility"]
        sheet.table(heads, rows, chosen)
        sheet.paragraph(
            "Share of the error: change of the predicted motion by the effect, as it is estimated, relative "
            "to the error of the model without effects. Matters: it changes the motion by more than the "
            "noise of the poses. Visibility: expected 2 ln L of the effect, at the size that matters, in "
            "all flights so far.",
            "caption",
        )
        sheet.end_fold()

    def _flights(self) -> None:
        sheet, story = self._sheet, self._story
        sheet.heading("Flight by flight")
        if not story.flights and not story.planned:
            sheet.paragraph("Nothing has been flown yet.")
        findings = {finding.after: finding for finding in story.findings}
        if len(story.flights) > MAX_OPEN:
            sheet.paragraph("Open a flight to see it.", "caption")
        for flown in story.flights:
            self._flight(flown, findings.get(flown.flight.number))
        if story.planned and not story.ended:
            plan = story.planned
            beside = "%s; planned, %.0f s" % (plan.purpose, plan.duration)
            sheet.fold("Next: flight %d" % plan.number, beside, True)
            self._why(plan)
            self._draw(plan, None)
            sheet.end_fold()

    def _flight(self, flown: Flown, finding: Optional[Finding]) -> None:
        """Why a flight was flown, its path, what was found after it, what was still open."""
        sheet, plan = self._sheet, flown.flight
        beside = "%s; %.1f s" % (plan.purpose, flown.seconds)
        if flown.tracking_error is not None:
            beside += "; tracking error %s" % millimetres(flown.tracking_error)
        sheet.fold("Flight %d" % plan.number, beside, self._is_open(flown, finding))
        self._why(plan)
        self._draw(plan, flown)
        lines = ["Controlled by the model %s." % flown.controlled_by] * bool(flown.controlled_by)
        if flown.stopped:
            lines.append(sentence("stopped early: %s" % flown.stopped))
        label = figures.newest(self._story, flown)
        if label is not None:
            floor = "" if flown.floor is None else "; noise and disturbance leave %s" % number(flown.floor)
            error_of = "the newest model (%s) predicted it with an error of %s%s"
            lines.append(sentence(error_of % (label, error(flown.errors[label]), floor)))
        if not flown.recording:
            lines.append("It was not recorded.")
        sheet.points(lines)
        if finding is not None:
            self._finding(finding)
        sheet.end_fold()

    def _is_open(self, flown: Flown, finding: Optional[Finding]) -> bool:
        """Whether a flight is shown at once: of many those that changed what is known, or tested it."""
        story = self._story
        if len(story.flights) <= MAX_OPEN or flown.flight.purpose in (CONFIRM, TRACK):
            return True
        before = [other.effects for other in story.findings if other.after < flown.flight.number]
        return finding is not None and finding.effects != (before[-1] if before else [])

    def _why(self, plan: Flight) -> None:
        why = sentence(plan.why or "it %s" % PURPOSES.get(plan.purpose, plan.purpose))
        if plan.reference:
            why += " Reference: %s of %.2g m." % (plan.reference, plan.size)
        self._sheet.paragraph(why)

    def _draw(self, plan: Flight, flown: Optional[Flown]) -> None:
        inputs = self._inputs(plan)
        count = 0 if inputs is None else inputs.shape[1] - 2
        names = [str(t["name"]).replace("_", " ") for t in self._given.thrusters] if self._given else []
        if len(names) != count:
            names = ["thruster %d" % (i + 1) for i in range(count)]
        figure = figures.flight(plan, flown, inputs, names, self._room)
        if figure is not None:
            self._sheet.figure(figure)

    def _finding(self, finding: Finding) -> None:
        sheet = self._sheet
        verdict = words.verdict_of(finding, self._given)
        sheet.add("<p><strong>%s</strong></p>" % page.text(sentence("found after it: " + verdict)))
        if finding.sentences:
            sheet.points(map(sentence, finding.sentences))
        if finding.open:
            sheet.paragraph("Still open:")
            sheet.points(map(sentence, finding.open))
        else:
            sheet.paragraph("No question was left open.")

    def _checks(self) -> None:
        """Confirmation and tracking."""
        sheet, story = self._sheet, self._story
        if story.confirmation:
            found = story.confirmation
            sheet.heading("Confirmation")
            sheet.paragraph(sentence(found.sentence))
            errors = (found.given, found.refitted, found.final, found.most)
            row = [found.flight, *map(error, errors), "yes" if found.holds else "no"]
            head = ["#flight", "#error, given model", "#given, refitted", "#final model"]
            sheet.table([*head, "#at most", "=holds"], [row])
        if story.tracking:
            check = story.tracking
            sheet.heading("Tracking")
            sheet.paragraph(sentence(check.sentence))
            tracked = [check.reference, millimetres(check.before), millimetres(check.after)]
            head = ["reference", "#error, given model", "#error, final model"]
            head += ["=decided", "=model taken back"]
            said = ["yes" if answer else "no" for answer in (check.decided, check.taken_back)]
            sheet.table(head, [[*tracked, *said]])

    def _go_on(self) -> None:
        sheet, story = self._sheet, self._story
        sheet.heading("How to go on")
        if story.needed:
            sheet.paragraph(sentence("needed: " + story.needed))
        elif story.ended and story.sure:
            sheet.paragraph("Nothing is needed: no question is open that a flight in this room could answer.")
        if not story.ended:
            sheet.paragraph(
                "The discovery has not ended. Should it be interrupted, the same command with the same "
                "folder continues after the last flight."
            )
        final = next((self._place(v.file) for v in story.versions if v.label == story.in_use), "")
        if final:
            line = "roslaunch ground sim_tracking.launch model:=%s" % os.path.abspath(final)
            sheet.add(
                "<p>The model in the controller drives a simulated craft by <code>%s</code></p>"
                % page.text(line)
            )

    def _found_models(self) -> None:
        sheet, story = self._sheet, self._story
        if not story.versions:
            return
        sheet.heading("The models")
        rows = [
            [
                v.label + " (in the controller)" * (v.label == story.in_use),
                ", ".join(v.effects) or "-",
                "flights 1 to %d" % v.after if v.after > 1 else "flight 1" if v.after else "-",
                v.file,
            ]
            for v in story.versions
        ]
        chosen = [i for i, v in enumerate(story.versions) if v.label == story.in_use]
        sheet.table(["=model", "effects", "=fitted to", "file"], rows, chosen)
        self._parameters()

    def _parameters(self) -> None:
        """Parameters of the given and of the final model."""
        final = self._story.versions[-1].label
        before, after = self._given, self._models[final]
        if before is None or after is None or after is before:
            return
        old = _values(before)
        rows = [
            [p["name"], _parameter(old.get(p["name"])), _parameter(after.value(p["name"])), p["unit"]]
            for p in after.parameters()
        ]
        new = [i for i, row in enumerate(rows) if row[0] not in old]
        self._sheet.table(["parameter", "#given", "#" + final, "unit"], rows, new)
        self._sheet.paragraph("Bold: parameters of effects that were added.", "caption")


def _percent(share: float) -> str:
    return "%.1f%%" % (100 * share) if share < 0.1 else "%.0f%%" % (100 * share)


def _values(model: _core.Model) -> Dict[str, float]:
    return {p["name"]: model.value(p["name"]) for p in model.parameters()}


def _parameter(value: Optional[float]) -> str:
    """A parameter; empty for None."""
    return "" if value is None else "%.4g" % value
