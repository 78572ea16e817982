"""Types of the dictionaries that functions of the compiled core return."""

from typing import TYPE_CHECKING, List, Tuple, TypedDict, Union

from ground.annotations import Array

if TYPE_CHECKING:
    from ground import _core


Setting = Union[float, bool, str]  # value of a parameter in the core's tables


class Palette(TypedDict):
    """Colours "#rrggbb" of all that is drawn (ground/palette.h)."""

    measured: str
    models: List[str]
    reference: str
    thrusters: List[str]
    missing: str
    scale: List[str]  #: from small to large values


class ParameterInfo(TypedDict):
    """A parameter of an effect."""

    name: str
    unit: str
    doc: str
    neutral: float
    lower: float
    upper: float


class ModelParameter(ParameterInfo):
    """A parameter of a model."""

    scale: float  #: size of a change that matters, in the parameter's unit


class Thruster(TypedDict):
    """A thruster of a model."""

    name: str
    channel: str  #: name of its commands in recordings
    position: Tuple[float, float]  #: forward, to starboard [m]
    direction: float  #: direction of the force [deg]: 0 forward, 90 to starboard
    range: Tuple[float, float]  #: inputs, over the largest
    gain: float  #: force at full input, over k


class EffectInfo(TypedDict):
    """An effect of the library."""

    summary: str
    parameters: List[ParameterInfo]
    opt_in: bool  #: a diagnosis tries it only when it is asked to


class EffectUse(TypedDict):
    """How a controller uses the effects of a model."""

    used: List[str]
    unused: List[str]
    remark: str
    refusal: str  #: why it must not use the model; empty when it may


class Estimate(TypedDict):
    """An estimate of a parameter, in its unit."""

    name: str
    unit: str
    value: float
    ci95: Tuple[float, float]  #: 95% interval
    deviation: float
    identified: bool  #: whether the data determine it


class FittedParameter(Estimate):
    """A parameter that was fitted."""

    start: float  #: where the fit began
    at_bound: bool


class Fit(TypedDict):
    """Result of SimulationError.fit."""

    model: "_core.Model"
    parameters: List[FittedParameter]
    correlation: Array  #: (n, n) correlation of the parameters
    condition: float
    objective: float
    initial: List[Array]  #: initial state of each window
    width: float
    starts: int
    starts_at_best: int
    iterations: int
    converged: bool
    message: str


class Motion(TypedDict):
    """A simulated motion."""

    eta: Array  #: (n, 3) x, y [m], psi [rad]
    nu: Array  #: (n, 3) u, v [m/s], r [rad/s]


class WindowMotions(TypedDict):
    """Simulated motions of windows."""

    eta: List[Array]  #: (n, 3) each: x, y [m], psi [rad]
    nu: List[Array]  #: (n, 3) each: u, v [m/s], r [rad/s]


class BestMotions(WindowMotions):
    """Simulated motions from a model's best initial velocities."""

    objective: float


class Smoothed(TypedDict):
    """Poses smoothed, and their derivatives."""

    eta: Array  #: (n, 3) x, y [m], psi [rad]
    nu: Array  #: (n, 3) u, v [m/s], r [rad/s]
    nu_dot: Array  #: (n, 3) [m/s^2], [rad/s^2]
    used: List[bool]  #: false: an outlier
    starts: List[bool]  #: true: the first of a stretch


class Innovations(TypedDict):
    """Innovations of a wrench filter."""

    normalised: Array  #: (n, 3) forward, to starboard, in heading
    valid: List[bool]
    log_likelihood: float


class InferredWrench(TypedDict):
    """The missing wrench, smoothed."""

    wrench: Array  #: (n, 3) X, Y [N], N [N m]
    sigma: Array  #: (n, 3) standard deviations
    responses: Array  #: the filter's responses to given wrenches


class RunTrim(TypedDict):
    """Wrench and thrust that are constant in a run."""

    wrench: Array  #: (3,) X, Y [N], N [N m]
    wrench_sigma: Array  #: (3,) standard deviations
    thrust: float  #: relative
    thrust_sigma: float


class GreyBoxFit(TypedDict):
    """Result of GreyBox.fit."""

    point: "_core.GreyBoxPoint"
    log_likelihood: float
    log_posterior: float
    by_run: List[float]
    trims: List[RunTrim]
    information: Array  #: (n, n) Fisher information of the parameters' coordinates / scale
    scale: List[float]
    parameters: List[FittedParameter]
    level_information: Array  #: Fisher information of the logs of the levels
    iterations: int
    converged: bool


class Scores(TypedDict):
    """Derivatives of a log-likelihood."""

    scale: List[float]
    score: Array  #: (blocks, n)
    run: List[int]  #: run of each block
    information: Array  #: (n, n)


class Residuals(TypedDict):
    """Whitened innovations of a run, and the disturbance as filtered."""

    whitened: Array  #: (n, 3)
    scored: List[bool]
    states: Array  #: (n, 6) filtered x, y [m], psi [rad], u, v [m/s], r [rad/s]
    wrench: Array  #: (n, 3) X, Y [N], N [N m]
    constants: Array  #: (n, 4) X, Y [N], N [N m], thrust
    responses: Array  #: (3 n, k)


class Forecast(TypedDict):
    """A prediction that starts at a sample of a run; arrays are (n, 6)."""

    first: int
    mean: Array
    deviation: Array
    low: Array
    high: Array


class ExperimentLog(TypedDict):
    """A simulated experiment; times in [s], inputs 0..1."""

    frames: Array  #: (n, 5) captured, delivered, x, y, psi
    commands: Array  #: (n, 2 + k) time, inputs of the k thrusters, lift
    truth: Array  #: (n, 13) time, eta, nu, nu_dot, wrench of the disturbance
    references: Array  #: (n, 9) time, p, p_dot, p_ddot, p_dddot
    decisions: Array  #: (n, 3 + 2 k) time, stamp, processor time, inputs, wanted inputs
    marks: List[Tuple[float, int, bool, str]]  #: time, number, whether a burst begins, reason
    stages: List[Tuple[float, str, str]]  #: time, state, reason
    stopped: str  #: why it stopped early; empty when it did not
    stopped_at: float
