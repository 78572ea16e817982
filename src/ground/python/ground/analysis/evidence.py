"""How likely recorded poses are under a model: what effects are tested by.

The measured poses of every window are held against a simulation from a free initial state; the errors
are whitened by the poses' noise and by a white acceleration beside the model, whose levels are the
likeliest ones (_core.SimulationError with poses as target). Under a true model they are independent
normal numbers. Differences of cost are then log-likelihood ratios, whatever the smoother of the
velocities does.
"""
import numpy as np
from scipy import stats

from ground import _core
from ground.errors import IdentifyError
from ground.recordings import windows

WIDTH = 3.0  # of the robust loss [standard deviations]
BLOCK = 0.5  # length of stretches that are taken as independent [s]
ROUNDS = 6  # at most, of levels and fit in turn
SETTLED = 0.5  # change of the log-likelihood ratio between rounds that ends them


class Evidence:
    """Windows of runs (_core.RunData) with levels of noise and disturbance."""

    def __init__(self, runs, cut, disturbed=0.0):
        self.runs = runs
        self.disturbed = disturbed  # log-likelihood ratio 2 (L1 - L0) against no disturbance
        self.cut = cut
        self.problem = windows.problem(runs, cut, _core.Target.poses)

    @property
    def samples(self):
        """Number of residuals."""
        return 3 * sum(w.last - w.first + 1 for w in self.cut)

    def levelled(self, model):
        """The same windows with the levels that are likeliest under a model."""
        levels = call(self.problem.likeliest_disturbance, model, WIDTH, threads=1)
        runs = [run.disturbed(*level[:2]) for run, level in zip(self.runs, levels)]
        return Evidence(runs, self.cut, sum(level[2] for level in levels))

    def fit(self, model, free, initial=()):
        """Likeliest parameters under the levels, sought from the model's own: the result of _core's
        fit, and besides `costs`, those of the windows, and `scores` of the free parameters."""
        found = call(
            self.problem.fit, model, free, width=WIDTH, near=True, threads=1, initial=initial
        )
        found["scores"] = self.scores(found["model"], free, found["initial"])
        found["costs"] = found["scores"].costs
        return found

    def held_out(self, model, free, parts):
        """Cost of all windows, those of each part by a fit to the others."""
        total = 0.0
        for part in parts:
            rest = [w for w in self.cut if w not in part]
            fitted = Evidence(self.runs, rest).fit(model, free)["model"]
            total += Evidence(self.runs, part).as_given(fitted, free)["costs"].sum()
        return float(total)

    def as_given(self, model, free):
        """A model that is not fitted, in the place of a fit."""
        scores = self.scores(model, free)
        return {
            "model": model,
            "initial": scores.initial,
            "scores": scores,
            "costs": scores.costs,
        }

    def settle(self, model, free):
        """Levels and parameters in turn until neither moves: the evidence, and its last fit."""
        evidence, before, initial = self, None, ()
        for _ in range(ROUNDS):
            evidence = evidence.levelled(model)
            found = evidence.fit(model, free, initial)
            model, initial = found["model"], found["initial"]
            likelihood = -found["costs"].sum() - evidence.problem.log_deviations()
            if before is not None and likelihood - before < SETTLED:
                break
            before = likelihood
        return evidence, found

    def scores(self, model, names, initial=()):
        """Score and information of parameters at a model: Scores."""
        found = call(self.problem.scores, model, names, WIDTH, BLOCK, threads=1, initial=initial)
        return Scores(names, found)


class Scores:
    """First and second derivatives of the log-likelihood by parameters, in units of their scales."""

    def __init__(self, names, found):
        self.names = list(names)
        self.scale = np.array(found["scale"])
        self.blocks = np.array(found["score"])  # (blocks, n)
        self.information = np.array(found["information"])  # (n, n)
        self.initial = found["initial"]
        self.costs = np.array(found["cost"])  # (windows,)

    def test(self, tested, nuisance):
        """Score test of some parameters while others are free (Rao 1948), with what a Newton step
        would come to.

        Returns a dictionary with `gain`, the expected log-likelihood ratio 2 (L1 - L0); `step`, of
        the tested parameters' coordinates; `inflation`, the factor by which correlated residuals
        make the gain vary more than independent ones would; `blocks`, their number; `seen`, the part
        of the parameters' information that the nuisance cannot take over, of the worst of them.
        """
        s = [self.names.index(name) for name in tested]
        n = [self.names.index(name) for name in nuisance]
        A = self.information
        onto = _solve(A[np.ix_(n, n)], A[np.ix_(n, s)])
        information = A[np.ix_(s, s)] - A[np.ix_(s, n)] @ onto
        rest = self.blocks[:, s] - self.blocks[:, n] @ onto
        total = rest.sum(axis=0)
        step = _solve(information, total)
        raw = np.diag(A)[s]
        centred = rest - rest.mean(axis=0)
        spread = centred.T @ centred * len(rest) / max(1, len(rest) - 1 - len(n))
        inflation = np.trace(_solve(information, spread)) / max(1, len(s))
        return {
            "gain": float(total @ step),
            "step": step * self.scale[s],
            "inflation": float(max(1.0, inflation)),
            "blocks": len(rest),
            "seen": float(np.min(np.diag(information) / np.where(raw > 0, raw, np.inf))),
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
