"""Tiny campaigns on disk: one that shows no marker, in which tests break one thing each, and one that shows six."""

import cv2
import numpy as np
import pandas as pd
import yaml

from markers.contract import marker_corners_world
from rig.geometry import camera_matrix, project, station_pose
from rig.plates import code_cells

WIDTH, HEIGHT = 64, 48
MARKERS = """dictionary,id,code_m,plate_m,x,y,z,rx,ry,rz
DICT_5X5_1000,3,0.07,0.1,-0.1,0.4,0,0,0,0
DICT_ARUCO_ORIGINAL,3,0.07,0.1,0.1,0.4,0,0,0,0
"""
CAPTURES = """capture,camera,height_m,tilt_deg,trial,image
left_a,left,0.3,45,0,images/left/a.png
left_b,left,0.3,45,1,images/left/b.png
right_a,right,0.3,45,0,images/right/a.png
right_b,right,0.6,22.5,0,images/right/b.png
"""


def description():
    """Return campaign.yaml as plain data."""
    camera = {"width": WIDTH, "height": HEIGHT, "fx": 50.0, "fy": 50.0, "cx": 31.5, "cy": 23.5}
    return {
        "schema": 1,
        "name": "tiny",
        "origin": "camera",
        "markers": "markers.csv",
        "captures": "captures.csv",
        "cameras": {"left": dict(camera), "right": dict(camera)},
        "reflectance": {"white": 0.8, "black": 0.05, "ground": 0.35, "background": 0.3},
        "exposure": 1,
        "encoding": "srgb",
        "noise_dn": 1.0,
        "tolerance": {"position_m": 0.002, "angle_deg": 0.2},
    }


def write_campaign(folder, describe=None, markers=MARKERS, captures=CAPTURES):
    """Write the campaign to ``folder`` and return it; ``describe`` may change the plain data of campaign.yaml."""
    data = description()
    if describe:
        describe(data)
    rng = np.random.default_rng(1)
    for camera in ("left", "right"):
        (folder / "images" / camera).mkdir(parents=True)
        for name in "ab":
            pixels = rng.integers(80, 120, (HEIGHT, WIDTH), dtype=np.uint8)
            cv2.imwrite(str(folder / f"images/{camera}/{name}.png"), pixels)
    (folder / "campaign.yaml").write_text(yaml.safe_dump(data))
    (folder / "markers.csv").write_text(markers)
    (folder / "captures.csv").write_text(captures)
    return folder


def board(data):
    """Change the plain data of campaign.yaml: photographs of one chessboard in place of markers."""
    data["name"] = "board"
    del data["markers"]
    data["target"] = {"type": "chessboard", "columns": 9, "rows": 6, "square_m": 0.03}


SEEN_WIDTH, SEEN_HEIGHT, SEEN_FOCAL_PX = 240, 180, 200.0
SEEN_HEIGHTS_M = (0.3, 0.33, 0.36, 0.39, 0.42, 0.45)
DRAWN_FINER = 4


def write_seen_campaign(folder):
    """Write a campaign in which markers are seen to ``folder`` and return it: two cameras, six plates, a station a
    height, two trials of the first.
    """
    plates = [("DICT_5X5_1000", 0.5), ("DICT_ARUCO_ORIGINAL", 0.65)]
    markers = "".join(f"{d},{2 + i},0.07,0.1,{0.13 * (i - 1):.2f},{y},0,0,0,0\n" for d, y in plates for i in range(3))
    heights = [(h, 0) for h in SEEN_HEIGHTS_M] + [(SEEN_HEIGHTS_M[0], 1)]
    shots = [(f"{c}_h{100 * h:.0f}_{trial}", c, h, trial) for c in ("left", "right") for h, trial in heights]
    rows = "".join(f"{name},{c},{h},40,{trial},images/{c}/{name}.png\n" for name, c, h, trial in shots)
    headers = [text.splitlines()[0] + "\n" for text in (MARKERS, CAPTURES)]
    write_campaign(folder, _seen_cameras, headers[0] + markers, headers[1] + rows)
    rng = np.random.default_rng(2)
    table = pd.read_csv(folder / "markers.csv")
    for name, camera, height, _ in shots:
        image = draw(table, height, 40) + rng.normal(0, 1, (SEEN_HEIGHT, SEEN_WIDTH))
        cv2.imwrite(str(folder / f"images/{camera}/{name}.png"), image.round().clip(0, 255).astype(np.uint8))
    return folder


def _seen_cameras(data):
    for camera in data["cameras"].values():
        camera |= {"width": SEEN_WIDTH, "height": SEEN_HEIGHT, "fx": SEEN_FOCAL_PX, "fy": SEEN_FOCAL_PX}
        camera |= {"cx": (SEEN_WIDTH - 1) / 2, "cy": (SEEN_HEIGHT - 1) / 2}


def draw(markers, height_m, tilt_deg):
    """Return the grey values (SEEN_HEIGHT, SEEN_WIDTH) of plates seen from a station: warped bitmaps, averaged."""
    k, n = DRAWN_FINER, 64
    K = camera_matrix(SEEN_FOCAL_PX, SEEN_FOCAL_PX, (SEEN_WIDTH - 1) / 2, (SEEN_HEIGHT - 1) / 2)
    finer = np.array([[k, 0, (k - 1) / 2], [0, k, (k - 1) / 2], [0, 0, 1]])  # pixel centres of the finer image
    image = np.full((k * SEEN_HEIGHT, k * SEEN_WIDTH), 0.35, np.float32)
    for m in markers.itertuples():
        code = np.kron(code_cells(m.dictionary, m.id), np.ones((n, n))) * 0.75 + 0.05
        border = round(len(code) * (m.plate_m / m.code_m - 1) / 2)
        plate = np.pad(code, border, constant_values=0.8).astype(np.float32)
        corners = marker_corners_world(m._replace(code_m=m.plate_m))
        seen = project(finer @ K, station_pose(height_m, tilt_deg), corners)
        size = len(plate) - 0.5
        H = cv2.getPerspectiveTransform(
            np.float32([[-0.5, -0.5], [size, -0.5], [size, size], [-0.5, size]]), np.float32(seen)
        )
        warped = cv2.warpPerspective(plate, H, image.shape[::-1], flags=cv2.INTER_AREA, borderValue=-1)
        image = np.where(warped > 0, warped, image)
    radiance = image.reshape(SEEN_HEIGHT, k, SEEN_WIDTH, k).mean(axis=(1, 3))
    return 255 * np.where(radiance <= 0.0031308, 12.92 * radiance, 1.055 * radiance ** (1 / 2.4) - 0.055)
