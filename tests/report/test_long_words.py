"""What a report says of photographs of a board is much: in lines, each thing once, and headings that are not cut off."""

from pathlib import Path

import matplotlib.pyplot as plt
import pytest

from reporting.pages import render
from reporting.sentences import motion_words, needs_words, verdict_words

ROOT = Path(__file__).resolve().parents[2]
HIDDEN = ["field_curvature", "vignetting", "exposure", "tone_curve", "sharpening", "sensor_noise"]
ADEQUATE = {"verdict": "adequate", "steps": [], "not_told": HIDDEN}


def test_photographs_that_moved_are_told_so():
    """Fails if a verdict that holds with each photograph's own motion does not say so, or photographs at rest move."""
    moved = ADEQUATE | {"motion": {"usual_turn_rad": 0.01, "gap_at_rest": 2.589}}
    assert "at rest, points would stay 2.59 floors off" in verdict_words(moved)
    assert motion_words(ADEQUATE) == ""


def test_what_nothing_tells_is_named_once():
    """Fails if a long list of effects is told twice, or a short one that differs from it is not told."""
    need = {"effect": "exposure", "text": "to tell exposure: halve the distance"}
    said = needs_words(ADEQUATE | {"needs": [need]})
    assert said.count("vignetting") == 1 and "would tell the rest of them." in said
    few = needs_words(ADEQUATE | {"not_told": HIDDEN[:3], "needs": [need]})
    assert "would tell field curvature and vignetting." in few


def test_what_is_not_seen_has_a_line_of_its_own():
    """Fails if a verdict and all that its photographs do not show are one block of text."""
    page = render(
        ROOT / "scripts/reporting/report_template.html.j2",
        **dict.fromkeys(("simulated", "compared", "headlines", "sections", "ladder", "explorer"), ()),
        provenance={"git": {}} | {key: {} for key in ("render", "packages", "data_md5", "twins_sha256")},
        title="board",
        verdicts=[("c", "adequate", verdict_words(ADEQUATE))],
    )
    assert "down to the floor.<p>These photographs would not show field curvature" in page


@pytest.mark.parametrize("parts", [1, 2])
def test_a_heading_stays_on_its_figure(monkeypatch, parts):
    """Fails if a camera's long name, or many effects, run out of a figure or of a part of one."""
    monkeypatch.syspath_prepend(ROOT / "notebooks")
    import figures

    figure = plt.figure(figsize=(parts * figures.WIDTH_IN, 3))
    for part in figure.subfigures(1, parts, squeeze=False)[0]:
        figures.head(
            part,
            "charuco_lifecam_1280_old_pattern: + radial distortion, tangential distortion, lens blur",
            fontweight="bold",
        )
        figure.canvas.draw()
        box = part._suptitle.get_window_extent()
        assert part.bbox.x0 <= box.x0 < box.x1 <= part.bbox.x1
    plt.close(figure)
