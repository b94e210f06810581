"""What has changed in a camera's photographs besides where points lie: signatures (gap.signatures) of two sets are compared.

Whether anything changed, permuted photographs say. What it was: each effect is laid on the earlier photographs, or on the later
ones where it has become less, and the one that takes one set's signatures to the other's gets its name.
"""

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import least_squares

from effects import library
from gap.bounds import CHARGE, CLOSED, MAX_P, MOST, TWICE
from gap.changes.changes import MIN_CAPTURES
from gap.changes.power import CLEAR, clear_ones, least_seen
from gap.fit.parameters import bounds_of, scaled, spec
from gap.fit.split import thinned
from gap.observables import SIGNS, SIGNS_OF_GROUP
from gap.select.exchange import MAX_GROUP
from gap.select.naming import is_significant
from gap.signatures.signature_comparison import compared
from job import seed_of

MAX_LAID, PATCHES_LAID = 4, 6  # photographs of a set, patches of each, on which effects are laid to see what they do
LAID_FOR_POWER = 2  # photographs, as many amounts are laid on
SCALES = (0.1, 4.0)  # of an effect's starts, at least and at most
TIMES_SCALED = 2  # what effects do is not linear
MAX_REFINED, STEPS = 6, 4  # effects whose parameters are fitted, steps of a fit
DIFFERENCE = 0.1  # of its value, by which a parameter goes for a derivative: grey levels are whole, so less is rough
FAR_BEHIND = 6.0  # times what the best leaves, from which an effect's are not
MAX_CHANGES = 3
AFTER_LENS = [SIGNS.index(name) for name in SIGNS_OF_GROUP["noise"]]


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

    def move(self, name, parameters):
        """Return by what the earlier signatures (len(SIGNS),) seem to move where an effect is laid on.

        What a lens no longer does, it did to light: laid on the later photographs it smooths noise that came after it.
        """
        with np.errstate(invalid="ignore"):
            moved = self._signatures([(name, parameters)]) - self._before
        moved = self.sign * np.array([np.median(m[np.isfinite(m)]) if np.isfinite(m).any() else 0.0 for m in moved.T])
        if self.sign < 0 and library.is_before_sensor(name):
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
    from_nothing = library.begins_at_nothing(name)
    if from_nothing and layer.sign < 0:
        return None
    found = []
    for start in [_from_nothing(name, layer, comparison)] if from_nothing else starts_of(name):
        found += _scaled_ones(laid_on(name, start, layer, comparison), layer, comparison)
    return min(found, key=lambda t: t.left, default=None)


def _scaled_ones(trial, layer, comparison):
    """Return the Trials that lead towards the later signatures: one, then as much of it as would fit best if it were linear,
    ``TIMES_SCALED`` times.
    """
    found, start = [], comparison.whitened
    for _ in range(TIMES_SCALED):
        way = start - comparison.distance(trial.moved)
        scale = float(way @ start) / max(float(way @ way), 1e-9)
        if scale <= 0:
            return found
        found.append(trial)
        scale = np.clip(scale, *SCALES)
        trial = laid_on(trial.effect, scaled(trial.effect, trial.parameters, scale), layer, comparison)
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
    nulls, start = library.nulls_of(name), comparison.whitened
    keys = [k for k in library.fitted_parameters(name) if not spec((name, k)).auxiliary]
    specs = [spec((name, k)) for k in keys]
    steps = np.array([CLEAR * s.matters for s in specs])
    wide = np.array([s.prior_sd or s.upper - s.lower for s in specs])
    moved = [laid_on(name, nulls | {k: nulls[k] + h}, layer, comparison) for k, h in zip(keys, steps, strict=True)]
    ways = np.stack([start - comparison.distance(t.moved) for t in moved], axis=1)
    times = np.linalg.solve(ways.T @ ways + np.diag((steps / wide) ** 2), ways.T @ start)
    values = [float(np.clip(s.null + n * h, s.lower, s.upper)) for s, n, h in zip(specs, times, steps, strict=True)]
    return nulls | dict(zip(keys, values, strict=True))


