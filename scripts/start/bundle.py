"""Bundle adjustment: where markers lie, where photographs were taken from and what the cameras are like, all at once.

Unknown are each camera's focal length, principal point, k1, k2 and how square its pixels are, each photograph's pose, and each
marker's pose but one's: the world is that marker's frame, and the printed side of a marker is the unit (Triggs et al.,
Bundle Adjustment: A Modern Synthesis, 2000). Detected corners lie too far within the dark by some tenths of a pixel; how
far is one more unknown, as it would pass for a smaller print.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from register.registration import huber_but_prior
from rig.plates import marker_corners_plate

CAMERA = ("log_f", "cx", "cy", "k1", "k2", "inset_px", "aspect")  # cx, cy from the centre, in units of the longer side
PRIOR = (
    np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0]),
    np.array([1.0, 0.02, 0.02, 0.3, 0.5, 0.1, 0.002]),
)  # mean and deviation
HUBER = 2.0  # standard deviations; less than of a pose alone: a marker that moved must not pull cameras along
MIN_SIGMA_PX = 0.02
ROUNDS = 3  # each from the last one's poses, with the scatter that it has shown
BEHIND_PX = 1e3
TIGHT = {
    "atol": 1e-12,
    "btol": 1e-12,
    "maxiter": 5000,
}  # poses and focal length hang together: loosely solved, a step leads nowhere
STEP = 1e-6  # of the derivatives: radians, metres, ratios


@dataclass(frozen=True)
class Sightings:
    """Markers seen in photographs.

    sizes   (width, height) of each camera's images; camera (photographs,) the camera of each
    view, marker  (n,) which photograph shows which marker; quads (n, 4, 2) its corners, pixels
    """

    sizes: tuple
    camera: np.ndarray
    view: np.ndarray
    marker: np.ndarray
    quads: np.ndarray

    def select(self, which):
        """Return some of the sightings, by a bool array (n,)."""
        return replace(self, view=self.view[which], marker=self.marker[which], quads=self.quads[which])


@dataclass(frozen=True)
class Scene:
    """What is estimated: cameras (cameras, 7) as in CAMERA, T_cam_world (photographs, 4, 4), T_world_marker (markers, 4, 4)."""

    cameras: np.ndarray
    T_cam_world: np.ndarray
    T_world_marker: np.ndarray


@dataclass(frozen=True)
class Adjusted:
    """A fitted scene.

    errors_px  (n, 4, 2) what is left; sigma_px its scatter along an axis; cost the robust sum of squares
    se         (markers, 6) standard errors: turns about the world's axes in radians, centres in metres; NaN where unknown
    se_cameras (cameras, 7)
    """

    scene: Scene
    errors_px: np.ndarray
    sigma_px: float
    cost: float
    se: np.ndarray
    se_cameras: np.ndarray


def adjust(sightings, side_m, scene, fixed, flat, rounds=ROUNDS, most_steps=60):
    """Return the Adjusted scene that fits best, robustly (Huber 1964), from a first one.

    side_m  printed side of all markers, metres; ``fixed`` is the marker whose pose stays
    flat    whether all markers lie in one plane, that of the fixed one: they then turn about z and shift along x and y only
    """
    free = (2, 3, 4) if flat else (0, 1, 2, 3, 4, 5)
    layout = _Layout(sightings, len(scene.cameras), len(scene.T_cam_world), len(scene.T_world_marker), fixed, free)
    sigma_px, fit = 1.0, None
    for _ in range(rounds):
        start = np.concatenate([scene.cameras.ravel(), np.zeros(layout.count - scene.cameras.size)])
        fit = least_squares(
            layout.residuals, start, layout.derivatives, args=(scene, side_m, sigma_px), x_scale="jac",
            loss=lambda z: huber_but_prior(z, 8 * len(sightings.view), HUBER),
            tr_solver="lsmr", tr_options=TIGHT, max_nfev=most_steps, ftol=1e-8, xtol=1e-10, gtol=1e-8,
        )  # fmt: skip
        scene = layout.moved(fit.x, scene)
        errors = _errors_px(sightings, side_m, scene)
        used, spare = errors.size, errors.size - layout.count + scene.cameras.size
        sigma_px = 1.4826 * np.median(np.abs(errors)) * np.sqrt(used / max(spare, 0.1 * used))
        sigma_px = max(float(sigma_px), MIN_SIGMA_PX)
    se = _standard_errors(layout, scene, side_m, sigma_px)
    return Adjusted(scene, errors, sigma_px, float(fit.cost), se[1], se[0])


def project(sightings, side_m, scene):
    """Return where the corners (n, 4, 2) of all sightings are expected, pixels; NaN behind the camera."""
    T = scene.T_cam_world[sightings.view] @ scene.T_world_marker[sightings.marker]
    points = marker_corners_plate(side_m) @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    z = np.where(points[..., 2] > 1e-9, points[..., 2], np.nan)
    xy = points[..., :2] / z[..., None]
    of_view = scene.cameras[sightings.camera[sightings.view]]
    size = np.array(sightings.sizes, float)[sightings.camera[sightings.view]]
    longer = size.max(axis=1)[:, None]
    r2 = (xy**2).sum(axis=-1)
    bent = xy * (1 + of_view[:, 3, None] * r2 + of_view[:, 4, None] * r2**2)[..., None]
    focal = (np.exp(of_view[:, :1]) * longer * np.stack([np.ones(len(of_view)), 1 + of_view[:, 6]], axis=1))[:, None]
    seen = focal * bent + ((size - 1) / 2 + of_view[:, 1:3] * longer)[:, None]
    return _inset(seen, of_view[:, 5])


def _inset(quads, inset_px):
    """Return quads (n, 4, 2) whose edges are moved inwards by ``inset_px`` (n,)."""
    ahead, behind = np.roll(quads, -1, axis=1) - quads, np.roll(quads, 1, axis=1) - quads
    u, v = (e / np.maximum(np.linalg.norm(e, axis=-1, keepdims=True), 1e-9) for e in (ahead, behind))
    sine = np.maximum(np.abs(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]), 0.1)
    return quads + (inset_px[:, None] / sine)[..., None] * (u + v)


def _errors_px(sightings, side_m, scene):
    return np.nan_to_num(project(sightings, side_m, scene) - sightings.quads, nan=BEHIND_PX)


class _Layout:
    """Where in the vector of unknowns each camera, photograph and marker has its own."""

    def __init__(self, sightings, cameras, views, markers, fixed, free):
        self.sightings, self.cameras, self.views, self.free = sightings, cameras, views, list(free)
        self.first_view = cameras * len(CAMERA)
        self.first_marker = self.first_view + 6 * views
        loose = np.delete(np.arange(markers), fixed)
        self.place = np.full(markers, -1)
        self.place[loose] = np.arange(len(loose))
        self.loose, self.count = loose, self.first_marker + len(free) * len(loose)

    def moved(self, p, base):
        """Return the scene of a vector of unknowns: cameras as they are, poses moved from those of ``base``."""
        steps = np.zeros((len(base.T_world_marker), 6))
        steps[np.ix_(self.loose, self.free)] = p[self.first_marker :].reshape(-1, len(self.free))
        marker = base.T_world_marker.copy()
        marker[:, :3, :3] = Rotation.from_rotvec(steps[:, :3]).as_matrix() @ marker[:, :3, :3]  # about its own centre
        marker[:, :3, 3] += steps[:, 3:]
        steps = p[self.first_view : self.first_marker].reshape(-1, 6)
        R = Rotation.from_rotvec(steps[:, :3]).as_matrix()
        view = base.T_cam_world.copy()
        view[:, :3, :3] = R @ view[:, :3, :3]
        view[:, :3, 3] = (R @ base.T_cam_world[:, :3, 3, None])[..., 0] + steps[:, 3:]
        return Scene(p[: self.first_view].reshape(-1, len(CAMERA)), view, marker)

    def residuals(self, p, base, side_m, sigma_px):
        """Return the residuals in standard deviations: of corners, then of what is known of cameras beforehand."""
        scene = self.moved(p, base)
        prior = (scene.cameras - PRIOR[0]) / PRIOR[1]
        return np.concatenate([_errors_px(self.sightings, side_m, scene).ravel() / sigma_px, prior.ravel()])

    def derivatives(self, p, base, side_m, sigma_px):
        """Return the derivatives (residuals, unknowns), sparse, by central differences.

        All cameras', photographs' or markers' k-th unknowns are moved at once: no corner depends on two of a kind.
        """
        s, kinds = self.sightings, []
        for first, last, width, owner in self._kinds():
            for k in range(width):
                step = np.zeros(self.count)
                step[first + k : last : width] = STEP
                ends = [_errors_px(s, side_m, self.moved(p + d, base)) for d in (step, -step)]
                change = (ends[0] - ends[1]).reshape(len(s.view), 8) / (2 * STEP * sigma_px)
                kinds.append((np.where(owner < 0, -1, first + width * owner + k), change))
        columns = np.concatenate([np.repeat(column, 8) for column, _ in kinds])
        rows = np.tile(np.arange(8 * len(s.view)), len(kinds))
        values = np.concatenate([change.ravel() for _, change in kinds])
        own = np.arange(self.first_view)
        there = columns >= 0
        rows = np.concatenate([rows[there], 8 * len(s.view) + own])
        columns = np.concatenate([columns[there], own])
        values = np.concatenate([values[there], np.tile(1 / PRIOR[1], self.cameras)])
        return csr_matrix((values, (rows, columns)), shape=(8 * len(s.view) + len(own), self.count))

    def _kinds(self):
        """Return [(first unknown, last, how many each has, (n,) whose a sighting is, -1 for nobody's)] of the three kinds."""
        s = self.sightings
        return [
            (0, self.first_view, len(CAMERA), s.camera[s.view]),
            (self.first_view, self.first_marker, 6, s.view),
            (self.first_marker, self.count, len(self.free), self.place[s.marker]),
        ]


def _standard_errors(layout, scene, side_m, sigma_px):
    """Return standard errors of (cameras (cameras, 7), markers (markers, 6)).

    The larger of two: what corners of independent errors would give, and what photographs of errors of their own do (the
    clustered sandwich; White 1980, Liang and Zeger 1986). A bent paper or lens errs alike at the corners of one photograph.
    """
    zero = np.concatenate([scene.cameras.ravel(), np.zeros(layout.count - layout.first_view)])
    J = layout.derivatives(zero, scene, side_m, sigma_px)
    r = layout.residuals(zero, scene, side_m, sigma_px)
    weight = np.ones(len(r))
    corners = 8 * len(layout.sightings.view)
    weight[:corners] = np.minimum(1, HUBER / np.maximum(np.abs(r[:corners]), HUBER))
    weighted = J.multiply(weight[:, None]).tocsr()
    covariance = np.linalg.pinv((J.T @ weighted).toarray(), hermitian=True)
    views = np.repeat(layout.sightings.view, 8)
    by_view = csr_matrix((np.ones(corners), (views, np.arange(corners))), shape=(layout.views, len(r)))
    scores = (by_view @ weighted.multiply(r[:, None])).toarray()
    seen = len(np.unique(views))
    clustered = ((scores @ covariance) ** 2).sum(axis=0) * seen / max(seen - 1, 1)
    se = np.sqrt(np.maximum(np.maximum(np.diag(covariance), clustered), 0))
    markers = np.zeros((len(scene.T_world_marker), 6))
    markers[np.ix_(layout.loose, layout.free)] = se[layout.first_marker :].reshape(-1, len(layout.free))
    return se[: layout.first_view].reshape(-1, len(CAMERA)), markers
