"""Photographs of plates, drawn: what a hand-held camera sees of a print."""

import cv2
import numpy as np

SIZE = (960, 720)


def drawn(plate, px_per_m=4000):
    """Return a plate as an image, uint8, from its top left corner."""
    x, y = (np.round((lines - lines[0]) * px_per_m).astype(int) for lines in (plate.x_m, plate.y_m))
    cells = np.repeat(np.repeat(plate.white, np.diff(y), axis=0), np.diff(x), axis=1)[::-1]
    return np.where(cells, 210, 30).astype(np.uint8)


def photograph(picture, seed):
    """Return a picture as a hand-held camera sees it: whole, tilted, on grey."""
    rng = np.random.default_rng(seed)
    height, width = picture.shape
    share = min(0.8 * SIZE[0] / width, 0.8 * SIZE[1] / height)
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
    seen = (corners - corners.mean(axis=0)) * share * rng.uniform(0.85, 1)
    angle = rng.uniform(-0.5, 0.5)
    seen = seen @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]] * 0.85
    seen += np.array(SIZE) / 2 + rng.uniform(-0.05, 0.05, (4, 2)) * SIZE[1]
    H = cv2.getPerspectiveTransform(corners.astype(np.float32), seen.astype(np.float32))
    sharp = cv2.warpPerspective(picture, H, SIZE, flags=cv2.INTER_AREA, borderValue=110)
    return cv2.GaussianBlur(sharp, (0, 0), 0.7)


def lay(folder, picture, number=4, ending="png"):
    """Write photographs of a picture to a folder and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(number):
        cv2.imwrite(str(folder / f"photo {k}.{ending}"), photograph(picture, k))
    return folder
