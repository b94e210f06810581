"""One camera's photographs of a calibration board as a problem: points are all that is measured, poses may be free.

What the points show is told by exact maps, so nothing is drawn; only effects that move image points can be seen. Without
repeats the floor is what is left about smooth maps.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from effects import library, pipeline
from effects.base import View
from gap.boards.readout_motion import by_motion, distance_m, usual_turn_rad, when_read
from gap.boards.whole_lens import with_whole_lens
from gap.fit.residuals import NU, flatten, robust_scale_of
from gap.measure.capture import Observation
from gap.predict.predictor import Prediction
from gap.problem import Capture, Case
from rig.geometry import N_POSE, camera_matrix, make_pose

FEWEST_POINTS = 24  # of a view whose noise can be told
USUAL_NOISE_PX, SMALLEST_NOISE_PX = 0.2, 0.02  # where no view has enough points; what no finder is better than
SCALED_PX = 1e-6  # off a scaling about the principal point, up to which a map is one
# Where another focal length is told apart from an effect: any view with the ground in sight
SOME_VIEW = View(
    K=camera_matrix(600.0, 600.0, 320.0, 240.0), width=640, height=480, margin=0,
    T_cam_world=make_pose([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]), camera="", capture="", station="",
)  # fmt: skip


@dataclass
class BoardCase(Case):
    """Photographs of a board whose points (p, 3), metres, are what a rig's plates are: a point has one corner.

    Poses are about those of the captures' views, free where ``sigma_pose`` is infinite.
    """

    points: np.ndarray = None
    noise_px: float = None  # standard deviation of a point's x and y: the floor
    gap_at_rest: float = None  # floors, left where no photograph moves while it is read; None where none does
    is_board = True
    corner_numbers = 2
    state_features = np.arange(2)
    most_captures = most_held_out = 1000  # points cost next to nothing
    draws = False
    floor_within = 2.0  # corner noise varies over the image, and from photograph to photograph

    def scene_of(self, effects):
        """Return (scene, points (p, 1, 3)) of the twin with these effects."""
        scene = pipeline.scene_with_effects(self.scene, effects)
        return scene, on_board(scene, self.scene, self.points)[:, None]

    def states(self, corners, effects):
        """Return the states (p, 2) of points (p, 1, 2): their pixels."""
        return corners[:, 0]

    def places(self):
        """Return (names, places (p, 3), normals (p, 3)) of the points, metres."""
        return [str(k) for k in range(len(self.points))], self.points, np.tile([0.0, 0.0, 1.0], (len(self.points), 1))

    def predictor(self, noise_of=()):
        """Return what predicts the photographs; there is no noise to compare."""
        return PointPredictor(self)

    @property
    def moving_numbers(self):
        """How many numbers a photograph has for itself: its pose, and how that moves while rows are read, where it may."""
        return len(self.sigma_pose)

    def moving(self, search, twin):
        """Return the BoardCase whose photographs move while they are read, each otherwise; None where what a Search's Twin leaves
        is no likelier so.
        """
        whole, train = with_whole_lens(search, twin), search.train
        groups = search.solver.residuals_of(whole.effects, whole.poses, train)
        derivatives = search.solver.derivatives(whole.effects, [], whole.poses, train)
        equations = {i: (flatten(groups[i]), *derivatives[i]) for i in train}
        turn_rad = usual_turn_rad(by_motion(self, equations), equations, NU * robust_scale_of(groups) ** 2)
        if not turn_rad:
            return None
        away_m = np.median([distance_m(self, capture) for capture in self.captures])
        sigma_motion = turn_rad * np.repeat([1.0, away_m], 3)
        return replace(self, sigma_pose=np.append(self.sigma_pose, sigma_motion), gap_at_rest=twin.gap)

    def corners_at(self, capture, effects, deltas, points=None):
        """Return the pixels [(p, k, 2)] of ``corners_of`` at several poses [(6,)], or [(12,)] that go on by the last six numbers
        from the first row to the last.
        """
        at = super().corners_at
        if self.moving_numbers == N_POSE:
            return at(capture, effects, deltas, points)
        poses, moves = np.split(np.array(deltas), 2, axis=1)
        here, first, last = (at(capture, effects, list(poses + s * moves), points) for s in (0.0, -0.5, 0.5))
        when = [when_read(pixels[..., 1:], capture.view.height) for pixels in here]
        return [h + w * (b - a) for h, w, a, b in zip(here, when, first, last, strict=True)]

    def corners_by_pose(self, capture, effects, delta):
        """Return d ``corners_of`` (p, 1, 2, 6 or 12) / d pose."""
        moves = super().corners_by_pose(capture, effects, delta)
        if self.moving_numbers == N_POSE:
            return moves
        rows = self.corners_of(capture, effects, delta)[..., 1]
        return np.concatenate([moves, when_read(rows, capture.view.height)[..., None, None] * moves], axis=-1)


class PointPredictor:
    """Predicts a board's points by exact maps: as gap.predict.predictor.Predictor, but nothing of an image."""

    noise_of = frozenset()

    def __init__(self, problem):
        self.problem = problem

    def predict(self, i, effects, pose):
        """Return the Prediction of capture i with the pose (6,) by a twin of some effects [(name, parameters)]."""
        points = self.problem.corners_of(self.problem.captures[i], effects, pose)[:, 0]
        return Prediction(points, np.isfinite(points).all(1), points[:, :0], np.zeros(0), None)

    def shown(self, i, effects, pose):
        """Return the ShownPoints of capture i."""
        return ShownPoints(self, i, effects, pose)


