# Types of the compiled core; src/ground/src/python documents it.
from typing import ClassVar, Dict, List, Optional, Sequence, Tuple

from ground.annotations import Array, ArrayLike
from ground.core_types import (
    BestMotions,
    EffectInfo,
    EffectUse,
    ExperimentLog,
    Fit,
    FittedParameter,
    Forecast,
    GreyBoxFit,
    InferredWrench,
    Innovations,
    ModelParameter,
    Motion,
    Palette,
    Residuals,
    Scores,
    Setting,
    Smoothed,
    Thruster,
    WindowMotions,
)

version: str
ceres_version: str
eigen_version: str
palette: Palette

# model

class Provenance:
    date: str
    command: str
    bags: List[str]
    digests: List[str]
    error_before: Dict[str, float]
    error_after: Dict[str, float]
    confidence_95: Dict[str, Tuple[float, float]]
    not_identified: List[str]

class Disturbance:
    sigma: Array
    time: Array
    white: Array
    trim: Array
    trim_thrust: float
    def empty(self) -> bool: ...
    def validate(self) -> str: ...

class Model:
    name: str
    disturbance: Disturbance
    provenance: Provenance
    @property
    def input_max(self) -> float: ...
    @property
    def effects(self) -> List[str]: ...
    @property
    def summaries(self) -> Dict[str, str]: ...
    @property
    def thrusters(self) -> List[Thruster]: ...
    @property
    def channels(self) -> List[str]: ...
    @property
    def is_pair(self) -> bool: ...
    def forces(self, inputs: ArrayLike) -> Array: ...
    def copy(self) -> Model: ...
    def parameters(self) -> List[ModelParameter]: ...
    def value(self, parameter: str) -> float: ...
    def set_value(self, parameter: str, value: float) -> None: ...
    def penalty(self, parameters: Sequence[str]) -> Array: ...
    def add_effect(self, name: str) -> None: ...
    def remove_effect(self, name: str) -> None: ...
    def format(self) -> str: ...

def load_model(path: str) -> Model: ...
def load_model_with_warnings(path: str) -> Tuple[Model, List[str]]: ...
def mistaken_units() -> List[Tuple[str, str, float]]: ...
def parse_model(text: str, source: str) -> Model: ...
def with_effect(model: Model, text: str, source: str) -> Model: ...
def read_effect_file(path: str) -> str: ...
def save_model(model: Model, path: str, overwrite: bool = False) -> None: ...
def effects(model: Optional[Model] = None) -> Dict[str, EffectInfo]: ...
def bells(
    arguments: Sequence[str],
    widths: ArrayLike,
    centres: ArrayLike,
    rows: ArrayLike,
    model: Optional[Model] = None,
) -> Array: ...
def simulate(
    model: Model,
    inputs: ArrayLike,
    times: ArrayLike,
    eta: ArrayLike,
    nu: ArrayLike,
    drives: ArrayLike = ...,
    wrench: Optional[ArrayLike] = ...,
    room: Optional[ArrayLike] = ...,
) -> Motion: ...
def drive_starts(times: ArrayLike, lift: ArrayLike, records: Optional[ArrayLike] = ...) -> List[float]: ...

# estimation

class AxisMapping:
    def __init__(self, axes: str = ..., heading_offset: float = 0.0) -> None: ...
    def to_mocap(self, eta: ArrayLike, height: float) -> Tuple[Array, Array]: ...
    def to_planar(self, position: ArrayLike, xyzw: ArrayLike) -> Optional[Array]: ...
    def to_planar_rows(self, positions: ArrayLike, xyzw: ArrayLike) -> Array: ...

class EstimatorParams:
    position_noise: float
    heading_noise: float
    linear_jerk: float
    angular_jerk: float
    gate: float
    max_gap: float

def smooth(stamps: ArrayLike, eta: ArrayLike, params: EstimatorParams) -> Smoothed: ...

# control

class TunableInfo:
    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def text(self) -> str: ...
    @property
    def type(self) -> str: ...
    @property
    def low(self) -> float: ...
    @property
    def high(self) -> float: ...
    @property
    def default(self) -> Setting: ...
    @property
    def search(self) -> Optional[Tuple[float, float, float]]: ...

class ReferenceInfo:
    @property
    def name(self) -> str: ...
    @property
    def text(self) -> str: ...
    @property
    def takes(self) -> List[str]: ...
    @property
    def ends(self) -> bool: ...

