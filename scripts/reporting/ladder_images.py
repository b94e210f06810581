"""The twins of one camera's ladder, drawn in each capture's own pose: what one compares with the photograph.

At its station a twin is some pixels off a capture (the tolerance), which would hide all else. The pose of a capture is
fitted anew for every twin, to the corners measured in it and under the campaign's prior, as the ladder does.
"""

from dataclasses import dataclass

import numpy as np

from gap.fit.solver import Solver

POSE_STEPS, FIRST_SCALE = 25, 8.0  # iterations of a pose, and how wide the robust loss starts


@dataclass(frozen=True)
class Shown:
    """A twin in one capture's own pose: grey levels (H, W, C), red first, as a camera gives them and as expected; the
    codes' corners (p, 4, 2).
    """

    image: np.ndarray
    expected: np.ndarray
    corners: np.ndarray


def rungs_of(verdict):
    """Return [(effect, [(name, parameters), ...]), ...] of a verdict's record: the ideal twin, then effect by effect.

    Adopted effects come first, then the steps; each rung has all effects up to it, with the final parameters.
    """
    effects, rungs = {}, [("ideal", [])]
    for entry in verdict.get("configured", []):
        effects[entry["effect"]] = entry["parameters"]
        rungs.append((entry["effect"], list(effects.items())))
    for step in verdict["steps"]:
        effects[step["effect"]] = {k: p["value"] for k, p in step["parameters"].items()}
        rungs.append((step["effect"], list(effects.items())))
    return rungs


def chosen(captures, most):
    """Return up to ``most`` names of a captures' table (capture, station, trial): spread evenly, first trials first."""
    ordered = captures.sort_values(["station", "capture"])
    first = ordered.trial == ordered.trial.min()
    names = _spread(ordered.capture[first].tolist(), most)
    return names | _spread(ordered.capture[~first].tolist(), most - len(names))


def _spread(names, most):
    count = max(0, min(most, len(names)))
    return {names[int((k + 0.5) * len(names) / count)] for k in range(count)}


class LadderImages:
    """Draws the rungs of one camera's Case, of which the captures have been measured."""

    def __init__(self, case, rungs, seed_of_capture):
        """``seed_of_capture`` gives the seed of a capture's noise: the same in all rungs, so that only effects differ."""
        self.case, self.rungs, self.seed_of_capture = case, rungs, seed_of_capture
        self.solver = Solver(case)
        self.index = {c.view.capture: i for i, c in enumerate(case.captures)}

    def shown(self, capture, effects):
        """Return the Shown twin with these effects in a capture's own pose."""
        i = self.index[capture]
        start = np.zeros((len(self.case.captures), 6))
        nowhere_off = [np.zeros((len(self.case.scene.plates), 8))] * len(start)
        _, poses = self.solver.fit_geometry(effects, [], start, nowhere_off, [i], FIRST_SCALE, POSE_STEPS)
        taken = self.case.captures[i]
        radiance = self.case.radiance_of(taken, effects, poses[i])
        rng = np.random.default_rng(self.seed_of_capture(capture))
        image = self.case.image_of(radiance, taken, effects, poses[i], rng)
        expected = self.case.image_of(radiance, taken, effects, poses[i])
        return Shown(image, expected, self.case.corners_of(taken, effects, poses[i]))

    def of_capture(self, capture):
        """Return the Shown twins of a capture, one a rung."""
        return [self.shown(capture, effects) for _, effects in self.rungs]

    def measured(self, capture):
        """Return the codes' corners (p, 4, 2) as measured in a capture's photograph, NaN where they were not."""
        o = self.case.captures[self.index[capture]].observation
        corners = np.array(o.corners, float)
        corners[~o.measured] = np.nan
        return corners
