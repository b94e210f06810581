"""Images of tilted markers over clutter with exact corners, and textured images without any marker: the bench's truth.

Written apart from the detectors and from the twin's rendering: linear light, pixels as boxes (12 x 12 samples where
an edge crosses), Gaussian blur, encoding, noise, 8 bits.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from rig.plates import code_cells

FOCAL_PX = 1400.0
MARGIN_MODULES = 1.5  # white paper round the code, as on the plates of the rig


@dataclass(frozen=True)
class Truth:
    """A marker that is in the image: corners (4, 2) in pixels, its code's side in pixels and tilt in degrees."""

    dictionary: str
    id: int
    corners: np.ndarray
    side_px: float
    tilt_deg: float


@njit(cache=True)
def _level(x, y, h, cells, margin, white, black):
    """Return the reflectance at a pixel position; -1 off the plate. h: pixel to code, code from 0 to n."""
    w = h[2, 0] * x + h[2, 1] * y + h[2, 2]
    u = (h[0, 0] * x + h[0, 1] * y + h[0, 2]) / w
    v = (h[1, 0] * x + h[1, 1] * y + h[1, 2]) / w
    n = cells.shape[0]
    if u < -margin or v < -margin or u > n + margin or v > n + margin:
        return -1.0
    if u < 0 or v < 0 or u >= n or v >= n:
        return white
    return white if cells[int(v), int(u)] else black


@njit(cache=True)
def _paint(image, x0, y0, x1, y1, h, cells, margin, white, black):
    """Paint a plate over ``image`` (linear light) by exact-as-needed box sampling."""
    samples = 12
    for y in range(y0, y1):
        for x in range(x0, x1):
            first = _level(x - 0.5, y - 0.5, h, cells, margin, white, black)
            same = True
            for k in range(1, 9):
                q = _level(x - 0.5 + 0.5 * (k % 3), y - 0.5 + 0.5 * (k // 3), h, cells, margin, white, black)
                same = same and q == first
            if same:
                if first >= 0:
                    image[y, x] = first
                continue
            total = 0.0
            for i in range(samples):
                for j in range(samples):
                    px, py = x - 0.5 + (i + 0.5) / samples, y - 0.5 + (j + 0.5) / samples
                    q = _level(px, py, h, cells, margin, white, black)
                    total += q if q >= 0 else image[y, x]
            image[y, x] = total / samples**2


def clutter(rng, height, width, pieces=150):
    """Return linear light (height, width) of overlapping polygons, ellipses, lines and words on a soft gradient."""
    coarse = rng.uniform(0.15, 0.5, (4, 6)).astype(np.float32)
    image = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    for _ in range(pieces):
        centre = rng.uniform((0, 0), (width, height))
        size = rng.uniform(5, 90)
        level = float(rng.uniform(0.02, 0.8))
        kind = rng.integers(4)
        if kind == 0:
            turn = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 7)))
            points = centre + size * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            cv2.fillPoly(image, [points.astype(np.int32)], level, cv2.LINE_AA)
        elif kind == 1:
            axes = tuple(int(v) for v in rng.uniform(2, size, 2) + 1)
            place = tuple(int(v) for v in centre)
            cv2.ellipse(image, place, axes, float(rng.uniform(0, 180)), 0, 360, level, -1)
        elif kind == 2:
            end = tuple(int(v) for v in centre + rng.uniform(-2, 2, 2) * size)
            cv2.line(image, tuple(int(v) for v in centre), end, level, int(rng.integers(1, 8)))
        else:
            word = "".join(rng.choice(list("ABEFHKLMNRTX0123456789#"), 5))
            place = tuple(int(v) for v in centre)
            cv2.putText(image, word, place, cv2.FONT_HERSHEY_SIMPLEX, size / 40, level, int(rng.integers(1, 5)))
    return image