class ReferenceParams:
    kind: str
    x: float
    y: float
    size: float
    speed: float
    petals: float
    rate_of_turn: float
    end_x: float
    end_y: float
    smooth: bool
    file: str
    def extent(self) -> float: ...
    def default_max_error(self) -> float: ...
    def infeasibility(self, model: Model) -> str: ...
    def sample(self, times: ArrayLike) -> Array: ...

class ControllerInfo:
    @property
    def name(self) -> str: ...
    @property
    def text(self) -> str: ...
    @property
    def follows(self) -> bool: ...
    @property
    def parameters(self) -> List[TunableInfo]: ...

class ControllerChoice:
    kind: str
    values: Dict[str, Setting]

class RoomPlan:
    name: str
    corners: List[Array]
    margin: float
    home: Array
    braking: float
    latency: float
    def validate(self) -> str: ...
    def clearance(self, point: ArrayLike) -> float: ...

class DesignParams:
    kind: str
    clock: float
    levels: List[float]
    order: int
    seed: int
    hold: float
    file: str
    rows_per_bit: int
    def take_thrusters(self, model: Model) -> None: ...

class DesignInfo:
    @property
    def name(self) -> str: ...
    @property
    def text(self) -> str: ...
    @property
    def takes(self) -> List[str]: ...

class InputSignal:
    @property
    def end(self) -> float: ...
    @property
    def has_lift(self) -> bool: ...
    @property
    def description(self) -> str: ...
    @property
    def rows(self) -> Array: ...

class ReturnParams:
    burst: float
    arrival: float

def reference_table() -> List[ReferenceInfo]: ...
def reference_parameters() -> List[TunableInfo]: ...
def controller_table() -> List[ControllerInfo]: ...
def load_room(path: str) -> RoomPlan: ...
def parse_room(yaml: str, source: str) -> RoomPlan: ...
def leaves_room(reference: ReferenceParams, room: RoomPlan) -> str: ...
def design_table() -> List[DesignInfo]: ...
def make_design(params: DesignParams, duration: float) -> InputSignal: ...
def effect_use(kind: str, model: Model) -> EffectUse: ...
def make_prbs(order: int, seed: int) -> List[Tuple[bool, bool]]: ...

# simulation

class MocapParams:
    rate: float
    position_noise: float
    heading_noise: float
    latency: float
    loss: float
    gap_rate: float
    gap_length: float
    gaps_vary: bool

class LifecycleParams:
    lift: float
    lift_time: float
    state_timeout: float
    recovery_time: float
    rate: float

class DriveParams:
    estimate: bool
    life: LifecycleParams
    start: float
    duration: float
    tail: float
    room: Optional[RoomPlan]

class TrackingParams(DriveParams):
    reference: ReferenceParams
    controller: ControllerChoice
    max_error: float

class ExcitationParams(DriveParams):
    design: DesignParams
    returns: ReturnParams

class Plant:
    def __init__(self) -> None: ...
    def command(self, thrusters: Array, lift: float) -> None: ...
    def advance(self, time: float) -> None: ...
    def state(self) -> Tuple[Array, Array]: ...
    def derivative(self) -> Tuple[Array, Array]: ...
    def measurement(self) -> Tuple[Array, Array]: ...
    def wrench(self) -> Array: ...
    def pose_noise(self) -> Array: ...

def play_schedule(
    model: Model,
    schedule: ArrayLike,
    duration: float,
    eta: ArrayLike,
    nu: ArrayLike,
    mocap: MocapParams,
    seed: int,
    disturbance: Disturbance = ...,
    plant: Optional[Plant] = ...,
) -> ExperimentLog: ...
def track_reference(
    model: Model,
    believed: Model,
    tracking: TrackingParams,
    eta: ArrayLike,
    nu: ArrayLike,
    mocap: MocapParams,
    seed: int,
    disturbance: Disturbance = ...,
    plant: Optional[Plant] = ...,
) -> ExperimentLog: ...
def excite(
    model: Model,
    believed: Model,
    excitation: ExcitationParams,
    eta: ArrayLike,
    nu: ArrayLike,
    mocap: MocapParams,
    seed: int,
    disturbance: Disturbance = ...,
    plant: Optional[Plant] = ...,
) -> ExperimentLog: ...

# identification

