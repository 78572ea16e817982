"""How likely recorded poses are under a model: what effects are tested by.

The measured poses of every window are held against a simulation from a free initial state; the errors
are whitened by the poses' noise and by a white acceleration beside the model, whose levels are the
likeliest ones (_core.SimulationError with poses as target). Under a true model they are independent
normal numbers. Differences of cost are then log-likelihood ratios, whatever the smoother of the
velocities does.
"""
import numpy as np
from scipy import stats

from ground import _core, windows
from ground.errors import IdentifyError

WIDTH = 3.0  # of the robust loss [standard deviations]
BLOCK = 0.5  # length of stretches that are taken as independent [s]
ROUNDS = 6  # at most, of levels and fit in turn
SETTLED = 0.5  # change of the log-likelihood ratio between rounds that ends them


class Evidence:
    """Windows of runs (_core.RunData) with levels of noise and disturbance."""

    def __init__(self, runs, cut):
        self.runs = runs
        self.cut = cut
        self.problem = windows.problem(runs, cut, _core.Target.poses)

    @property
    def samples(self):
        """Number of residuals."""
        return 3 * sum(w.last - w.first + 1 for w in self.cut)

    def levelled(self, model):
        """The same windows with the levels that are likeliest under a model."""
        levels = call(self.problem.likeliest_disturbance, model, WIDTH, threads=1)
        runs = [run.disturbed(*level) for run, level in zip(self.runs, levels)]
        return Evidence(runs, self.cut)

    def fit(self, model, free, near=True):
        """Likeliest parameters under the levels: the result of _core's fit."""
        return call(self.problem.fit, model, free, width=WIDTH, near=near, threads=1)

    def settle(self, model, free):
        """Levels and parameters in turn until neither moves: the evidence and the fitted model."""
        evidence, before = self, None
        for _ in range(ROUNDS):
            evidence = evidence.levelled(model)
            model = evidence.fit(model, free)["model"]
            likelihood = evidence.log_likelihood(model)
            if before is not None and likelihood - before < SETTLED:
                break
            before = likelihood
        return evidence, model

    def log_likelihood(self, model):
        """Of all poses, up to a constant that neither model nor levels change."""
        return -float(self.costs(model).sum()) - self.problem.log_deviations()

    def costs(self, model):
        """Robust cost of each window (n,): minus its log-likelihood but for a constant."""
        return call(self.problem.scores, model, [], WIDTH, BLOCK, threads=1)["cost"]

    def scores(self, model, names):
        """Score and information of parameters at a model: Scores."""
        return Scores(names, call(self.problem.scores, model, names, WIDTH, BLOCK, threads=1))


class Scores:
    """First and second derivatives of the log-likelihood by parameters, in units of their scales."""

    def __init__(self, names, found):
        self.names = list(names)
        self.scale = np.array(found["scale"])
        self.blocks = np.array(found["score"])  # (blocks, n)
        self.information = np.array(found["information"])  # (n, n)

    def test(self, tested, nuisance):
        """Score test of some parameters while others are free (Rao 1948), with what a Newton step
        would come to.

        Returns a dictionary with `gain`, the expected log-likelihood ratio 2 (L1 - L0); `step`, of
        the tested parameters' coordinates; `inflation`, the factor by which correlated residuals
        make the gain vary more than independent ones would; `blocks`, their number.
        """
        s = [self.names.index(name) for name in tested]
        n = [self.names.index(name) for name in nuisance]
        A = self.information
        onto = _solve(A[np.ix_(n, n)], A[np.ix_(n, s)])
        information = A[np.ix_(s, s)] - A[np.ix_(s, n)] @ onto
        rest = self.blocks[:, s] - self.blocks[:, n] @ onto
        total = rest.sum(axis=0)
        step = _solve(information, total)
        centred = rest - rest.mean(axis=0)
        spread = centred.T @ centred * len(rest) / max(1, len(rest) - 1 - len(n))
        inflation = np.trace(_solve(information, spread)) / max(1, len(s))
        return {
            "gain": float(total @ step),
            "step": step * self.scale[s],
            "inflation": float(max(1.0, inflation)),
            "blocks": len(rest),
        }


def p_value(gain, inflation, blocks, free, on_bound, nuisance=0):
    """Chance of a log-likelihood ratio 2 (L1 - L0) as large as `gain` without the effect.

    The ratio is divided by its inflation, which was estimated from so many blocks: an F statistic
    takes the place of chi squared. Of `free` parameters `on_bound` have their neutral value at a
    bound: each of those stays there half of the time, which makes the ratio a mixture (Self and
    Liang 1987; binomial weights, exact for independent estimates).
    """
    if not gain > 0:
        return 1.0
    rest = max(2, blocks - nuisance - free)
    total = 0.0
    for moved in range(on_bound + 1):
        count = free - on_bound + moved
        if count > 0:
            weight = stats.binom.pmf(moved, on_bound, 0.5)
            total += weight * stats.f.sf(gain / inflation / count, count, rest)
    return float(total)


def call(function, *arguments, **options):
    """The core's answer; IdentifyError in place of what it throws."""
    try:
        return function(*arguments, **options)
    except (RuntimeError, ValueError) as error:
        raise IdentifyError(str(error))


def _solve(matrix, right):
    """Of a matrix that may be singular: directions that nothing is known of stay where they are."""
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / size / size[:, None]
    right = right / (size if right.ndim == 1 else size[:, None])
    solution = np.linalg.lstsq(scaled, right, rcond=1e-9)[0] if len(matrix) else right
    return solution / (size if right.ndim == 1 else size[:, None])
