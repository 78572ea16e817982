"""Stories of discoveries for tests."""

import math

from conftest import MODEL
from ground.discovery import story as tale
from ground.discovery.story import Belief, Confirmation, Finding, Flight, Flown, Story, TrackingCheck, Version

EFFECTS = ["motor_lag", "input_delay", "wind", "floor_tilt", "quadratic_drag", "yaw_bias", "coulomb_friction"]
INPUTS = "time,left,right,lift\n0,0,0,1\n1,0.8,0.2,1\n2,0.1,1,1\n3,0.5,0.5,1\n4,0,0,0\n"


def begun():
    """A discovery before its first flight."""
    return Story(
        craft="Tiny Whoover",
        room="4 x 4 m",
        budget=180.0,
        horizon=1.0,
        versions=[Version(tale.GIVEN, "model-00.yaml", [], 0)],
        activity="chooses the first flight",
    )


def path(number, reach=1.2, samples=200):
    """A way through the room."""
    return [
        (0.1 * i, reach * math.sin(0.05 * i * number), reach * math.cos(0.03 * i) - reach)
        for i in range(samples)
    ]


def flight(number, purpose=tale.DECIDE, **changes):
    """A planned flight."""
    values = {
        "why": "tells motor_lag from input_delay",
        "duration": 12.0,
        "path": path(number),
        "inputs": "flight-%02d.csv" % number,
    }
    return Flight(number, purpose, **{**values, **changes})


def finding(after, probabilities, states, **changes):
    """A finding; probabilities, states: of EFFECTS."""
    effects = [name for name, state in zip(EFFECTS, states) if state == tale.PRESENT]
    values = {
        "verdict": "missing" if effects else "complete",
        "effects": effects,
        "groups": {name: [name] for name in effects},
        "beliefs": [
            Belief(*row, 4.0 * after, 0.012 if row[2] == tale.SLIGHT else 0.4)
            for row in zip(EFFECTS, probabilities, states)
        ],
        "label": "after flight %d" % after,
        "sentences": ["the error falls from 1.92 to 0.31"],
        "open": ["whether wind or floor_tilt acts"],
    }
    return Finding(after, **{**values, **changes})


def whole():
    """A discovery of a motor lag and of a wind: four flights, a confirmation and a check of tracking."""
    made = begun()
    is_open, absent, present = tale.OPEN, tale.ABSENT, tale.PRESENT
    made.versions += [
        Version("after flight 1", "model-01.yaml", ["motor_lag"], 1),
        Version("after flight 2", "model-02.yaml", ["motor_lag", "wind"], 2),
    ]
    labels = [version.label for version in made.versions]
    for number, purpose, errors in (
        (1, tale.LOOK, [1.92]),
        (2, tale.DECIDE, [2.10, 0.61]),
        (3, tale.CONFIRM, [1.75, 0.58, 0.221]),
    ):
        made.flights.append(
            Flown(
                flight(number, purpose),
                "flight-%02d.bag" % number,
                11.8,
                labels[len(errors) - 1],
                path=[(t, x + 0.03, 0.97 * y) for t, x, y in path(number)],
                errors={label: (100 * e, 20 * e) for label, e in zip(labels, errors)},
                floor=(21.0, 4.0),
            )
        )
    track = flight(4, tale.TRACK, inputs="", reference="rhodonea", size=1.2, why="")
    made.flights.append(Flown(track, "", 20.0, labels[-1], path=path(4), errors={}, tracking_error=0.012))
    made.findings = [
        finding(
            1,
            [0.93, 0.41, 0.38, 0.36, 0.02, 0.01, 0.0],
            [present, is_open, is_open, is_open, absent, absent, tale.HIDDEN],
            groups={"motor_lag": ["motor_lag", "input_delay"]},
        ),
        finding(
            2,
            [0.999, 0.01, 0.98, 0.02, 0.005, 0.001, 0.0],
            [present, tale.SLIGHT, present, absent, absent, absent, tale.HIDDEN],
            open=[],
        ),
    ]
    made.in_use = "after flight 2"
    made.activity = ""
    sentence = "Flight 3, which neither fit nor choice has seen, confirms it: 1.750 falls to 0.221"
    made.confirmation = Confirmation(3, 1.75, 0.221, 0.21, True, sentence, 1.31, 0.24)
    check = "the error on a rhodonea falls from 31.0 to 12.0 mm"
    made.tracking = TrackingCheck("rhodonea", 0.031, 0.012, False, check, labels[-1], True)
    made.ended = made.sure = True
    made.reason = "nothing is open that a flight could show"
    return made


def write_files(story, folder):
    """Writes the files of a story that its page reads: models and inputs."""
    import ground

    for version in story.versions:
        model = ground.Model.load(MODEL)
        for effect in version.effects:
            model = model.with_effect(effect)
        model.save(str(folder / version.file), force=True)
    for flown in story.flights:
        if flown.flight.inputs:
            (folder / flown.flight.inputs).write_text(INPUTS)
