"""Frames of a moving camera with what a detector reports drawn on them.

Blue: seen. Orange, dashed: bridged (unseen, extrapolated). Red: reported, and no marker is there. Thin and white: missed.
"""

import cv2
import numpy as np

from moving.truth import CORNERS

SCALE = 2
BLUE, ORANGE, RED, WHITE = (255, 160, 0), (0, 140, 255), (0, 0, 255), (255, 255, 255)  # BGR


def draw_frame(grey, cells, reports, false):
    """Return the enlarged image (BGR) with what was reported in it and what was missed."""
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    picture = cv2.resize(picture, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_LINEAR)
    for cell in cells[cells.in_frame & ~cells.reported].itertuples():
        cv2.polylines(picture, [_points(cell)], True, WHITE, 1, cv2.LINE_AA)
    for report in reports.itertuples():
        wrong = (false.dictionary == report.dictionary) & (false.id == report.id)
        colour = RED if wrong.any() else BLUE if report.seen else ORANGE
        points = _points(report)
        if report.seen:
            cv2.polylines(picture, [points], True, colour, 2, cv2.LINE_AA)
        else:
            _dashed(picture, points, colour)
        middle = points.reshape(4, 2).mean(axis=0).astype(int)
        cv2.putText(picture, str(report.id), tuple(middle), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2, cv2.LINE_AA)
    return picture


def _points(row):
    """Return a row's corners as OpenCV draws them (4, 1, 2): enlarged pixels whose centres moved."""
    corners = np.array([getattr(row, name) for name in CORNERS]).reshape(4, 1, 2)
    return np.rint((corners + 0.5) * SCALE - 0.5).astype(int)


def _dashed(picture, points, colour):
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        for k in range(0, 10, 2):
            p, q = a + (b - a) * k / 10, a + (b - a) * (k + 1) / 10
            cv2.line(
                picture, tuple(np.rint(p[0]).astype(int)), tuple(np.rint(q[0]).astype(int)), colour, 2, cv2.LINE_AA
            )


def put_title(picture, words, cells):
    """Write who, where and how many on top."""
    view = cells[cells.in_frame]
    words += f": {int(view.seen.sum())} of {len(view)} seen, {int((view.reported & ~view.seen).sum())} bridged"
    for colour, thickness in (((0, 0, 0), 5), (WHITE, 2)):
        cv2.putText(picture, words, (16, 32), cv2.FONT_HERSHEY_SIMPLEX, 0.8, colour, thickness, cv2.LINE_AA)
