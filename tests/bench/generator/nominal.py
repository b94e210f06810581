"""The nominal rigs: cameras, stations, plates and the bits printed on them, as the campaign format states
them.
"""

import hashlib
from dataclasses import dataclass, field

import cv2
import numpy as np

MODULES = 7


@dataclass(frozen=True)
class Camera:
    """A nominal pinhole: ``width``, ``height``, ``fx`` (= fy), ``cx``, ``cy`` in pixels."""

    name: str
    width: int
    height: int
    fx: float

    @property
    def cx(self):
        return (self.width - 1) / 2

    @property
    def cy(self):
        return (self.height - 1) / 2

    @property
    def corner_px(self):
        """Distance in pixels from the centre to the centre of a corner pixel."""
        return float(np.hypot(self.cx, self.cy))


def rail_plates():
    """Return the 40 plates of the rail as dicts: dictionary, id, code_m, plate_m, x, y (metres)."""
    rows = []
    for dictionary, x_even, x_odd in (("DICT_5X5_1000", -0.36, 0.12), ("DICT_ARUCO_ORIGINAL", 0.36, -0.12)):
        for i in range(20):
            x = x_odd if i % 2 else x_even
            rows.append({"dictionary": dictionary, "id": i, "code_m": 0.07, "plate_m": 0.1, "x": x, "y": (i + 1) / 10})
    return rows


def grid_plates(count, columns, first_id, code_m, plate_m, pitch_x, pitch_y, near_y):
    """Return plates as ``rail_plates``: rows of ``columns`` about x = 0, the nearest row at ``near_y``, metres apart by the pitches."""
    places = [((i % columns - (columns - 1) / 2) * pitch_x, near_y + pitch_y * (i // columns)) for i in range(count)]
    return [
        {"dictionary": "DICT_5X5_1000", "id": first_id + i, "code_m": code_m, "plate_m": plate_m, "x": x, "y": y}
        for i, (x, y) in enumerate(places)
    ]


@dataclass(frozen=True)
class Rig:
    """What a campaign declares: ``cameras``, of which it has one; stations at all ``heights_m`` and ``tilts_deg``, ``trials`` of
    each; ``plates`` as ``rail_plates``, all of one size; ``reflectance``; noise in grey levels; tolerances of stations.
    """

    cameras: tuple
    heights_m: tuple
    tilts_deg: tuple = (20, 45)
    trials: int = 2
    plates: tuple = tuple(rail_plates())
    reflectance: dict = field(default_factory=lambda: {"white": 0.8, "black": 0.05, "ground": 0.35, "background": 0.3})
    noise_dn: float = 1.0
    tolerance_position_m: float = 0.002
    tolerance_angle_deg: float = 0.2

    @property
    def code_m(self):
        """The side of the plates' codes."""
        return self.plates[0]["code_m"]

    @property
    def plate_m(self):
        """The side of the plates."""
        return self.plates[0]["plate_m"]

    @property
    def stations(self):
        """The (height_m, tilt_deg) of a campaign, in the captures' order."""
        return [(h, t) for h in self.heights_m for t in self.tilts_deg]


RIGS = {
    "standard": Rig(
        (Camera("hp325", 960, 540, 739.0), Camera("brio", 960, 540, 550.75), Camera("quest3", 826, 883, 507.2)),
        (0.3, 0.5, 0.7, 0.9, 1.1),
    ),
    "small": Rig((Camera("hp325", 768, 432, 591.2), Camera("brio", 768, 432, 440.6)), (0.3, 0.7)),
    "tiny": Rig((Camera("hp325", 384, 216, 295.6),), (0.5,)),
    "few": Rig(
        (Camera("hp325", 1280, 800, 1000.0),),
        (0.5, 0.8, 1.2),
        (25, 40, 55),
        trials=1,
        plates=tuple(grid_plates(14, 3, 100, 0.12, 0.15, 0.24, 0.2, 0.25)),
        reflectance={"white": 0.7, "black": 0.08, "ground": 0.2, "background": 0.5},
        noise_dn=2.0,
    ),
    "near": Rig(
        (Camera("hp325", 640, 480, 520.0),),
        (0.3, 0.4, 0.55, 0.7),
        (30, 60),
        plates=tuple(grid_plates(24, 4, 300, 0.05, 0.065, 0.11, 0.1, 0.08)),
        noise_dn=0.7,
        tolerance_position_m=0.006,
        tolerance_angle_deg=0.6,
    ),
}


def seed_of(*names):
    """Return a 64-bit seed that depends on the names alone."""
    return int.from_bytes(hashlib.blake2b("/".join(map(str, names)).encode(), digest_size=8).digest(), "big")


def rng_of(*names):
    """Return a generator of random numbers seeded by the names alone."""
    return np.random.default_rng(seed_of(*names))


def black_modules(dictionary, number):
    """Return the 7 x 7 modules of a code, row 0 at the top; 1 is black.

    Read from OpenCV's byte list: the four rotations one after the other, whatever its shape says; eight bits
    a byte, most significant first, the rest in the last byte's low bits.
    """
    table = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    side = table.markerSize
    packed = table.bytesList[number].ravel()[: (side * side + 7) // 8]
    bits, left = [], side * side
    for byte in packed:
        n = min(8, left)
        bits += [(int(byte) >> k) & 1 for k in range(n - 1, -1, -1)]
        left -= n
    black = np.ones((side + 2, side + 2), np.uint8)
    black[1:-1, 1:-1] = 1 - np.array(bits[: side * side], np.uint8).reshape(side, side)
    return black


def station_rotation(tilt_deg):
    """Return R_cam_world (3, 3) of a station: camera x right, y down, z forward, the axis ``tilt_deg`` below
    level.
    """
    c, s = np.cos(np.radians(tilt_deg)), np.sin(np.radians(tilt_deg))
    return np.array([[1.0, 0.0, 0.0], [0.0, -s, -c], [0.0, c, -s]])
