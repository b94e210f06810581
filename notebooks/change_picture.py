"""Draw the picture of a change in photographs: `make picture`.

On every other photograph of an embedded campaign the blind trials' generator lays a blur; what has changed is found from files,
as the workflow does.
"""

import sys
import tempfile
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
from front_picture import save

from change_pictures import squares_of
from photograph_changes import PhotographSet, what_changed
from trials.observe_trial import OBSERVATIONS, PHOTOGRAPHS, observe_trial
from trials.real_trials import generate_real_trial

LAID = "lens_blur"
TITLES = "a square of the board then", "with what has changed laid on", "a square now"


def draw(campaigns, camera):
    """Return the figure of one square in photographs by a camera in a folder of campaigns."""
    with tempfile.TemporaryDirectory() as folder:
        name = generate_real_trial(Path(folder) / "c", Path(folder) / "t", campaigns, 0, "picture", effect=LAID)
        kept = Path(folder) / "kept"
        observe_trial(Path(folder) / "c" / name, kept)
        parts = [kept / part for part in ("baseline", "changed")]
        register_json = parts[0] / "register.json"
        sets = [PhotographSet(p / PHOTOGRAPHS, p / "expand", register_json, p / OBSERVATIONS) for p in parts]
        (before, after), _ = squares_of(what_changed(sets, camera))
    shown = before[:, : before.shape[0]], before[:, before.shape[0] :], after
    figure, row = plt.subplots(1, 3, figsize=(9, 3.2), dpi=100, layout="constrained")
    for axes, title, image in zip(row, TITLES, shown, strict=True):
        axes.imshow(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
        axes.set_axis_off()
        axes.set_title(title, fontsize=10)
    return figure


if __name__ == "__main__":
    plt.switch_backend("agg")
    save(draw(sys.argv[1], sys.argv[2]), sys.argv[3])
