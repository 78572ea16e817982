"""The scene of a view: room, craft, thrust, missing force, paths and floor, drawn at a limited rate."""

import collections
import math
from typing import Any, Deque, Dict, List, Mapping, Optional, Sequence, Tuple

from foxglove import channels as fc
from foxglove import messages as fx

from ground import _core
from ground.exporting import shapes
from ground.exporting.channels import MODELS, clean
from ground.exporting.shapes import CRAFT, WORLD, WORLD_NED, Point
from ground.models import Model, Room

SECOND = 1_000_000_000  # [ns]
CRAFT_PERIOD = SECOND // 15  # between pictures of the craft
PATH_PERIOD = SECOND // 4
STILL_PERIOD = SECOND  # of what does not move; a viewer that comes later gets it, too
SPACING = SECOND // 25  # between points of a path
HISTORY = 10 * SECOND  # length of the paths
RECENT = SECOND  # largest age of what is drawn at the craft
GAP = SECOND // 2  # a path is interrupted where it has no point for so long
CELL, FEWEST = 0.25, 5  # side of a cell of the floor [m], least number of errors in it
LARGE = 5  # error of the brightest floor, relative to noise
SURE = 3.5  # least missing force that is drawn, relative to its standard deviation
THRUST_LENGTH, MISSING_LENGTH = 0.3, 4.0  # arrow of a full thruster, and of a missing full thrust [m]
MAX_ARROW, MIN_ARROW = 0.8, 0.02  # arrow of a missing force [m]
HULL, BOW, WALL, HOME, TEXT = "#c8c8c8", "#404040", "#404040", "#606060", "#808080"
DARKER = 0.7  # texts, than the colour that they explain
OPACITY = 0.35  # of what is predicted, and of the floor


