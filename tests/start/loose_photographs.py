"""Photographs of markers that lie loose on a table, of known places: drawn by ray, with a lens that bends."""

import cv2
import numpy as np

CELLS = 7  # of DICT_5X5: five bits and the frame


class Table:
    """Square papers of one code each: centres (n, 2) and turns (n,) of a table, metres and radians, y up."""

    def __init__(self, ids, centres, turns, side_m, paper=1.4, dictionary=cv2.aruco.DICT_5X5_100):
        self.ids, self.centres, self.turns, self.side_m, self.paper = (
            ids,
            np.array(centres),
            np.array(turns),
            side_m,
            paper,
        )
        made = cv2.aruco.getPredefinedDictionary(dictionary)
        self.codes = [made.generateImageMarker(int(i), CELLS, borderBits=1) > 127 for i in ids]

    def light(self, x, y):
        """Return the reflectance of points of the table (arrays)."""
        seen = np.full(x.shape, 0.35)
        for code, (cx, cy), turn in zip(self.codes, self.centres, self.turns, strict=True):
            dx, dy = x - cx, y - cy
            u = (np.cos(turn) * dx + np.sin(turn) * dy) / self.side_m
            v = (-np.sin(turn) * dx + np.cos(turn) * dy) / self.side_m
            reach = np.maximum(abs(u), abs(v))
            seen[reach < self.paper / 2] = 0.8
            inside = reach < 0.5
            column = np.clip(((u[inside] + 0.5) * CELLS).astype(int), 0, CELLS - 1)
            row = np.clip(((0.5 - v[inside]) * CELLS).astype(int), 0, CELLS - 1)
            seen[inside] = np.where(code[row, column], 0.8, 0.05)
        return seen


def looking(centre, target, roll):
    """Return (R, centre): a camera at ``centre`` that looks at ``target``, rows of R its axes x right, y down, z ahead."""
    z = np.subtract(target, centre)
    z = z / np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [0.0, 1.0, 0.0])
    x = x / np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(roll), np.sin(roll)
    return np.stack([c * x + s * y, -s * x + c * y, z]), np.asarray(centre, float)


def shoot(table, pose, focal_px, k1, size, rng, finer=2, noise_dn=1.5):
    """Return the photograph, uint8 (rows, columns), of a table z = 0 through a lens x (1 + k1 r^2)."""
    R, centre = pose
    rows, columns = np.mgrid[: size[1] * finer, : size[0] * finer]
    bent = np.stack([(columns + 0.5) / finer - size[0] / 2, (rows + 0.5) / finer - size[1] / 2]) / focal_px
    straight = bent.copy()
    for _ in range(8):
        straight = bent / (1 + k1 * (straight**2).sum(axis=0))
    rays = np.tensordot(R.T, np.stack([*straight, np.ones_like(straight[0])]), 1)
    far = -centre[2] / np.minimum(rays[2], -1e-6)
    light = table.light(centre[0] + far * rays[0], centre[1] + far * rays[1])
    light = cv2.GaussianBlur(light.reshape(size[1], finer, size[0], finer).mean(axis=(1, 3)), (0, 0), 0.6)
    encoded = 255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.clip(np.round(encoded + rng.normal(0, noise_dn, encoded.shape)), 0, 255).astype(np.uint8)


def walk(rng, number):
    """Return poses of a camera walked round a table of half a metre."""
    poses = []
    for k in range(number):
        round_, tilt = 2.4 * k + rng.uniform(-0.3, 0.3), np.radians(rng.uniform(5, 45))
        distance = rng.uniform(0.55, 0.8)
        direction = np.array([np.sin(tilt) * np.cos(round_), np.sin(tilt) * np.sin(round_), np.cos(tilt)])
        poses.append(looking(distance * direction, [*rng.uniform(-0.04, 0.04, 2), 0], rng.uniform(-3, 3)))
    return poses


def scattered(rng, number, reach=(0.26, 0.2), apart=0.1):
    """Return (centres (n, 2), turns (n,)) of papers that do not overlap."""
    centres = []
    while len(centres) < number:
        place = rng.uniform(-1, 1, 2) * reach
        if all(np.hypot(*(place - other)) > apart for other in centres):
            centres.append(place)
    return np.array(centres), rng.uniform(-3, 3, number)


def corners_seen(table, pose, focal_px, k1, size, inset_px):
    """Return (ids, quads (n, 4, 2)) of the codes that are whole in a photograph, their edges moved inwards."""
    R, centre = pose
    ids, quads = [], []
    for number, (cx, cy), turn in zip(table.ids, table.centres, table.turns, strict=True):
        c, s = np.cos(turn), np.sin(turn)
        flat = 0.5 * table.side_m * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) @ np.array([[c, s], [-s, c]])
        p = (np.column_stack([flat + [cx, cy], np.zeros(4)]) - centre) @ R.T
        xy = p[:, :2] / p[:, 2:]
        quad = focal_px * xy * (1 + k1 * (xy**2).sum(axis=1, keepdims=True)) + (np.array(size) - 1) / 2
        if (p[:, 2] > 0).all() and (quad > 3).all() and (quad < np.array(size) - 4).all():
            ids.append(int(number))
            quads.append(_shrunk(quad, inset_px))
    return ids, np.array(quads).reshape(-1, 4, 2)


def _shrunk(quad, by_px):
    """Return the crossings (4, 2) of a quad's edges, each moved inwards."""
    ahead = np.roll(quad, -1, axis=0) - quad
    inward = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) / np.linalg.norm(ahead, axis=1, keepdims=True)
    moved = quad + by_px * inward
    crossed = []
    for k in range(4):
        before = k - 1
        A = np.column_stack([ahead[before], -ahead[k]])
        crossed.append(moved[before] + np.linalg.solve(A, moved[k] - moved[before])[0] * ahead[before])
    return np.array(crossed)
