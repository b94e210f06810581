"""What has changed in a camera's photographs besides where points lie: signatures (gap.signature) of two sets are compared.

Whether anything changed, permuted photographs say. What it was: each effect is laid on the earlier photographs, or on the later
ones where it has become less, and the one that takes one set's signatures to the other's gets its name.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from effects import library
from gap.changes import MAX_P, MIN_CAPTURES
from gap.exchange import MAX_GROUP
from gap.observables import SIGNS, SIGNS_OF_GROUP
from gap.parameters import spec
from gap.permutation import labellings, p_values
from gap.search import is_significant
from gap.signature import OF_LIGHT
from gap.split import thinned
from job import seed_of

MIN_SHOWING = 0.8  # of the photographs, that show a sign which counts
MAX_DIVISIONS = 5000  # of photographs between the sets: of 1,000 a p of 0.01 would be told to a third
MAX_LAID, PATCHES_LAID = 4, 6  # photographs of a set, patches of each, on which effects are laid to see what they do
SCALES = (0.1, 4.0)  # of an effect's starts, at least and at most
TIMES_SCALED = 2  # what effects do is not linear
FIRST_STEP = 5.0  # times what matters, from effects that start at nothing
MAX_REFINED, STEPS = 6, 4  # effects whose parameters are fitted, steps of a fit
DIFFERENCE = 0.1  # of its value, by which a parameter goes for a derivative: grey levels are whole, so less is rough
FAR_BEHIND = 6.0  # times what the best leaves, from which an effect's are not
MIN_SHARE_EXPLAINED = 0.5  # of what has changed, that a named effect explains
MIN_SHARE_OF_NEXT = (
    0.2  # of what had changed at first, left for another: a form not quite the camera's leaves a residue
)
MAX_CHANGES = 3
AFTER_LENS = [SIGNS.index(name) for name in SIGNS_OF_GROUP["noise"]]
LIT = [SIGNS.index(name) for name in OF_LIGHT]
MAX_TIMES_LEFT = 2.0  # times what the best leaves, up to which another effect explains alike


@dataclass(frozen=True)
class SignatureChange:
    """An effect that the later photographs have more of (``less``: less of) than the earlier ones.

    parameters {name: value} and errors {name: standard error} of the effect as it was laid on; p of the permutations
    before, after  root mean square differences of the sets' signatures in standard errors
    explained  by what the sum of their squares falls; one_of what cannot be told from it; like_light: another lamp would do
    as well
    """

    effect: str
    less: bool
    parameters: dict
    errors: dict
    p: float
    before: float
    after: float
    explained: float
    one_of: tuple
    like_light: bool

    @property
    def laid(self):
        """The effect as it is laid on: [(name, parameters)]."""
        return [(self.effect, self.parameters)]


@dataclass(frozen=True)
class Compared:
    """Signatures of two sets: which signs count, their differences in standard errors t (k,), what whitens these, p, the
    errors (k,) of differences of means.
    """

    counted: np.ndarray
    t: np.ndarray
    whitener: np.ndarray
    p: float
    error: np.ndarray

    def distance(self, moved):
        """Return the whitened differences (k,) that a move (len(SIGNS),) of the earlier signatures leaves."""
        return self.whitener @ (self.t - np.nan_to_num(moved[self.counted]) / self.error)

    def is_of_light(self, moved):
        """Return whether a move (len(SIGNS),) is most of all one of signs that another lamp moves as well."""
        squares = (np.nan_to_num(moved[self.counted]) / self.error) ** 2
        return bool(squares[np.isin(self.counted, LIT)].sum() > squares.sum() / 2)


def compared(before, after, seed, poses=None, uncounted=()):
    """Return the Compared of signatures (n, len(SIGNS)) of two sets, but for signs ``uncounted``; a seed draws permutations.

    What signs follow of the photographs' ``poses`` (both sets', m), if given, is regressed out, and permuted is what is left.
    Source: D. Freedman and D. Lane, "A nonstochastic interpretation of reported significance levels" (1983).
    """
    every, belongs = np.concatenate([before, after]), np.repeat([0, 1], [len(before), len(after)])
    shown = np.isfinite(every)
    showing = np.minimum(*(shown[belongs == k].mean(0) for k in (0, 1)))
    counted = np.flatnonzero((showing >= MIN_SHOWING) & ~np.isin(SIGNS, uncounted))
    values = every[:, counted]
    for k in (0, 1):
        own = belongs == k
        values[own] = np.where(np.isfinite(values[own]), values[own], np.nanmedian(values[own], axis=0))
    left_of = residual_maker(np.zeros((len(every), 0)) if poses is None else poses)
    values = left_of @ values
    found = [_statistic(values[order], belongs, left_of) for order in orders(belongs, np.random.default_rng(seed))]
    _, t, whitener, error = found[0]
    p = float(p_values(np.array([f[0] for f in found]).T).min())
    return Compared(counted, t, whitener, p, error)


def orders(belongs, rng):
    """Return orders (m lists of n) of captures, the given one first: each division between the sets once, within by ``rng``."""
    divisions = labellings(belongs, rng, MAX_DIVISIONS)[1:]
    drawn = [np.concatenate([rng.permutation(np.flatnonzero(labels == k)) for k in (0, 1)]) for labels in divisions]
    return [np.arange(len(belongs)), *drawn]


def residual_maker(regressors):
    """Return the matrix (n, n) that takes values to what their mean and regressors (n, m) leave, a ridge on each.

    Few photographs tell little of a slope: in standard deviations its prior is a ``1 / n^(1/4)`` of a value's.
    """
    n, m = regressors.shape
    x = (regressors - regressors.mean(0)) / np.maximum(regressors.std(0), 1e-9)
    return np.eye(n) - 1 / n - x @ np.linalg.solve(x.T @ x + np.sqrt(n) * np.eye(m), x.T)


def _statistic(values, belongs, left_of):
    """Return (evidence (2,), differences t, whitener, errors of differences) of values (n, k) of two sets, ``belongs`` (n,).

    Both are regressed by ``left_of`` (n, n). Evidence of a change is Hotelling's statistic, its cube root, and the largest
    difference: of many signs, or of one. Correlations are shrunk towards none, as n photographs tell few. Source: O. Ledoit and
    M. Wolf, "A well-conditioned estimator for large-dimensional covariance matrices" (2004).
    """
    n, k = values.shape
    belongs = left_of @ belongs
    difference = belongs @ values / (belongs @ belongs)
    within, free = values - np.outer(belongs, difference), np.trace(left_of) - 1
    sd = np.sqrt((within**2).sum(0) / free) + 1e-6
    error = sd / np.sqrt(belongs @ belongs)
    t = difference / error
    shrunk = k / (k + n - 2)
    correlation = (1 - shrunk) * (within / sd).T @ (within / sd) / free + shrunk * np.eye(k)
    whitener = np.linalg.inv(np.linalg.cholesky(correlation))
    return (np.cbrt(((whitener @ t) ** 2).sum()), np.abs(t).max()), t, whitener, error


def candidates_of(names, in_colour):
    """Return those of some effects that can be laid on photographs, ``in_colour`` or not."""
    return [n for n in names if can_be_laid_on(n) and (in_colour or not library.needs_colour(n))]


def can_be_laid_on(name):
    """Return whether an effect acts on light that reached the camera: not the scene's, and not what only moves points."""
    return library.effect_named(name).STAGE != "scene" and not library.is_pure_geometry(name)