class RunData:
    def __init__(
        self,
        name: str,
        times: ArrayLike,
        eta: ArrayLike,
        nu: ArrayLike,
        inputs: ArrayLike,
        poses: Optional[ArrayLike] = ...,
        noise: Optional[ArrayLike] = ...,
        drives: ArrayLike = ...,
        wrench: Optional[ArrayLike] = ...,
    ) -> None: ...
    @property
    def name(self) -> str: ...
    @property
    def times(self) -> Array: ...
    @property
    def eta(self) -> Array: ...
    @property
    def nu(self) -> Array: ...
    @property
    def poses(self) -> Array: ...
    @property
    def noise(self) -> Array: ...
    @property
    def wrench(self) -> Array: ...
    @property
    def inputs(self) -> Array: ...
    @property
    def drives(self) -> List[float]: ...
    @property
    def t(self) -> Array: ...

class Window:
    run: int
    first: int
    last: int
    def __init__(self, run: int, first: int, last: int) -> None: ...

def cut_windows(
    run: RunData, run_index: int, start: float, end: float, length: float, max_gap: float = 0.1
) -> List[Window]: ...

class Objective:
    least_squares: ClassVar[Objective]
    thesis: ClassVar[Objective]

class Target:
    velocities: ClassVar[Target]
    poses: ClassVar[Target]

class SimulationError:
    def __init__(
        self, runs: Sequence[RunData], windows: Sequence[Window], target: Target = ...
    ) -> None: ...
    def sigma(self, run: int) -> Array: ...
    def simulate(self, model: Model, objective: Objective = ...) -> BestMotions: ...
    def fit(
        self,
        model: Model,
        free: Sequence[str],
        objective: Objective = ...,
        starts: int = 1,
        threads: int = 0,
        width: float = 0.0,
        near: bool = False,
        initial: Sequence[Array] = ...,
    ) -> Fit: ...

def predict(
    model: Model, run: RunData, windows: Sequence[Window], nu: ArrayLike
) -> WindowMotions: ...

class WrenchNature:
    random_walk: ClassVar[WrenchNature]
    white: ClassVar[WrenchNature]

class WrenchNoise:
    force: float
    moment: float
    position: float
    heading: float

class WrenchFilter:
    def __init__(self, model: Model, run: RunData, max_gap: float = 0.1) -> None: ...
    def likeliest_noise(self, nature: WrenchNature) -> WrenchNoise: ...
    def innovations(self, nature: WrenchNature, noise: WrenchNoise) -> Innovations: ...
    def smooth(
        self, noise: WrenchNoise, acting: Optional[ArrayLike] = ..., channels: Sequence[int] = ...
    ) -> InferredWrench: ...
    @property
    def model_thrust(self) -> Array: ...
    @property
    def stretches(self) -> List[int]: ...

# stochastic likelihood

class GreyBoxPoint:
    def __init__(
        self, model: Model, levels: Dict[str, float], loudness: Sequence[float] = ...
    ) -> None: ...
    @property
    def model(self) -> Model: ...
    @property
    def levels(self) -> Dict[str, float]: ...
    @property
    def loudness(self) -> List[float]: ...

class GreyBox:
    def __init__(self, runs: Sequence[RunData], craft: Model, max_gap: float = 0.1) -> None: ...
    def start(self, model: Model) -> GreyBoxPoint: ...
    def fit(
        self,
        start: GreyBoxPoint,
        free: Sequence[str],
        levels: bool = True,
        held: Sequence[str] = ...,
        cap: float = 25.0,
        far: bool = False,
        max_iterations: int = 60,
        threads: int = 1,
    ) -> GreyBoxFit: ...
    def intervals(
        self,
        point: GreyBoxPoint,
        level_information: Array,
        free: Sequence[str],
        held: Sequence[str] = ...,
        cap: float = 25.0,
        threads: int = 1,
    ) -> List[FittedParameter]: ...
    def likelihood(
        self, point: GreyBoxPoint, cap: float = 25.0, block: float = 1.0, threads: int = 1
    ) -> List[Array]: ...
    def scores(
        self,
        point: GreyBoxPoint,
        parameters: Sequence[str],
        cap: float = 25.0,
        block: float = 1.0,
        threads: int = 1,
    ) -> Scores: ...
    def residuals(
        self,
        point: GreyBoxPoint,
        run: int,
        cap: float = 25.0,
        acting: Optional[ArrayLike] = ...,
    ) -> Residuals: ...
    def forecast(
        self,
        point: GreyBoxPoint,
        run: int,
        starts: Sequence[int],
        horizons: Sequence[float],
        unknown_loudness: bool = False,
        free: Sequence[str] = ...,
        information: Optional[ArrayLike] = ...,
        scale: Sequence[float] = ...,
        part: float = 0.9,
        draws: int = 99,
        velocity_noise: ArrayLike = ...,
        cap: float = 25.0,
        seed: int = 1,
    ) -> List[Forecast]: ...
