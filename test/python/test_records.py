"""Results as plain values and back: what JSON cannot hold, and files of other versions."""

import json
import math
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Tuple

import pytest

from ground.support import records
from ground.support.errors import GroundError
from ground.support.files import plain


@dataclass(frozen=True)
class Part:
    value: float = field(metadata={records.NULL: math.inf})
    ends: Tuple[float, float] = field(metadata={records.NULL: (-math.inf, math.inf)})
    note: str = field(metadata={records.ABSENT: ""})
    several: Optional[Tuple[float, float]] = field(metadata={records.ABSENT: None})


@dataclass(frozen=True)
class Whole:
    parts: Dict[str, Part]
    names: List[str]
    count: int
    chosen: Optional[Part]
    kind: str = "usual"


FULL = Whole({"a": Part(math.inf, (1.0, math.inf), "", None)}, ["x"], 2, Part(1.0, (0.0, 2.0), "odd", (1, 2)))


def read(values):
    return records.read(Whole, values, "whole.json")


def test_it_comes_back_from_json():
    text = json.dumps(plain(records.plain(FULL)), allow_nan=False)
    assert read(json.loads(text)) == FULL
    assert json.loads(text)["parts"] == {"a": {"value": None, "ends": [1.0, None]}}


def test_files_of_other_versions_are_read():
    values = records.plain(FULL)
    del values["chosen"], values["kind"]  # an older one has fewer keys, a newer one more
    found = read({**values, "more": 1})
    assert found.chosen is None and found.kind == "usual"


@pytest.mark.parametrize(
    "change, place",
    [
        ({"count": "2"}, "whole.json.count"),
        ({"names": ["x", 3]}, "whole.json.names[1]"),
        ({"parts": []}, "parts"),
    ],
)
def test_what_is_wrong_is_named(change, place):
    with pytest.raises(GroundError) as refused:
        read({**records.plain(FULL), **change})
    assert place in str(refused.value)
    with pytest.raises(GroundError, match="whole.json.count: missing"):
        read({key: value for key, value in records.plain(FULL).items() if key != "count"})