class Layer:
    """Lays effects on some photographs of a set: what do their signatures become?"""

    def __init__(self, photographs, laid, sign, each):
        """laid: effects that the photographs have on already; sign 1 of the earlier set, -1 of the later one."""
        self.photographs = [p.fewer(PATCHES_LAID) for p in thinned(photographs, MAX_LAID)]
        self.laid, self.sign, self.each = list(laid), sign, each
        self._before = self._signatures([])

    def _signatures(self, effects):
        return signatures_of(self.photographs, [*self.laid, *effects], self.each)

    def move(self, effects):
        """Return by what the earlier signatures (len(SIGNS),) seem to move.

        What a lens no longer does, it did to light: laid on the later photographs it smooths noise that came after it.
        """
        with np.errstate(invalid="ignore"):
            moved = self._signatures(effects) - self._before
        moved = self.sign * np.array([np.median(m[np.isfinite(m)]) if np.isfinite(m).any() else 0.0 for m in moved.T])
        if self.sign < 0 and all(library.is_before_sensor(name) for name, _ in effects):
            moved[AFTER_LENS] = 0.0
        return moved


def signatures_of(photographs, effects, each):
    """Return the signatures (n, len(SIGNS)) of photographs with effects laid on; ``each`` maps them, as map does."""
    return np.array(list(each(lambda p: p.signature(effects, laid_on_numbers(p)), photographs)))


def laid_on_numbers(photograph):
    """Return the random numbers of effects that are laid on a photograph, by its capture's name."""
    return np.random.default_rng(seed_of("laid on", photograph.view.capture))


