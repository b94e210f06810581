"""The whole lens of a board's photographs: with what is too small for a name, fitted as a calibration fits it.

A name must close a good part of what is left, as the floor is known to a factor of two; who undistorts or exports a lens
wants its small terms as well.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from effects import library
from gap.bounds import MAX_PARAMETERS
from gap.select.search import Search
from rig.geometry import N_POSE

MAX_FITS = 3  # of a lens that does not come to rest in one
WIDER = 2.0  # times what is left of points: least squares, as a calibration's, for all but corners that are wrong


def with_whole_lens(search, twin):
    """Return the Twin of a BoardCase with all effects of the lens beside those that it has, fitted to the same photographs.

    Points scatter by the twin's gap more than they are noisy: else the robust loss would take for outliers what the board's
    shape adds.
    """
    lens = [n for n in search.candidates if library.is_of_lens(n) and n not in twin.names]
    lens = [(n, library.nulls_of(n)) for n in lens if len(library.parameters_of(n)) <= MAX_PARAMETERS]
    scattered = _scattered(search.problem, WIDER * max(twin.gap, 1.0))
    wide = Search(scattered, search.candidates, search.fixed, (search.train, search.test), search.threads)
    whole = wide.fitted([*twin.effects, *lens], twin.poses)
    for _ in range(MAX_FITS - 1):
        further = whole if whole.converged else wide.fitted(whole.effects, whole.poses)
        if further.loss >= whole.loss:
            break
        whole = further
    return whole


def _scattered(problem, factor):
    """Return a BoardCase whose points scatter by a factor more."""
    captures = [
        replace(c, observation=replace(c.observation, information=c.observation.information / factor**2))
        for c in problem.captures
    ]
    return replace(problem, captures=captures)


def left_out_px(search, twin):
    """Return the RMS length, pixels, of what a Twin's left-out photographs of a board lie off, poses by least squares."""
    off = np.concatenate([_off_px(search.problem, i, list(twin.effects), twin.poses[i]) for i in search.test])
    return float(np.sqrt((off**2).sum(1).mean()))


def _off_px(problem, i, effects, pose):
    """Return by how much the points (n, 2) that capture i shows lie off, its pose fitted from a first one (6 or 12,)."""
    capture = problem.captures[i]
    seen, shown = capture.observation.measured, capture.observation.features

    def off(moved):
        there = problem.corners_of(capture, effects, np.append(moved, pose[N_POSE:]))[:, 0]
        return (shown - there)[seen].ravel()

    return off(least_squares(off, pose[:N_POSE], x_scale="jac").x).reshape(-1, 2)


def whole_lens_record(search, twin):
    """Return what the result file says of the whole lens beside a Twin whose effects were named (dict).

    Of few photographs small terms may be noise: then they are left away.
    """
    whole = with_whole_lens(search, twin)
    off_px, off_px_of_named = (left_out_px(search, t) for t in (whole, twin))
    best = whole if off_px < off_px_of_named else twin
    return {
        "effects": [{"effect": name, "parameters": best.told(name)} for name in best.names],
        "too_small_for_a_name": [n for n in best.names if n not in twin.names],
        "left_out_px": off_px,
        "left_out_px_of_named": off_px_of_named,
    }
