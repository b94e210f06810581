"""Draw: a clip of what one detector reports, frame by frame, for a person to watch.

Blue: seen. Orange, dashed: carried on unseen. Red: reported, and no marker is there. Thin and white: missed.
"""

import tempfile
from pathlib import Path

import cv2
import numpy as np

import job
from detect_markers import read_image
from detect_moving import DETECTIONS
from rig.errors import InputError
from rig.moving_config import load_moving
from rig.moving_metrics import match_reports
from rig.moving_truth import CORNERS, TRUTH
from rig.tables import read_table

SCALE = 2
CODEC = "VP80"  # in a .webm, which browsers play; OpenCV's wheel brings its encoder
SLOWED = 0.5  # of the camera's frames a second
BLUE, ORANGE, RED, WHITE = (255, 160, 0), (0, 140, 255), (0, 0, 255), (255, 255, 255)  # BGR


def draw_moving(experiment, truth, detections, detector, folders, out):
    """Write the clip of a detector's reports in all trajectories, one after the other.

    folders  {trajectory: folder of its frames}
    Raises InputError where OpenCV cannot write this kind of video.
    """
    moving, out = load_moving(experiment), Path(out)
    reports = read_table(detections, DETECTIONS)
    cells, false = match_reports(read_table(truth, TRUTH), reports)
    height, width = moving.shape
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent) as scratch:
        path = f"{scratch}/clip{out.suffix}"
        writer = cv2.VideoWriter(
            path, cv2.VideoWriter_fourcc(*CODEC), SLOWED * moving.file.fps, (SCALE * width, SCALE * height)
        )
        if not writer.isOpened():
            raise InputError(f"{out}: this OpenCV writes no {CODEC} video")
        for name in sorted(folders):
            for frame, image in enumerate(sorted(Path(folders[name]).glob("*.png"))):
                here = [t[(t.trajectory == name) & (t.frame == frame)] for t in (cells, reports, false)]
                picture = draw_frame(read_image(image), *here)
                put_title(picture, f"{detector}, {name}, frame {frame}", here[0])
                writer.write(picture)
        writer.release()
        with job.write_atomically(out, "wb") as file:
            file.write(Path(path).read_bytes())


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
    words += f": {int(view.seen.sum())} of {len(view)} seen, {int((view.reported & ~view.seen).sum())} carried on"
    for colour, thickness in (((0, 0, 0), 5), (WHITE, 2)):
        cv2.putText(picture, words, (16, 32), cv2.FONT_HERSHEY_SIMPLEX, 0.8, colour, thickness, cv2.LINE_AA)


if __name__ == "__main__":
    job.run(
        draw_moving,
        snakemake,
        experiment=snakemake.input.experiment,
        truth=snakemake.input.truth,
        detections=snakemake.input.detections,
        detector=snakemake.wildcards.detector,
        folders=dict(zip(snakemake.params.trajectories, snakemake.input.frames, strict=True)),
        out=snakemake.output[0],
    )