@dataclass(frozen=True)
class Trial:
    """An effect laid on: which one and how.

    left is what it leaves of the squared distance, charged for its parameters; moved (len(SIGNS),) by what it moves the signs
    """

    effect: str
    less: bool
    parameters: dict
    left: float
    moved: np.ndarray
    errors: dict


def tried(name, layer, comparison):
    """Return the Trial of an effect that comes nearest: as it starts, and as much of it as would fit best if it were linear.

    None where it leads the other way.
    """
    nulls = library.nulls_of(name)
    from_nothing = all(nulls | s == nulls for s in library.starts_of(name))
    if from_nothing and layer.sign < 0:
        return None
    found = []
    for start in [_from_nothing(name, layer, comparison)] if from_nothing else starts_of(name):
        found += _scaled_ones(laid_on(name, start, layer, comparison), nulls, layer, comparison)
    return min(found, key=lambda t: t.left, default=None)


def _scaled_ones(trial, nulls, layer, comparison):
    """Return the Trials that lead towards the later signatures: one, then as much of it as would fit best if it were linear,
    ``TIMES_SCALED`` times.
    """
    found, start_distance = [], comparison.distance(np.zeros(len(SIGNS)))
    for _ in range(TIMES_SCALED):
        way = start_distance - comparison.distance(trial.moved)
        scale = float(way @ start_distance) / max(float(way @ way), 1e-9)
        if scale <= 0:
            return found
        found.append(trial)
        scale = np.clip(scale, *SCALES)
        trial = laid_on(trial.effect, scaled(trial.effect, nulls, trial.parameters, scale), layer, comparison)
    return [*found, trial]


def starts_of(name):
    """Return the starts [{parameter: value}] of an effect; of one that mixes alternatives alike each alone as well."""
    out = []
    for given in library.starts_of(name):
        moved = {k: v for k, v in given.items() if not spec((name, k)).auxiliary}
        out.append(library.nulls_of(name) | given)
        if len(moved) > 2 and len(set(moved.values())) == 1:
            alone = ({k: sum(moved.values()) * (k == one) for k in moved} for one in moved)
            out += [library.nulls_of(name) | given | values for values in alone]
    return out


def _from_nothing(name, layer, comparison):
    """Return the parameters of an effect that may be of either sign, all as they would fit best if it were linear."""
    nulls, start = library.nulls_of(name), comparison.distance(np.zeros(len(SIGNS)))
    keys = [k for k in library.fitted_parameters(name) if not spec((name, k)).auxiliary]
    specs = [spec((name, k)) for k in keys]
    steps = np.array([FIRST_STEP * s.matters for s in specs])
    wide = np.array([s.prior_sd or s.upper - s.lower for s in specs])
    moved = [laid_on(name, nulls | {k: nulls[k] + h}, layer, comparison) for k, h in zip(keys, steps, strict=True)]
    ways = np.stack([start - comparison.distance(t.moved) for t in moved], axis=1)
    times = np.linalg.solve(ways.T @ ways + np.diag((steps / wide) ** 2), ways.T @ start)
    values = [float(np.clip(s.null + n * h, s.lower, s.upper)) for s, n, h in zip(specs, times, steps, strict=True)]
    return nulls | dict(zip(keys, values, strict=True))


def laid_on(name, parameters, layer, comparison):
    """Return the Trial of an effect with parameters."""
    moved = layer.move([(name, parameters)])
    distance = comparison.distance(moved)
    return Trial(
        name,
        layer.sign < 0,
        parameters,
        float(distance @ distance) + 2 * len(library.fitted_parameters(name)),
        moved,
        {},
    )


def scaled(name, nulls, start, scale):
    """Return an effect's parameters as far from the null as a start, times a scale, within their bounds."""
    out = dict(start)
    for key in start:
        s = spec((name, key))
        if not s.auxiliary:
            out[key] = float(np.clip(nulls[key] + scale * (start[key] - nulls[key]), s.lower, s.upper))
    return out


