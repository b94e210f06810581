"""The second look at photographs of a board: with lens and poses from its points, what do its cells tell of the camera?

Points tell where light lands; signatures (gap.signatures) tell what became of it, against those of an ideal camera in each
photograph's own pose and light. Both looks make one record: gaps are the root mean square over the groups of both.
"""

import numpy as np

from case_files import load_patches
from effects import library
from gap.explain.ladder import RESAMPLES
from gap.fit.score import gap_error, group_gaps, root_mean_square
from gap.select.select_effects import verdict
from gap.signatures.signature_case import is_seen_in_cells
from job import seed_of

ONLY_REPEATS = "only repeats of a station would tell it from noise"
LIKE_LIGHT = "each photograph's own light, exposure and white balance would show the same"
OF_THE_SCENE = "the board's place, light and shades are taken as each photograph shows them"
NO_COLOURS = "the photographs have no colours"
DECLARED = "the photographs' files say it themselves"
PREDICTIONS_EACH = 8  # of a budget, that one of a signature counts for


def look_at_patches(files, points, outcome, candidates, fixed, declared, budget, threads, progress, store):
    """Return (Search, base Twin, candidates of the first step, Outcome, {effect: why it does not compete}) of a board's patches.

    files (expand, register_json, camera, patches.npz); points is the BoardCase, outcome where its search ended; fixed
    {(effect, parameter)} what the user fixed of the twin as configured; declared {capture: effects} what photographs' files say.
    Raises ValueError where too little of the board can be measured.
    """
    case = load_patches(*files, points, outcome.twin, declared)
    configured = [(n, p) for n, p in outcome.twin.effects if is_seen_in_cells(n)]
    names, why = competing(case, candidates, {name for effects in declared.values() for name, _ in effects})
    return *verdict(
        case, configured, names, fixed, budget / PREDICTIONS_EACH / case.effort, threads, progress, store
    ), why


def competing(case, names, declared):
    """Return (names of effects that can compete, {name: why it does not} of the others) of a SignatureCase."""
    in_colour = all(twin.in_colour for twin in case.twins)
    why = {n: OF_THE_SCENE for n in names if not is_seen_in_cells(n)}
    why |= {n: NO_COLOURS for n in names if library.needs_colour(n) and not in_colour}
    why |= {n: DECLARED for n in declared if n in names}
    why |= {n: ONLY_REPEATS for n in names if library.needs_repeats(n)}
    why |= {n: LIKE_LIGHT for n in names if n not in why and case.is_like_light(n)}
    return [n for n in names if n not in why], why


def both_looks(first, second, gaps):
    """Return the record of both looks, ``first`` of the points and ``second`` of the patches, with the ``gaps_on_the_way``."""
    told = [
        record | {"gap_before": before.value, "gap_after": after.value, "gap_after_se": after.error}
        for record, before, after in zip([*first["steps"], *second["steps"]], gaps[:-1], gaps[1:], strict=True)
    ]
    open_ones = "unexplained" in (first["verdict"], second["verdict"])
    return first | {
        "verdict": "unexplained" if open_ones else "explained" if told else "adequate",
        "gap": gaps[-1].value,
        "gap_se": gaps[-1].error,
        "gap_as_configured": gaps[0].value,
        "groups": gaps[-1].groups,
        "floor": second["floor"] | first["floor"],
        "steps": told,
        "candidates": _numbered(first["candidates"], second["candidates"]),
        "candidates_left": _numbered(first["candidates_left"], second["candidates_left"]),
        "not_told": [*first["not_told"], *second["not_told"]],  # what competes in one look does not in the other
        "needs": [*first["needs"], *second["needs"]],
        "within_budget": first["within_budget"] and second["within_budget"],
        "where": [] if first["verdict"] == "adequate" else first["where"],  # it is told of points
        "points": {k: first[k] for k in ("verdict", "gap", "gap_se", "gap_as_configured", "groups")},
    }


def gaps_on_the_way(base, outcome, own, closer):
    """Return the Gaps of the twin as configured, and after each step of the points, then of the patches.

    base Twin and Outcome ``outcome`` are of the points, ``own`` and ``closer`` of the patches.
    """
    of_points = [base.groups, *(step.twin.groups for step in outcome.steps)]
    of_patches = [own.groups, *(step.twin.groups for step in closer.steps)]
    way = [(groups, of_patches[0]) for groups in of_points] + [(of_points[-1], groups) for groups in of_patches[1:]]
    return [Gap(points, outcome.twin.floors, patches, closer.twin.floors) for points, patches in way]


class Gap:
    """The gap of two looks: the root mean square over the groups of points and of patches, each in its floors."""

    def __init__(self, points, floors, patches, floors_of_patches):
        self.looks = (points, floors), (patches, floors_of_patches)
        self.groups = group_gaps(points, floors) | group_gaps(patches, floors_of_patches)

    @property
    def value(self):
        """The gap."""
        return root_mean_square(self.groups.values())

    @property
    def error(self):
        """Its standard error: those of both looks by themselves."""
        sums = [len(g := group_gaps(*look)) * root_mean_square(g.values()) * gap_error(*look) for look in self.looks]
        return float(np.hypot(*sums) / (len(self.groups) * self.value))

    def interval(self, seed):
        """Return its 95 % percentile interval by resampling the photographs of each look."""
        rng, draws = np.random.default_rng(seed_of(seed)), []
        for _ in range(RESAMPLES):
            groups = {}
            for found, floors in self.looks:
                drawn = rng.choice(list(found), len(found))
                groups |= group_gaps({n: found[k] for n, k in enumerate(drawn)}, floors)
            draws.append(root_mean_square(groups.values()))
        return tuple(float(v) for v in np.percentile(draws, [2.5, 97.5]))


def rows_of_both(rows, name, steps, gaps):
    """Return the ladder's rows of the points, and one for each of ``steps``, names of effects that patches showed.

    gaps are those ``gaps_on_the_way``: the last rows' and steps'. Where points land is the same for all steps of the patches.
    """
    last = rows[-1]
    rows = [*rows, *(last | {"step": last["step"] + k, "effect": effect} for k, effect in enumerate(steps, 1))]
    gaps = [gaps[0]] * (len(rows) - len(gaps)) + gaps
    out = []
    for row, gap in zip(rows, gaps, strict=True):
        low, high = gap.interval(f"{name}/{row['step']}")
        out.append(row | {"gap": gap.value, "gap_floor": 1.0, "gap_low": low, "gap_high": high})
    return out


def _numbered(first, second):
    return [c | {"rank": k + 1} for k, c in enumerate([*first, *second])]
