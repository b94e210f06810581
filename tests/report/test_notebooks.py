"""The source notebooks: what papermill and git need of them, and that one runs from end to end."""

import json
from pathlib import Path

import cv2
import nbformat.v4
import numpy as np
import pandas as pd
import pytest

from aggregate.small_campaign import detection, write, write_tables
from build_report import build_report
from reporting.pages import heading_of
from reporting.sentences import ladder_rows, verdict_words
from run_notebook import run_notebook

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_has_one_parameters_cell(path):
    """Without the tag papermill only warns, and the notebook shows the default campaign, not the user's."""
    cells = json.loads(path.read_text())["cells"]
    tagged = [cell for cell in cells if "parameters" in cell["metadata"].get("tags", [])]
    assert len(tagged) == 1
    input_of_the_run = "experiment" if path.stem == "moving" else "campaign"
    for name in ("results", "project", input_of_the_run):
        assert f"{name} = " in "".join(tagged[0]["source"])


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_is_stored_without_outputs_for_python3(path):
    """Outputs in git would show old numbers; another kernel would not start in a fresh clone."""
    notebook = json.loads(path.read_text())
    assert notebook["metadata"]["kernelspec"]["name"] == "python3"
    for cell in notebook["cells"]:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run's folder with tables of the hand-made campaign."""
    results = tmp_path_factory.mktemp("run")
    found = [detection(s, c, k) for s in ("real", "twin") for c in "ab" for k in (0, 1)]
    arguments = write(results, found)
    write_tables(results, arguments, origin="simulated")
    for folder in ("expand", "tables", "aggregate"):
        (results / folder).mkdir()
    for name in ("markers.csv", "cameras.csv", "stations.csv", "captures.csv", "scene.json"):
        (results / name).rename(results / "expand" / name)
    for path in [*results.glob("table?.*"), results / "headlines.json"]:
        path.rename(results / "tables" / path.name)
    for path in results.glob("*.parquet"):
        path.rename(results / "aggregate" / path.name)
    return results


def execute(run, name, out):
    paths = {"results": run, "project": ROOT, "campaign": ""}
    template = ROOT / "scripts/reporting/page_template.html.j2"
    source = ROOT / f"notebooks/{name}.ipynb"
    run_notebook(source, paths, template, out / f"{name}.ipynb", out / f"{name}.html")
    return out / f"{name}.ipynb", (out / f"{name}.html").read_text(encoding="utf-8")


def test_page_is_self_contained_and_comes_out_the_same_again(run):
    """A page that fetches scripts shows nothing offline; one with clocks in it can never be compared."""
    _, first = execute(run, "figure3", run / "notebooks")
    assert "data:image/png;base64," in first
    for foreign in ("<script", 'src="http', 'href="http', "import matplotlib"):
        assert foreign not in first
    _, second = execute(run, "figure3", run / "again")
    assert first == second


def test_a_heading_that_code_displays_titles_the_page():
    """Fails if only a cell of text can name a page (a diagnosis begins with words about its baseline), or a later one does."""
    displayed = nbformat.v4.new_output("display_data", {"text/markdown": "# What has changed?\n\nOne twin."})
    code = nbformat.v4.new_code_cell("display(...)", outputs=[nbformat.v4.new_output("stream", text="# no"), displayed])
    notebook = nbformat.v4.new_notebook(cells=[code, nbformat.v4.new_markdown_cell("# Later")])
    assert heading_of(notebook) == ("What has changed?", "\nOne twin.")
    with pytest.raises(ValueError, match="no heading"):
        heading_of(nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell("Words alone")]))


def test_report_joins_pages_and_says_simulated(run):
    """The page where a reader starts must carry the pictures, the words and the warning."""
    notebook, _ = execute(run, "tables", run / "notebooks")
    (run / "provenance.json").write_text(
        json.dumps(
            {
                "git": {"commit": "abc", "changed_files": []},
                "render": {},
                "python": "3",
                "packages": {},
                "lock_sha256": "",
                "data_md5": {},
                "twins_sha256": {},
                "seed": "names",
            }
        )
    )
    names = ("markers", "cameras", "stations", "captures")
    page = run / "report/index.html"
    build_report(
        {name: run / f"expand/{name}.csv" for name in names},
        run / "expand/scene.json",
        [notebook],
        run / "tables/headlines.json",
        run / "provenance.json",
        [],
        None,
        "explore.html",
        ROOT / "scripts/reporting/report_template.html.j2",
        page,
    )
    html = page.read_text(encoding="utf-8")
    assert "simulated stand-in" in html
    assert "2 captures" in html and "rig with 4 markers" in html
    assert "of 6 markers in the pictures, aruco finds 66.7 %" in html
    assert html.count("data:image/") == 1
    assert 'href="explore.html"' in html
    assert 'href="tables.html"' in html and 'href="../tables/table1.csv"' in html


