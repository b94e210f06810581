"""Detect: one detector on the frames of all trajectories as on video; by its tracker where it has one."""

import logging
import time
from pathlib import Path

import pandas as pd
import pandera.pandas as pa

import job
from detect_markers import read_image
from detectors import contract
from inputs.tables import write_table
from moving.config import load_moving
from moving.truth import CORNERS, POSE
from rig.errors import InputError

log = logging.getLogger("twingap")

DETECTIONS = pa.DataFrameSchema(
    {"trajectory": pa.Column(str, coerce=True), "frame": pa.Column(int, coerce=True)}
    | {"dictionary": pa.Column(str, coerce=True), "id": pa.Column(int, coerce=True)}
    | {"seen": pa.Column(bool, coerce=True)}
    | {name: pa.Column(float, coerce=True) for name in CORNERS}
    | {name: pa.Column(float, nullable=True, coerce=True) for name in POSE},
    strict=True,
)
TIMING = pa.DataFrameSchema(
    {"trajectory": pa.Column(str, coerce=True), "frame": pa.Column(int, coerce=True)}
    | {"budget_ms": pa.Column(float, nullable=True, coerce=True), "ms": pa.Column(float, coerce=True)}
    | {"partial": pa.Column(bool, coerce=True)},
    strict=True,
)


class FrameByFrame:
    """A detector by the contract, with the better planar pose of each marker."""

    def __init__(self, name, parameters, dictionaries, K, code_m):
        self.detector = contract.make(name, dictionaries, parameters)
        self.K, self.code_m = K, code_m

    def update(self, image, t_s):
        """Return (rows from dictionary to tz, milliseconds of the detection alone, False: never partial)."""
        start = time.perf_counter()
        found = self.detector.detect(image)
        ms = 1000 * (time.perf_counter() - start)
        return [self._row(d) for d in found], ms, False

    def _row(self, d):
        side = self.code_m.get((d.dictionary, d.id))
        poses = contract.estimate_poses(d.corners, side, self.K) if side else []
        pose = [*poses[0][0], *poses[0][1]] if poses else [None] * 6
        return [d.dictionary, d.id, True, *d.corners.ravel(), *pose]


class Tracked:
    """A detector's tracker: a marker's pose is the filtered one, and an unseen marker may be bridged: extrapolated."""

    def __init__(self, module, parameters, dictionaries, K, code_m):
        self.tracker = module.Tracker(dictionaries, K=K, code_m=code_m, **parameters)

    def update(self, image, t_s):
        """Return (rows from dictionary to tz, milliseconds with poses and filters, whether the budget ran out)."""
        frame = self.tracker.update(image, t_s)
        return [self._row(m) for m in frame.markers], frame.ms, frame.partial

    def _row(self, m):
        pose = [None] * 6 if m.rvec is None else [*m.rvec, *m.tvec]
        return [m.dictionary, m.id, m.seen, *m.corners.ravel(), *pose]


def make_follower(name, parameters, moving):
    """Return what follows markers through a sequence by ``update(image, t_s)``: new, without memory."""
    code_m = {(m.dictionary, m.id): m.code_m for m in moving.markers.itertuples()}
    dictionaries = sorted(set(moving.markers.dictionary))
    tracker = contract.tracker_of(name)
    if tracker:
        return Tracked(tracker, parameters, dictionaries, moving.K, code_m)
    return FrameByFrame(name, parameters, dictionaries, moving.K, code_m)


def follow(follower, images, times_s):
    """Return (rows of DETECTIONS, rows (frame, ms, partial)) of a sequence, each without its trajectory."""
    rows, timing = [], []
    for frame, (image, t_s) in enumerate(zip(images, times_s, strict=True)):
        found, ms, partial = follower.update(image, float(t_s))
        rows += sorted([frame, *row] for row in found)
        timing.append([frame, ms, partial])
    return rows, timing


def detect_moving(experiment, detector, folders, out, timing):
    """Write what a detector reports in the frames of all trajectories, and how long each frame took.

    folders  {trajectory: folder of its frames}
    Where a detector keeps a budget, a second run with it is timed; reports are of the first, which no clock decides.
    """
    moving = load_moving(experiment)
    parameters = moving.file.detectors[detector]
    contract.check_for_sequences({detector: parameters}, f"{experiment}: detectors")
    tracker = contract.tracker_of(detector)
    rows, clocks = [], []
    keeps_budget = tracker and "budget_ms" in tracker.TRACKER_PARAMETERS
    budgets = [None, moving.file.budget_ms] if keeps_budget else [None]
    for name in sorted(folders):
        images = [read_image(path) for path in sorted(Path(folders[name]).glob("*.png"))]
        if len(images) != moving.file.frames:
            raise InputError(f"{folders[name]}: {len(images)} frames, {moving.file.frames} are configured")
        for image in images[:2]:  # untimed: compilation is no property of a frame
            make_follower(detector, parameters, moving).update(image, 0.0)
        for budget in budgets:
            limit = {} if budget is None else {"budget_ms": budget}
            found, took = follow(make_follower(detector, parameters | limit, moving), images, moving.times_s)
            clocks += [[name, frame, budget, ms, partial] for frame, ms, partial in took]
            if budget is None:
                rows += [[name, *row] for row in found]
        log.info("%s, %s: %d reports in %d frames", detector, name, sum(r[0] == name for r in rows), len(images))
    write_table(pd.DataFrame(rows, columns=list(DETECTIONS.columns)), out, DETECTIONS)
    write_table(pd.DataFrame(clocks, columns=list(TIMING.columns)), timing, TIMING)


if __name__ == "__main__":
    job.run(
        detect_moving,
        snakemake,
        experiment=snakemake.input.experiment,
        detector=snakemake.wildcards.detector,
        folders=dict(zip(snakemake.params.trajectories, snakemake.input.frames, strict=True)),
        out=snakemake.output.detections,
        timing=snakemake.output.timing,
    )
