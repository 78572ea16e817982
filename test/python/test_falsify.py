"""A short search for a flight that leaves the room; `make falsify` is the whole of it."""

import numpy as np
import pytest

import falsify
from conftest import MODEL, ROOT
from ground import _core

ROOM = ROOT / "cfg" / "room" / "room_4x4.yaml"


@pytest.fixture(scope="module")
def place():
    return falsify.Place(str(MODEL), str(ROOM))


def test_no_flight_within_the_bound_leaves_the_room(place):
    found = falsify.search(place, 240, seed=3, generations=5)
    assert sum(one.flights for one in found.values()) >= 240
    for name, one in found.items():
        assert one.left == [], name
        assert one.inside_bound > 0, name
    assert min(one.worst[0] for one in found.values()) < 0.3, "the search comes near a wall"


def test_without_a_fence_flights_leave(place):
    """The flights are hard enough: the controllers follow a line through a wall."""
    x = np.full(len(falsify.NAMES), 0.5)
    inside, _, stopped = falsify.flight(place, "nothing", x)
    assert inside > 0 and "wall of the room" in stopped
    wide = falsify.Place(str(MODEL), str(ROOM))
    wide.fence = _core.load_room(str(ROOM))
    wide.fence.corners = [10 * np.array(corner) for corner in wide.fence.corners]
    outside, _, _ = falsify.flight(wide, "nothing", x)
    assert outside < 0


def test_the_same_seed_gives_the_same_flights(place):
    x = np.random.default_rng(2).uniform(size=len(falsify.NAMES))
    assert falsify.flight(place, "much", x) == falsify.flight(place, "much", x)


def test_the_bound_is_that_of_the_room_and_the_craft(place):
    text = _core.fence_bound(place.room, place.model)
    assert "%.2f m/s" % place.speeds["much"] in text
    heavy = place.model.copy()
    heavy.set_value("m", 2 * heavy.value("m"))
    safe = _core.largest_safe_speed(place.room, heavy, *falsify.UPSETS["much"])
    assert safe > place.speeds["much"], "pushes and errors in shares of the thrust move it less"
    place.room.margin = 0.05
    try:
        assert (
            _core.largest_safe_speed(place.room, place.model, *falsify.UPSETS["much"]) < place.speeds["much"]
        )
    finally:
        place.room.margin = 0.2
