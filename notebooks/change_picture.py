"""Draw the picture of a change in photographs: `make picture`.

On every other photograph of an embedded campaign the blind trials' generator lays a blur; what has changed is found from files,
as the workflow does.
"""

import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
from front_picture import save
from photograph_picture import side_by_side

from change_pictures import squares_of
from photograph_changes import what_changed
from trials.diagnose_trial import photograph_sets
from trials.observe_trial import observe_trial
from trials.real_trials import generate_real_trial

LAID = "lens_blur"
TITLES = "a square of the board then", "with what has changed laid on", "a square now"


def draw(campaigns, camera):
    """Return the figure of one square in photographs by a camera in a folder of campaigns."""
    with tempfile.TemporaryDirectory() as folder:
        name = generate_real_trial(Path(folder) / "c", Path(folder) / "t", campaigns, 0, "picture", effect=LAID)
        kept = Path(folder) / "kept"
        observe_trial(Path(folder) / "c" / name, kept)
        what = what_changed(photograph_sets(kept), camera)
        print([(change.effect, change.one_of) for change in what.signatures])
        (before, after), _ = squares_of(what)
    shown = before[:, : before.shape[0]], before[:, before.shape[0] :], after
    return side_by_side(dict(zip(TITLES, shown, strict=True)))


if __name__ == "__main__":
    plt.switch_backend("agg")
    save(draw(sys.argv[1], sys.argv[2]), sys.argv[3])