def texture(rng, height, width):
    """Return linear light without a marker: clutter, fractal noise, boards, gratings or random cells."""
    kind = rng.integers(5)
    image = clutter(rng, height, width, int(rng.integers(50, 400)))
    if kind == 1:
        image = np.zeros((height, width), np.float32)
        for octave in range(1, 9):
            n = 2**octave
            coarse = rng.normal(0, 0.5**octave, (n, 2 * n)).astype(np.float32)
            image += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
        image = 0.4 + 0.5 * image
    elif kind == 2:
        step = int(rng.integers(8, 90))
        y, x = np.mgrid[:height, :width]
        image[((x // step) + (y // step)) % 2 == 0] *= 0.1
    elif kind == 3:
        y, x = np.mgrid[:height, :width]
        period, turn = rng.uniform(6, 60), rng.uniform(0, np.pi)
        image = image * (1 + 0.9 * np.sign(np.sin(2 * np.pi * (x * np.cos(turn) + y * np.sin(turn)) / period)))
    elif kind == 4:
        step = int(rng.integers(4, 40))
        cells = rng.uniform(0, 1, (height // step + 1, width // step + 1)) > 0.5
        cells = np.kron(cells, np.ones((step, step)))[:height, :width]
        image = np.where(cells > 0, 0.7, 0.05)
    return np.clip(image, 0.01, 0.95).astype(np.float32)


def encode(rng, light, blur_px, noise_dn, encoding="srgb"):
    """Return the uint8 image of linear light: blurred in light, encoded, noise added, rounded."""
    if blur_px > 0:
        light = cv2.GaussianBlur(light, (0, 0), blur_px, borderType=cv2.BORDER_REPLICATE)
    value = light
    if encoding == "srgb":
        value = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    noise = rng.normal(0, noise_dn, light.shape) if noise_dn > 0 else 0
    return np.clip(np.rint(255 * value + noise), 0, 255).astype(np.uint8)


def _pose(rng, side_px, tilt_deg, centre, width, height):
    """Return the code's corners (4, 2) of a marker of that frontal side, tilt about a random axis and random roll."""
    axis = rng.uniform(0, 2 * np.pi)
    tilt = Rotation.from_rotvec(np.radians(tilt_deg) * np.array([np.cos(axis), np.sin(axis), 0]))
    roll = Rotation.from_rotvec([0, 0, rng.uniform(0, 2 * np.pi)])
    square = 0.5 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    depth = FOCAL_PX / side_px
    ray = np.array([(centre[0] - width / 2) / FOCAL_PX, (centre[1] - height / 2) / FOCAL_PX, 1])
    points = (tilt * roll).apply(square) + depth * ray
    return FOCAL_PX * points[:, :2] / points[:, 2:] + np.array([width / 2, height / 2])


def scene(
    rng,
    width=1920,
    height=1080,
    markers=20,
    side_px=(45, 150),
    tilt_deg=(0, 50),
    blur_px=0.7,
    noise_dn=2.0,
    encoding="srgb",
    pieces=150,
    ground=None,
):
    """Return (uint8 image, list of Truth): half of the markers of each dictionary, random ids, none overlapping.

    They lie on clutter of so many pieces, or on ``ground``, linear light (height, width), which is painted over.
    """
    light = clutter(rng, height, width, pieces) if ground is None else ground
    taken, truth = [], []
    for k in range(markers):
        dictionary, count = (("DICT_5X5_1000", 1000), ("DICT_ARUCO_ORIGINAL", 1023))[k % 2]
        for _ in range(20000):
            side, tilt = rng.uniform(*side_px), rng.uniform(*tilt_deg)
            centre = rng.uniform((0, 0), (width, height))
            corners = _pose(rng, side, tilt, centre, width, height)
            reach = (0.5 + MARGIN_MODULES / 7) * 1.5 * side + 4
            inside = (centre > reach).all() and (centre < np.array([width, height]) - reach).all()
            free = all(np.abs(centre - c).max() > reach + r for c, r in taken)
            if inside and free:
                break
        else:
            raise RuntimeError(f"no room for marker {k} of {markers}")
        taken.append((centre, reach))
        number = int(rng.integers(count))
        cells = code_cells(dictionary, number)
        n = len(cells)
        code = np.array([[0, 0], [n, 0], [n, n], [0, n]], float)
        to_code = _exact_homography(corners, code)
        x0, y0 = np.floor(centre - reach).astype(int)
        x1, y1 = np.ceil(centre + reach).astype(int)
        white, black = rng.uniform(0.6, 0.85), rng.uniform(0.02, 0.08)
        _paint(light, x0, y0, x1, y1, to_code, cells, MARGIN_MODULES, white, black)
        truth.append(Truth(dictionary, number, corners, side, tilt))
    return encode(rng, light, blur_px, noise_dn, encoding), truth


def _exact_homography(source, target):
    """Return the 3 x 3 homography through four points in double precision (OpenCV's takes float32)."""
    rows = []
    for (x, y), (u, v) in zip(source, target, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    h = np.linalg.solve(np.array(rows, float), np.asarray(target, float).ravel())
    return np.append(h, 1).reshape(3, 3)


def compare(truth, detections):
    """Return (errors (m, 4, 2) of the found, bool (n,) found, number of false ids).

    A detection counts with the right id and its centre within half a marker of the truth; any other is false, and so
    is a second one of the same marker.
    """
    found = np.zeros(len(truth), bool)
    errors, false = [], 0
    for d in detections:
        hits = [
            k
            for k, t in enumerate(truth)
            if (t.dictionary, t.id) == (d.dictionary, d.id)
            and np.linalg.norm(t.corners.mean(axis=0) - d.corners.mean(axis=0)) < t.side_px / 2
            and not found[k]
        ]
        if not hits:
            false += 1
            continue
        found[hits[0]] = True
        errors.append(d.corners - truth[hits[0]].corners)
    return np.array(errors).reshape(-1, 4, 2), found, false