def laid_on(name, parameters, layer, comparison):
    """Return the Trial of an effect with parameters."""
    moved = layer.move(name, parameters)
    distance = comparison.distance(moved)
    return Trial(
        name,
        layer.sign < 0,
        parameters,
        float(distance @ distance) + CHARGE * len(library.fitted_parameters(name)),
        moved,
        {},
    )


def refined(trial, layer, comparison):
    """Return a Trial with its effect's parameters fitted."""
    name, keys = trial.effect, library.fitted_parameters(trial.effect)
    specs = [spec((name, k)) for k in keys]
    lower, upper = bounds_of([(name, k) for k in keys])
    null, unit = np.array([s.null for s in specs]), np.array([s.matters for s in specs])
    start = np.clip([trial.parameters[k] for k in keys], lower + 1e-6 * unit, upper - 1e-6 * unit)

    def left(values):
        parameters = trial.parameters | dict(zip(keys, values * unit, strict=True))
        pull = (values * unit - null) / (upper - lower)
        return np.concatenate([comparison.distance(layer.move(name, parameters)), pull])

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
    """Return ([SignatureChange], p of what is left, Compared with them laid on) from photographs (signature.Photograph) of
    one set to another's.

    ``uncounted`` are names of signs that are not compared. Sets are large enough (``why_not_comparable``).
    """
    with each_by(threads) as each:
        return _changes((before, after), candidates, seed_of("signatures", seed_name), each, uncounted)


def least_seen_of(comparison, before, after, found, candidates, threads=1):
    """Return {effect: as power.least_seen} of what ``signature_changes`` of the same arguments has not found."""
    known = {name for change in found for name in (change.effect, *change.one_of)}
    with each_by(threads) as each:
        layer = Layer(
            thinned(before, LAID_FOR_POWER), [effect for c in found if not c.less for effect in c.laid], 1, each
        )

        def power(name, parameters):
            return comparison.power(layer.move(name, parameters), MAX_P)

        names = [n for n in competing((before, after), candidates) if n not in known]
        return {n: least_seen(n, partial(power, n)) for n in names}


@contextmanager
def each_by(threads):
    """Give what maps, as map does, on so many threads."""
    with ThreadPoolExecutor(threads) as pool:
        yield pool.map if threads > 1 else map


def competing(sets, candidates):
    """Return the names of the effects, of ``candidates`` or of all, that can be laid on both sets' photographs."""
    in_colour = all(p.image.shape[2] > 1 for photographs in sets for p in photographs)
    return candidates_of(candidates or sorted(library.available_effects()), in_colour)


def _changes(sets, candidates, seed, each, uncounted):
    found, laid, at_first = [], ([], []), None
    signatures = [signatures_of(photographs, (), each) for photographs in sets]
    poses = np.array([p.pose for photographs in sets for p in photographs])
    names = competing(sets, candidates)
    ways = ways_of(names, sets, each)
    while True:
        comparison = compared(*signatures, seed, poses, uncounted, ways)
        total = float(comparison.whitened @ comparison.whitened)
        at_first = at_first or total
        little = bool(found) and total - len(comparison.counted) < CLOSED * at_first
        if comparison.p > MAX_P or little or len(found) == MAX_CHANGES:
            return found, 1.0 if little else comparison.p, comparison
        change = _named(sets, laid, names, comparison, total, each)
        if change is None:
            return found, comparison.p, comparison
        found.append(change)
        laid[change.less].extend(change.laid)
        moved = signatures_of(sets[change.less], laid[change.less], each)
        if change.less and library.is_before_sensor(change.effect):
            moved[:, AFTER_LENS] = signatures[True][:, AFTER_LENS]
        signatures[change.less] = moved
        names = [n for n in names if n != change.effect]


def ways_of(names, sets, each):
    """Return the moves (d, len(SIGNS)) of signatures by clear amounts of some effects.

    They are laid on photographs of which nobody is told the set: chance would lead the other way from those of one set.
    """
    every = sorted((p for photographs in sets for p in photographs), key=lambda p: (p.view.capture, *p.pose))
    layer = Layer(every, [], 1, each)
    return [layer.move(n, p) for n in names for p in clear_ones(n)]


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
    if not ranked or total - ranked[0].left < MOST * (total - k):
        return None
    best = ranked[0]
    alike = [t.effect for t in ranked[1:] if t.left < TWICE * best.left]
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
