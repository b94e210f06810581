"""A campaign of a board whose photographs are turned by 180 degrees, and what that does to what is told of the camera."""

import shutil

import cv2

# Effects whose parameters' signs turn with the photographs; a lens's other terms stay
TURNING = ("principal_point", "tangential_distortion")
STAYING = ("radial_distortion", "focal_length", "pixel_aspect", "print_stretch")


def turned_round(campaign, folder):
    """Write a campaign of a board with all its photographs turned to a new folder, and return that."""
    folder.mkdir(parents=True)
    for name in ("campaign.yaml", "captures.csv"):
        shutil.copy(campaign / name, folder)
    for path in (p for p in campaign.iterdir() if p.suffix.lower() in (".jpg", ".jpeg", ".png")):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
        cv2.imwrite(str(folder / path.name), cv2.rotate(image, cv2.ROTATE_180), [cv2.IMWRITE_JPEG_QUALITY, 100])
    return folder


def off_in_errors(before, after):
    """Return by how many standard errors what turned photographs tell, steps of a verdict's record, lies off what they told
    ``before``: the farthest of the parameters that both name and whose signs are known, 0 where there are none.
    """
    turned = {step["effect"]: step["parameters"] for step in after}
    off = [0.0]
    for effect, parameters in ((s["effect"], s["parameters"]) for s in before if s["effect"] in turned):
        if effect in (*TURNING, *STAYING):
            sign = -1 if effect in TURNING else 1
            off += [
                abs(turned[effect][k]["value"] - sign * p["value"]) / p["se"] for k, p in parameters.items() if p["se"]
            ]
    return max(off)
