"""Draw: a clip of what one detector reports, frame by frame, for a person to watch."""

import tempfile
from pathlib import Path

import cv2

import job
from detect_markers import read_image
from detect_moving import DETECTIONS
from inputs.tables import read_table
from moving.config import load_moving
from moving.metrics import match_reports
from moving.truth import TRUTH
from reporting.clips import SCALE, draw_frame, put_title
from rig.errors import InputError

CODEC = "VP80"  # in a .webm, which browsers play; OpenCV's wheel brings its encoder
SLOWED = 0.5  # of the camera's frames a second


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