class ShownPoints:
    """The points of one capture as a twin shows them."""

    def __init__(self, predictor, i, effects, pose):
        self.predictor, self.i, self.pose = predictor, i, pose
        self.prediction = predictor.predict(i, effects, pose)

    def change(self, effects, by_response=True):
        """Return the Prediction's change where the effects become others."""
        after, before = self.predictor.predict(self.i, effects, self.pose), self.prediction
        measured = before.measured & after.measured
        return Prediction(after.features - before.features, measured, before.colour, before.field, None)


def board_case(campaign, camera, scene, views, trials, points, pixels, noise_px, knows_intrinsics, sigma_pose):
    """Return the BoardCase of views [effects.base.View], each at the pose from which its fit starts.

    trials [repeat number]; points (p, 3) of the board, metres; pixels (views, p, 2) where each view shows them, NaN where it
    does not; noise_px their standard deviation per axis; sigma_pose (6,) as of Case.
    """
    captures = [Capture(v, t, observation_of(xy, noise_px)) for v, t, xy in zip(views, trials, pixels, strict=True)]
    focal = [] if knows_intrinsics else [n for n in seen_by_points(library.available_effects()) if scales_alone(n)]
    nuisances = tuple((n, library.nulls_of(n)) for n in focal[:1])
    return BoardCase(
        campaign, camera, scene, None, captures, sigma_pose, points=points, nuisances=nuisances, noise_px=noise_px
    )


def observation_of(pixels, noise_px):
    """Return the Observation of points (p, 2), NaN where they are not seen."""
    p, none = len(pixels), np.zeros(0)
    information = np.tile(np.eye(2) / noise_px**2, (p, 1, 1))
    measured = np.isfinite(pixels).all(1)
    return Observation(pixels, information, measured, np.zeros((p, 0)), np.zeros((0, 4), int), *[none] * 4)


def local_noise_px(points, pixels, taken_out=0):
    """Return the standard deviation per axis of a board's points (views, p, 2) about a smooth map of each view, pixels.

    points (p, 3), metres; pixels NaN where a point is not seen; ``taken_out`` numbers of each axis of a view are out of them.
    """
    squares, freedom = 0.0, 0
    for _, _, residual, terms in _about_smooth_maps(points, pixels):
        deviation = 1.4826 * np.median(np.abs(residual - np.median(residual, 0)), axis=0)
        squares += (deviation**2).mean() * len(residual)
        freedom += len(residual) - terms - taken_out
    return max(float(np.sqrt(squares / freedom)) if freedom else USUAL_NOISE_PX, SMALLEST_NOISE_PX)


