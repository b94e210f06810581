"""Campaigns of markers of any type, their photographs drawn by sampling and OpenCV's warps, apart from the project's synthesis.

What may be hidden: ``k1`` of OpenCV's lens, ``blur_px`` (a Gaussian in linear light), ``scale`` of the codes on their plates.
"""

import cv2
import numpy as np
import pandas as pd
import yaml
from scipy.spatial.transform import Rotation

from markers.contract import count_of, drawing_of, marker_corners_world
from rig.geometry import camera_matrix, station_pose

WIDTH, HEIGHT, FOCAL_PX = 480, 360, 400.0
REFLECTANCE = {"white": 0.8, "black": 0.05, "ground": 0.35, "background": 0.3}
BESIDE_PX = 4  # beyond a plate that are drawn with it
# Samples along a pixel's side; along a plate's: half as many blur the nearest boards by more than is worth a name
FINER, TEXTURE_PX = 8, 1280
STATIONS = [(h, t) for h in (0.35, 0.5, 0.65) for t in (40, 55)]
NOISE_DN, POSITION_M, ANGLE_DEG = 1.0, 0.002, 0.2


def plates_of(families):
    """Return the markers' table of twelve plates before the camera, or of six larger ones where the families have fewer ids."""
    codes = [(family, i) for family in families for i in range(min(count_of(family), 12))][:12]
    if len(codes) == 12:
        places, sides = [(x, y) for y in (0.25, 0.4, 0.55) for x in (-0.24, -0.08, 0.08, 0.24)], (0.06, 0.12)
    else:
        places, sides = [(x, y) for y in (0.3, 0.5) for x in (-0.2, 0.0, 0.2)], (0.15, 0.18)
    rows = [[*code, *sides, *place, 0.0, 0.0, 0.0, 0.0] for code, place in zip(codes, places, strict=True)]
    return pd.DataFrame(rows, columns=["dictionary", "id", "code_m", "plate_m", "x", "y", "z", "rx", "ry", "rz"])


def texture(marker, scale):
    """Return the reflectances (TEXTURE_PX, TEXTURE_PX) of a plate: nine samples each, the top left first."""
    drawing, n = drawing_of(marker.dictionary, marker.id), 3 * TEXTURE_PX
    at = ((np.arange(n) + 0.5) / n - 0.5) * marker.plate_m / (marker.code_m * scale)
    x, y = np.meshgrid(at, -at)
    lines = np.linspace(-0.5, 0.5, len(drawing.white) + 1) if drawing.lines is None else drawing.lines
    column, row = (np.searchsorted(lines, v, side="right") - 1 for v in (x, y))
    inside = (np.minimum(row, column) >= 0) & (np.maximum(row, column) < len(drawing.white))
    row, column = (np.clip(v, 0, len(drawing.white) - 1) for v in (row, column))
    white = np.where(inside, drawing.white[::-1][row, column], True)
    for x0, y0, radius, colour in drawing.discs:  # of all samples a few are near one
        near = tuple(slice(*np.searchsorted(at, (c - radius, c + radius))) for c in (-y0, x0))
        white[near] = np.where(np.hypot(x[near] - x0, y[near] - y0) < radius, bool(colour), white[near])
    sampled = np.where(white, REFLECTANCE["white"], REFLECTANCE["black"])
    return sampled.reshape(TEXTURE_PX, 3, TEXTURE_PX, 3).mean((1, 3)).astype(np.float32)


