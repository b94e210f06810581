"""A tiny campaign on disk: two cameras, two plates, four captures of 64 x 48 pixels; tests break one thing each."""

import cv2
import numpy as np
import yaml

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


def lay_down(folder, describe=None, markers=MARKERS, captures=CAPTURES):
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