def test_the_ladder_ends_each_camera_with_its_floors(tmp_path):
    """If floors stood beside another camera's steps a reader would take an error for closed that is not."""
    measures = ["corner_rmse_px", "intensity_rmse_dn", "detection_disagreement_pct", "delta_distance_cm"]
    measures += ["delta_rotation_deg", "gap"]
    steps = [("a", 0, "ideal", 8.0, 1.0), ("a", 1, "lens_blur", 1.04, 1.0), ("b", 0, "ideal", None, 2.0)]
    table = [
        {"camera": c, "step": k, "effect": e, **dict.fromkeys(measures, v), **{f"{m}_floor": f for m in measures}}
        for c, k, e, v, f in steps
    ]
    pd.DataFrame(table).to_csv(tmp_path / "ladder.csv", index=False)
    headings, rows = ladder_rows(tmp_path / "ladder.csv")
    assert headings[:3] == ["camera", "twin", "corners, px"]
    assert [row[:3] for row in rows] == [
        ["a", "ideal", "8"],
        ["a", "+ lens blur", "1.04"],
        ["a", "floor", "1"],
        ["b", "ideal", ""],
        ["b", "floor", "2"],
    ]


def test_verdict_is_put_in_words_from_its_numbers():
    """If the words and the file disagreed a reader would adopt the wrong effect."""
    steps = [
        {"effect": "radial_distortion", "gap_before": 6.2, "gap_after": 2.0, "confused_with": []},
        {"effect": "lens_blur", "gap_before": 2.0, "gap_after": 1.04, "confused_with": ["motion_blur"]},
    ]
    steps[0]["parameters"] = {"k1": {"value": 0.1712, "se": 0.002}}
    where = [{"observable": "corner_dx", "covariate": "image_radius", "share": 0.71}]
    words = verdict_words({"verdict": "explained", "steps": steps, "where": where})
    assert "radial distortion (k1 0.1712 ± 0.0020) and lens blur;" in words
    assert "corner dx by image radius, which predicts 71 %" in words
    assert "from 6.20 to 1.04" in words
    assert "motion blur" in words
    assert "nothing is missing" in verdict_words({"verdict": "adequate", "steps": []})
    # photographs of a board tell of points alone: a verdict that does not say so would claim more than was looked at
    unseen = {"not_looked_at": {name: "only points are known" for name in "abc"}, "configured": []}
    said = verdict_words({"verdict": "adequate", "steps": []} | unseen)
    assert said.endswith("\n3 effects were not looked at: only points are known.")
    assert "looked" not in verdict_words(
        {"verdict": "adequate", "steps": []} | unseen | {"configured": [{"effect": "a"}]}
    )
    assert "no known effect closes" in verdict_words({"verdict": "unexplained", "steps": []})
    # what was not measured has no gap that an effect could leave
    undiagnosed = {"verdict": "unexplained", "steps": [], "why": "too few stations show plates"}
    assert verdict_words(undiagnosed) == "nothing could be diagnosed: too few stations show plates."


def test_distance_bins_hold_all_ranges(monkeypatch):
    """A range outside the bins would be drawn in the wrong cell of the heat map."""
    monkeypatch.syspath_prepend(ROOT / "notebooks")
    import figures

    for ranges in ([0.4, 2.2], [1.0, 1.0], [0.35], [3.0, 40.0]):
        edges = figures.distance_bins(pd.Series(ranges))
        assert edges[0] <= min(ranges) and max(ranges) <= edges[-1] + 1e-9
        assert (np.diff(edges) > 0).all()


def test_captures_and_twins_are_shown_on_one_scale(tmp_path, monkeypatch):
    """Grey images stretched each by itself, the twin would look darker than the capture that it equals."""
    monkeypatch.syspath_prepend(ROOT / "notebooks")
    import diagnosis_figures

    folder = tmp_path / "diagnosis/cam"
    folder.mkdir(parents=True)
    for name in diagnosis_figures.EXAMPLES:
        image = np.full((20, 30) if name != "real" else (20, 30, 3), 90, np.uint8)
        image[5:9] = 160
        cv2.imwrite(str(folder / f"example_{name}.png"), image)
    figure = diagnosis_figures.example_figure(tmp_path, "cam")
    shown = [axis.images[0] for axis in figure.axes[:3]]
    real, *twins = (image.to_rgba(image.get_array()) for image in shown)
    for twin in twins:
        np.testing.assert_allclose(twin, real, atol=1 / 255)