def photograph(markers, textures, T_cam_world, rng, k1=0.0, blur_px=0.0):
    """Return the grey levels (HEIGHT, WIDTH) uint8 of plates, one ``texture`` each, seen from a pose."""
    K = camera_matrix(FOCAL_PX, FOCAL_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    at = [(np.arange(n * FINER) + 0.5) / FINER - 0.5 for n in (WIDTH, HEIGHT)]
    pixels = np.stack(np.meshgrid(*at), -1).reshape(-1, 1, 2)
    ideal = cv2.undistortPoints(pixels, K, np.array([k1, 0, 0, 0, 0.0]), P=K).reshape(HEIGHT * FINER, -1, 2)
    rotation, lens = cv2.Rodrigues(T_cam_world[:3, :3])[0], np.array([k1, 0, 0, 0, 0.0])
    image = np.full(ideal.shape[:2], REFLECTANCE["ground"], np.float32)
    for m, reflectance in zip(markers.itertuples(), textures, strict=True):
        corners = marker_corners_world(m._replace(code_m=m.plate_m))
        seen, bent = (
            cv2.projectPoints(corners, rotation, T_cam_world[:3, 3], K, of)[0].reshape(4, 2) for of in (None, lens)
        )
        low, high = bent.min(0) - BESIDE_PX, bent.max(0) + BESIDE_PX
        (x0, y0), (x1, y1) = (np.clip(FINER * v, 0, image.shape[::-1]).astype(int) for v in (low, high))
        if x0 == x1 or y0 == y1:
            continue
        square = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]]) * TEXTURE_PX - 0.5
        to_plate = cv2.getPerspectiveTransform(seen.astype(np.float32), square)
        places = cv2.perspectiveTransform(ideal[y0:y1, x0:x1].reshape(-1, 1, 2), to_plate)
        places = places.reshape(y1 - y0, x1 - x0, 2).astype(np.float32)
        shown = cv2.remap(reflectance, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        on_it = ((places > -0.5) & (places < TEXTURE_PX - 0.5)).all(-1)
        image[y0:y1, x0:x1] = np.where(on_it, shown, image[y0:y1, x0:x1])
    if blur_px:
        image = cv2.GaussianBlur(image, (0, 0), blur_px * FINER)
    radiance = image.reshape(HEIGHT, FINER, WIDTH, FINER).mean(axis=(1, 3))
    encoded = np.where(radiance <= 0.0031308, 12.92 * radiance, 1.055 * radiance ** (1 / 2.4) - 0.055)
    return (255 * encoded + rng.normal(0, NOISE_DN, encoded.shape)).round().clip(0, 255).astype(np.uint8)


def write_marker_campaign(folder, families, stations=STATIONS, trials=2, scale=1.0, **hidden):
    """Write a campaign of one camera to ``folder`` and return it; ``hidden`` as ``photograph`` has it."""
    rng, markers, rows = np.random.default_rng(3), plates_of(families), []
    textures = [texture(m, scale) for m in markers.itertuples()]
    (folder / "images").mkdir(parents=True)
    for height_m, tilt_deg in stations:
        for trial in range(trials):
            name = f"h{round(100 * height_m)}_t{tilt_deg}_r{trial}"
            T = station_pose(height_m, tilt_deg)
            T[:3, 3] += -T[:3, :3] @ rng.normal(0, POSITION_M, 3)
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec(rng.normal(0, ANGLE_DEG, 3), degrees=True).as_matrix()
            cv2.imwrite(str(folder / f"images/{name}.png"), photograph(markers, textures, turn @ T, rng, **hidden))
            rows.append([name, "cam", height_m, tilt_deg, trial, f"images/{name}.png"])
    markers.to_csv(folder / "markers.csv", index=False)
    columns = ["capture", "camera", "height_m", "tilt_deg", "trial", "image"]
    pd.DataFrame(rows, columns=columns).to_csv(folder / "captures.csv", index=False)
    centre = {"cx": (WIDTH - 1) / 2, "cy": (HEIGHT - 1) / 2}
    description = {
        "schema": 1, "name": folder.name, "origin": "simulated", "markers": "markers.csv", "captures": "captures.csv",
        "cameras": {"cam": {"width": WIDTH, "height": HEIGHT, "fx": FOCAL_PX, "fy": FOCAL_PX} | centre},
        "reflectance": REFLECTANCE, "exposure": 1.0, "encoding": "srgb", "noise_dn": NOISE_DN,
        "tolerance": {"position_m": POSITION_M, "angle_deg": ANGLE_DEG},
    }  # fmt: skip
    (folder / "campaign.yaml").write_text(yaml.safe_dump(description), encoding="utf-8")
    return folder