def refined(trial, layer, comparison):
    """Return a Trial with its effect's parameters fitted."""
    name, keys = trial.effect, library.fitted_parameters(trial.effect)
    specs = [spec((name, k)) for k in keys]
    lower, upper = (np.array([getattr(s, side) for s in specs]) for side in ("lower", "upper"))
    unit = np.array([s.matters for s in specs])
    start = np.clip([trial.parameters[k] for k in keys], lower + 1e-6 * unit, upper - 1e-6 * unit)

    def left(values):
        parameters = trial.parameters | dict(zip(keys, values * unit, strict=True))
        pull = [(v * u - s.null) / (s.upper - s.lower) for v, u, s in zip(values, unit, specs, strict=True)]
        return np.concatenate([comparison.distance(layer.move([(name, parameters)])), pull])

    fit = least_squares(
        left, start / unit, bounds=(lower / unit, upper / unit), x_scale=1.0, diff_step=DIFFERENCE, max_nfev=STEPS
    )
    end = laid_on(name, trial.parameters | dict(zip(keys, (fit.x * unit).tolist(), strict=True)), layer, comparison)
    errors = np.sqrt(np.diagonal(np.linalg.pinv(fit.jac.T @ fit.jac))) * unit
    best = min((trial, end), key=lambda t: t.left)
    return replace(best, errors=dict(zip(keys, errors.tolist(), strict=True)))


def _refined_ones(trials, layers, comparison):
    """Return those of some Trials, refined, whose effects do more than is worth naming."""
    fitted = [refined(t, layers[t.less], comparison) for t in trials]
    return [t for t in fitted if is_significant(t.effect, t.parameters, {})]


def why_not_comparable(before, after):
    """Return why signatures of two sets of photographs cannot be compared, None where they can."""
    if min(len(before), len(after)) < MIN_CAPTURES:
        return f"{len(before)} and {len(after)} photographs show patches; {MIN_CAPTURES} of each are needed"
    return None


def signature_changes(before, after, candidates, seed_name, threads=1, uncounted=()):
    """Return ([SignatureChange], p of what is left) from photographs (gap.signature.Photograph) of one set to another's.

    ``uncounted`` are names of signs that are not compared. Sets are large enough (``why_not_comparable``).
    """
    with ThreadPoolExecutor(threads) as pool:
        each = pool.map if threads > 1 else map
        return _changes((before, after), candidates, seed_of("signatures", seed_name), each, uncounted)


def _changes(sets, candidates, seed, each, uncounted):
    found, laid, at_first = [], ([], []), None
    signatures = [signatures_of(photographs, (), each) for photographs in sets]
    poses = np.array([p.pose for photographs in sets for p in photographs])
    in_colour = all(p.image.shape[2] > 1 for photographs in sets for p in photographs)
    names = candidates_of(candidates or sorted(library.available_effects()), in_colour)
    while True:
        comparison = compared(*signatures, seed, poses, uncounted)
        start = comparison.distance(np.zeros(len(SIGNS)))
        total = float(start @ start)
        at_first = at_first or total
        little = bool(found) and total - len(comparison.counted) < MIN_SHARE_OF_NEXT * at_first
        if comparison.p > MAX_P or little or len(found) == MAX_CHANGES:
            return found, 1.0 if little else comparison.p
        change = _named(sets, laid, names, comparison, total, each)
        if change is None:
            return found, comparison.p
        found.append(change)
        laid[change.less].extend(change.laid)
        moved = signatures_of(sets[change.less], laid[change.less], each)
        if change.less and library.is_before_sensor(change.effect):
            moved[:, AFTER_LENS] = signatures[True][:, AFTER_LENS]
        signatures[change.less] = moved
        names = [n for n in names if n != change.effect]


def _named(sets, laid, names, comparison, total, each):
    """Return the SignatureChange that explains most, None where none explains enough."""
    layers = {less: Layer(sets[less], laid[less], -1 if less else 1, each) for less in (False, True)}
    trials = [tried(n, layers[less], comparison) for n in names for less in (False, True)]
    best_of = {}
    for trial in sorted((t for t in trials if t), key=lambda t: t.left):
        best_of.setdefault(trial.effect, trial)
    if not best_of:
        return None
    likely = list(best_of.values())[:MAX_REFINED]
    near = [t for t in likely if t.left <= FAR_BEHIND * likely[0].left]
    ranked = _refined_ones(near, layers, comparison) or _refined_ones(likely[len(near) :], layers, comparison)
    ranked, k = sorted(ranked, key=lambda t: t.left), len(comparison.counted)
    if not ranked or total - ranked[0].left < MIN_SHARE_EXPLAINED * (total - k):
        return None
    best = ranked[0]
    alike = [t.effect for t in ranked[1:] if t.left < MAX_TIMES_LEFT * best.left]
    return SignatureChange(
        best.effect,
        best.less,
        best.parameters,
        best.errors,
        comparison.p,
        float(np.sqrt(total / k)),
        float(np.sqrt(best.left / k)),
        total - best.left,
        (best.effect, *alike)[:MAX_GROUP] if alike else (),
        comparison.is_of_light(best.moved),
    )