def without_alternation(points, pixels, square_m):
    """Return pixels (views, p, 2) of a checkerboard's corners less what they alternate by from square to square in each view.

    A finder puts corners of a blurred image to opposite sides by where their black lies; no lens, paper or pose does that.
    """
    sign = 1 - 2 * (np.rint((points[:, :2] - points[0, :2]) / square_m).sum(1, keepdims=True) % 2)
    pixels = pixels.copy()
    for k, seen, residual, _ in _about_smooth_maps(points, pixels):
        pixels[k, seen] -= sign[seen] * np.median(sign[seen] * residual, axis=0)
    return pixels


def without_pixel_locking(points, pixels, straight):
    """Return pixels (views, p, 2) of a board's points less what their finder leans to the grid of pixels; ``straight`` are they
    without the lens's distortion.

    A finder that interpolates is off by a sine of where between two pixels a point lies, the more the sharper images are: one
    amplitude for all views and both axes. Source: M. Shimizu and M. Okutomi, "Sub-pixel estimation error cancellation on
    area-based matching" (2005).
    """
    sines, amplitudes = np.sin(2 * np.pi * pixels), []
    for k, seen, residual, terms in _about_smooth_maps(points, straight):
        left = 1 - terms / len(residual)  # of a sine, when a smooth map took up its share
        amplitudes.append(2 * (sines[k, seen] * residual).mean() / left)
    return pixels - sines * (np.median(amplitudes) if amplitudes else 0.0)


def _about_smooth_maps(points, pixels):
    """Yield (index, seen (p,), pixels about a smooth map (n, 2), its terms' number) of each view of points that shows enough.

    A cubic polynomial in the coordinates that a homography predicts takes up pose, paper and what a lens leaves.
    """
    for k, xy in enumerate(pixels):
        seen = np.isfinite(xy).all(1)
        H = cv2.findHomography(points[seen, :2], xy[seen])[0] if seen.sum() >= FEWEST_POINTS else None
        if H is not None:  # there is none of points on one line
            mapped = cv2.perspectiveTransform(points[None, seen, :2], H)[0]
            terms = polynomial_terms((mapped - mapped.mean(0)) / max(mapped.std(), 1e-9), 3)
            yield k, seen, xy[seen] - terms @ np.linalg.lstsq(terms, xy[seen], rcond=None)[0], terms.shape[1]


def polynomial_terms(xy, order):
    """Return the terms (n, k) of a polynomial of an order in x and y (n, 2)."""
    x, y = xy.T
    return np.stack([x**i * y**j for i in range(order + 1) for j in range(order + 1 - i)], axis=1)


def on_board(scene, nominal, points):
    """Return where a scene's board has the nominal points (..., 3) of its print, metres: its lines moved, its paper bent."""
    if scene is nominal:
        return points
    (plate,), (before,) = scene.plates, nominal.plates
    lines = (before.x_m, plate.x_m), (before.y_m, plate.y_m)
    return plate.to_world(np.stack([np.interp(points[..., k], *lines[k]) for k in (0, 1)], axis=-1))


def seen_by_points(names):
    """Return those of some effects that points can show: maps of image points, and what changes a board's shape."""
    return [n for n in names if library.is_pure_geometry(n) and (library.moves_points(n) or library.is_of_boards(n))]


def scales_alone(name):
    """Return whether all that an effect does is to scale the image about the principal point: another focal length."""
    if not library.moves_points(name):
        return False
    xy = np.stack(np.meshgrid([20.0, 150.0, 500.0], [30.0, 300.0, 460.0]), axis=-1).reshape(-1, 2)
    away = xy - SOME_VIEW.K[:2, 2]
    for key, p in library.parameters_of(name).items():
        moved = pipeline.map_points(xy, SOME_VIEW, [(name, {key: p.null + p.matters})]) - xy
        scale = (moved * away).sum() / (away * away).sum()
        if np.abs(moved - scale * away).max() > SCALED_PX:
            return False
    return True
