"""The light of a photograph of a board that nobody declared, and what it does to the twin's radiance.

A white cell at the board's place (X, Y) radiates white * exp(g + a . (X, Y) + b . (X^2, XY, Y^2)) in green, another multiple in
red and blue, and stray light is added to all cells; (X, Y) are from the board's middle, in halves of its longer side.
"""

import numpy as np

LIGHT = ("gain", "along_x", "along_y", "xx", "xy", "yy", "red", "blue", "stray", "stray_red", "stray_blue")
LEFT_OPEN = {  # which numbers of it are unknown where a campaign does not declare something
    "light": ("along_x", "along_y", "xx", "xy", "yy", "stray", "stray_red", "stray_blue"),
    "exposure": ("gain",),
    "white_balance": ("red", "blue"),
    "reflectance": ("gain", "stray"),
}
HIDE_ONE_ANOTHER = (  # {what a campaign may leave open, None of what is never declared: what looks like the others of its group}
    {"exposure": "the exposure", "light": "the lamp's strength", "reflectance": "the white of the print"},
    {"white_balance": "the colour balance", "light": "the lamp's colour"},
    {"reflectance": "the black of the print", "light": "glare", None: "the curve's foot"},
)
MAX_PLACE = 2.0  # place up to which the light goes on; beyond it stays


class BoardPlace:
    """Where things are on a board, as its light sees it: ``middle`` (2,) and ``half_size`` in metres."""

    def __init__(self, plate):
        outline = plate.outline_world()[:, :2]
        self.middle, self.half_size = outline.mean(0), np.ptp(outline, axis=0).max() / 2

    def __call__(self, x, y):
        """Return the places (X, Y) of points x, y (any shape), metres on the board's plane."""
        return tuple(
            np.clip((v - m) / self.half_size, -MAX_PLACE, MAX_PLACE) for v, m in zip((x, y), self.middle, strict=True)
        )


def lit(radiance, light, X, Y):
    """Return the radiance (rows, columns, 3) of one (rows, columns, 1 or 3) in a LIGHT (11,) at places X, Y, as many."""
    X, Y = (np.asarray(v, radiance.dtype) for v in (X, Y))
    g, ax, ay, bxx, bxy, byy, red, blue, *stray = np.asarray(light, radiance.dtype)
    factor = np.exp(g + X * (ax + bxx * X + bxy * Y) + Y * (ay + byy * Y))
    colour, added = np.exp([red, 0, blue]), stray[0] + np.array([stray[1], 0, stray[2]])
    planes = [radiance[..., min(k, radiance.shape[2] - 1)] * (factor * colour[k]) + added[k] for k in range(3)]
    return np.stack(planes, axis=-1).astype(radiance.dtype)


def exposed(light, times):
    """Return the LIGHT (11,) of a photograph that is exposed so many times as long."""
    other = np.array(light, float)
    other[LIGHT.index("gain")] += np.log(times)
    other[LIGHT.index("stray") :] *= times
    return other


def in_own_light(radiance, light, view, place):
    """Return the radiance (H + 2m, W + 2m, 3) of a render, (H + 2m, W + 2m) or with 1 or 3 colours, in a LIGHT (11,).

    ``place`` is the BoardPlace of the board, whose plane is z = 0.
    """
    rows, columns = np.indices(radiance.shape[:2], np.float32) - np.float32(view.margin)
    H = np.linalg.inv(view.K @ view.T_cam_world[:3, [0, 1, 3]]).astype(np.float32)
    u, v, w = (H[k, 0] * columns + H[k, 1] * rows + H[k, 2] for k in range(3))
    w = np.where(np.abs(w) > 1e-6, w, np.float32(1e-6))  # the board's horizon: nothing of it is there
    return lit(np.atleast_3d(radiance), light, *place(u / w, v / w))


def hidden_groups(left_open):
    """Return [[words]] of what hides one another in photographs of a board of a campaign that leaves some things open."""
    groups = [[words for key, words in group.items() if key is None or key in left_open] for group in HIDE_ONE_ANOTHER]
    return [group for group in groups if len(group) > 1]


def free_numbers(left_open):
    """Return which numbers of LIGHT (11,) are unknown in a campaign that leaves some things open."""
    return np.array([any(name in LEFT_OPEN[key] for key in left_open) for name in LIGHT])