class Scene:
    """Takes what is known and draws it. Times are [ns], all else is in SI and in the frames of ground."""

    def __init__(self, context: Any) -> None:
        """context: of foxglove, that the channels belong to."""
        self._room: Optional[Room] = None
        self._craft: Optional[Body] = None
        names = ("room", "craft", "paths", "floor", "legend")
        self._channels = {n: fc.SceneUpdateChannel("/scene/" + n, context=context) for n in names}
        self._frames = fc.FrameTransformsChannel("/tf", context=context)
        self._drawn: Dict[str, int] = {}
        self.clear()

    def furnish(self, model: Optional[Model], room: Optional[Room]) -> None:
        """Takes the model whose thrusters are drawn, and the room."""
        self._room, self._craft = room, Body(model) if model else None

    def clear(self) -> None:
        """Forgets what was drawn: time began again."""
        self._drawn.clear()
        self._paths: Dict[str, Deque[Tuple[int, Point, bool]]] = collections.defaultdict(collections.deque)
        self._poses: Dict[str, Tuple[int, Sequence[float]]] = {}
        self._commands: Mapping[str, float] = {}
        self._missing: Optional[Tuple[int, Sequence[float], Sequence[float]]] = None
        self._floor: Dict[Tuple[int, int], List[float]] = {}
        self._noise = 0.0
        self._lines: Dict[str, str] = {}

    def state(self, time: int, eta: Sequence[float]) -> None:
        """The craft is at a pose x, y [m], psi [rad]; draws what is due."""
        self._follow(CRAFT, time, eta)
        if CRAFT not in self._poses:
            return
        if self._is_due("craft", time, CRAFT_PERIOD):
            self._draw_frames(time)
            self._draw_craft(time)
        if self._is_due("paths", time, PATH_PERIOD):
            self._draw_paths(time)
        if self._is_due("room", time, STILL_PERIOD):
            self._draw_room(time)
            self._draw_floor(time)
            self._draw_legend(time)

    def predicted(self, model: str, time: int, eta: Sequence[float], begins: bool) -> None:
        """Pose that a model predicts; model: one of MODELS; begins: whether it started anew."""
        self._follow(model, time, eta, begins)

    def reference(self, time: int, place: Point) -> None:
        """Where the craft should be [m]."""
        self._follow("reference", time, (*place, 0.0))

    def commands(self, commands: Mapping[str, float]) -> None:
        """Commands by channel."""
        self._commands = commands

    def missing(self, time: int, wrench: Sequence[float], sigma: Sequence[float]) -> None:
        """Missing wrench of the first model [N, N, N m], and its standard deviations."""
        if math.isfinite(sum(wrench) + sum(sigma)) and min(sigma) > 0:
            self._missing = time, wrench, sigma

    def off(self, place: Point, distance: float, noise: float) -> None:
        """How far a prediction of the first model was off at a place [m], and what noise leaves [m]."""
        if math.isfinite(place[0] + place[1] + distance):
            cell = self._floor.setdefault((int(place[0] // CELL), int(place[1] // CELL)), [0.0, 0])
            cell[0] += distance
            cell[1] += 1
            self._noise = noise

    def legend(self, line: str, words: str) -> None:
        """A line of the legend: one of MODELS, and its text."""
        self._lines[line] = clean(words)

    def _follow(self, name: str, time: int, eta: Sequence[float], begins: bool = False) -> None:
        if not math.isfinite(sum(eta)):
            return
        self._poses[name] = time, eta
        path = self._paths[name]
        if begins or not path or time - path[-1][0] >= SPACING:
            path.append((time, (eta[0], eta[1]), begins))
            while time - path[0][0] > HISTORY:
                path.popleft()

    def _is_due(self, what: str, time: int, period: int) -> bool:
        if time - self._drawn.get(what, -period) < period:
            return False
        self._drawn[what] = time
        return True

    def _draw(self, name: str, entities: List[Any], time: int) -> None:
        self._channels[name].log(fx.SceneUpdate(entities=entities), log_time=time)

    def _draw_frames(self, time: int) -> None:
        frames = [shapes.frame(WORLD, WORLD_NED, time, 0.0, 0.0, shapes.OVER)]
        for name in (CRAFT, *MODELS):
            at, eta = self._poses.get(name, (0, ()))
            if eta and abs(time - at) <= RECENT:
                frames.append(shapes.frame(WORLD_NED, name, time, eta[0], eta[1], shapes.turned(eta[2])))
        self._frames.log(fx.FrameTransforms(transforms=frames), log_time=time)

    def _draw_craft(self, time: int) -> None:
        body = self._craft or Body(None)
        solid = body.hull(shapes.color(HULL), shapes.color(BOW))
        craft = [shapes.entity("craft", CRAFT, time, cylinders=solid)]
        arrows = body.thrust(self._commands) + self._missing_arrows(time, body)
        craft.append(shapes.entity("forces", CRAFT, time, arrows=arrows))
        for i, name in enumerate(MODELS):
            if name in self._poses and abs(time - self._poses[name][0]) <= RECENT:
                shade = shapes.color(_core.palette["models"][i], OPACITY)
                craft.append(shapes.entity(name, name, time, cylinders=body.hull(shade, shade)))
        self._draw("craft", craft, time)

    def _missing_arrows(self, time: int, body: "Body") -> List[Any]:
        """Arrows of the missing force at the craft and of the missing moment at the bow, where they are more
        than noise."""
        if self._missing is None or abs(time - self._missing[0]) > RECENT:
            return []
        _, (X, Y, N), sigma = self._missing
        found = []
        if math.hypot(X / sigma[0], Y / sigma[1]) > SURE:
            found.append(((0.0, 0.0), (X, Y)))
        if abs(N) > SURE * sigma[2]:
            found.append(((2.5 * body.l, 0.0), (0.0, N / body.l)))
        shade, arrows = shapes.color(_core.palette["missing"]), []
        for start, force in found:
            length = math.hypot(*force) * MISSING_LENGTH / body.full_thrust
            if length >= MIN_ARROW:
                by = min(length, MAX_ARROW) / math.hypot(*force)
                along = by * force[0], by * force[1]
                arrows.append(shapes.arrow(start, along, 3 * body.l, 0.03, shade))
        return arrows

    def _draw_paths(self, time: int) -> None:
        palette, entities = _core.palette, []
        shades = {CRAFT: TEXT, "reference": palette["reference"], **dict(zip(MODELS, palette["models"]))}
        for above, (name, shade) in enumerate(shades.items(), 1):
            pieces: List[List[Point]] = [[]]
            last = None
            for at, place, begins in self._paths.get(name, ()):
                if begins or last is not None and at - last > GAP:
                    pieces.append([])
                pieces[-1].append(place)
                last = at
            width, tint = 0.02 if name == CRAFT else 0.012, shapes.color(shade)
            lines = [shapes.line(p, 0.005 * above, width, tint) for p in pieces if len(p) > 1]
            entities.append(shapes.entity("path of " + name, WORLD_NED, time, lines=lines))
        self._draw("paths", entities, time)

    def _draw_room(self, time: int) -> None:
        if self._room is None:
            return
        x, y = self._room.home
        walls: List[Point] = [(a, b) for a, b in self._room.corners.tolist()]
        lines: List[Any] = [shapes.line(walls, 0.0, 0.03, shapes.color(WALL), closed=True)]
        for ends in (((x - 0.1, y), (x + 0.1, y)), ((x, y - 0.1), (x, y + 0.1))):
            lines.append(shapes.line(ends, 0.0, 0.015, shapes.color(HOME)))
        self._draw("room", [shapes.entity("room", WORLD_NED, time, lines=lines)], time)

    def _draw_floor(self, time: int) -> None:
        means = {at: total / count for at, (total, count) in self._floor.items() if count >= FEWEST}
        if not means:
            return
        span = max(self._floor_top(list(means.values())) - self._noise, 1e-12)
        tiles = []
        for (i, j), mean in means.items():
            shade = shapes.scale_color((mean - self._noise) / span, OPACITY)
            tiles.append(shapes.tile(((i + 0.5) * CELL, (j + 0.5) * CELL), 0.96 * CELL, shade))
        self._draw("floor", [shapes.entity("floor", WORLD_NED, time, cubes=tiles)], time)

    def _floor_top(self, means: List[float]) -> float:
        """Error of the brightest colour of the floor [m]: 95% of the cells have less."""
        return max(sorted(means)[int(0.95 * (len(means) - 1))], LARGE * self._noise)

    def _draw_legend(self, time: int) -> None:
        """Lines of text beside the room, in the colours of what they explain."""
        palette = _core.palette
        rows = [("measured path", TEXT)]
        if "reference" in self._paths:
            rows.append(("reference", palette["reference"]))
        rows += [(self._lines[m], palette["models"][i]) for i, m in enumerate(MODELS) if m in self._lines]
        if self._craft:
            told = "thrust: %g m is %s" % (THRUST_LENGTH, newtons(self._craft.strongest))
            rows.append((told, palette["thrusters"][0]))
            of = newtons(self._craft.full_thrust / MISSING_LENGTH)
            rows.append(("missing force, beyond noise: 1 m is " + of, palette["missing"]))
        corners = self._room.corners.tolist() if self._room else [[1.5, 0.0]]
        top = max(corner[0] for corner in corners) + 0.25 + 1.6 * shapes.LETTER * len(rows)
        middle = sum(corner[1] for corner in corners) / len(corners)
        texts = [
            shapes.text((top - 1.6 * shapes.LETTER * i, middle), words, shapes.color(shade, darker=DARKER))
            for i, (words, shade) in enumerate(rows)
        ]
        self._draw("legend", [shapes.entity("legend", WORLD_NED, time, texts=texts)], time)


def newtons(force: float) -> str:
    """A force, as in "62 mN", "0.56 N"."""
    return "%.2g mN" % (1e3 * force) if abs(force) < 0.0995 else "%.2g N" % force


class Body:
    """What of a model is drawn: hull and thrusters."""

    def __init__(self, model: Optional[Model]) -> None:
        """model: None for a craft of usual size without thrusters."""
        self.l = model["l"] if model else 0.04
        self._full = model["k"] * model.core.input_max if model else 1.0  # of a thruster of gain 1 [N]
        every = list(model.core.thrusters) if model else []
        self._thrusters = [one for one in every if not one["is_angle"]]
        places = [math.hypot(*one["position"]) for one in self._thrusters]
        self._half = max([1.8 * self.l, *places])  # of its width [m]
        self.full_thrust = 2 * self._full
        self.strongest = self._full * max([one["gain"] for one in self._thrusters], default=1.0)

    def hull(self, shade: Any, bow: Any) -> List[Any]:
        """Cylinders of the hull, the bow and the thrusters."""
        size = self._half / 1.8
        found = [shapes.cylinder((0.0, 0.0), 0.4 * size, (5 * size, 2 * self._half, 0.8 * size), shade)]
        found.append(shapes.cylinder((2 * size, 0.0), 0.9 * size, (size, size, 0.3 * size), bow))
        for one in self._thrusters:
            found.append(shapes.cylinder(one["position"], size, (1.4 * size, 1.4 * size, 0.5 * size), bow))
        return found

    def thrust(self, commands: Mapping[str, float]) -> List[Any]:
        """An arrow along the force of each thruster."""
        found, tints = [], _core.palette["thrusters"]
        for i, one in enumerate(self._thrusters):
            low, high = one["range"]
            force = one["gain"] * self._full * min(max(commands.get(one["channel"], 0.0), low), high)
            length = THRUST_LENGTH * force / self.strongest
            if abs(length) >= 1e-3:
                angle = math.radians(one["direction"])
                along = length * math.cos(angle), length * math.sin(angle)
                shade = shapes.color(tints[i % len(tints)])
                found.append(shapes.arrow(one["position"], along, 1.5 * self.l, 0.02, shade))
        return found
