"""Adopting is one command, keeps what people wrote, and leaves nothing half-written."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import adopt_effect
from inputs.twins import load_twin

STEP = {
    "effect": "lens_blur",
    "parameters": {"sigma_px": {"value": 0.8312345678, "se": 0.011}},
    "gap_before": 3.2,
    "gap_after": 1.4,
    "gap_after_se": 0.1,
    "confused_with": [],
}
SPREAD = STEP | {"effect": "ink_spread", "parameters": {"spread_m": {"value": 0.0000212, "se": 1e-6}}}
CANDIDATE = {"effect": "vignetting", "gap_after": 2.5, "se": 0.1, "rank": 3, "parameters": {"a2": 0.21, "a4": -0.02}}
WRITTEN = """\
# measured on the bench in May
effects:
  - effect: radial_distortion # from the data sheet
    parameters: {k1: -0.1, k2: 'fit'}
  # the ring light
  - effect: vignetting
    parameters:
      a2: 0.3 # by eye
    origin: by hand
  # white balance, last
  - effect: colour_balance
    parameters:
      red_gain: 1.10
"""


SCRIPTS = Path(adopt_effect.__file__).parent
CLOSED = "error: standard output: what reads it has closed it\n"
# In Snakemake's place: a diagnosis that knows the twin it was made for, and goes on with another effect.
DIAGNOSING = """
import json, pathlib
diagnosis = pathlib.Path("results/c/diagnosis/cam.json")
told = json.loads(diagnosis.read_text())
steps = told["steps"] + [told["steps"][0] | {"effect": "exposure", "parameters": {"scale": {"value": 1.1, "se": 0.01}}}]
twin = pathlib.Path("config/twins/c/cam.yaml").read_text()
diagnosis.write_text(json.dumps(told | {"steps": steps, "made_for": twin}))
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Work in an empty project folder with one diagnosed camera."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "results/c/diagnosis"
    folder.mkdir(parents=True)
    diagnosis = {"campaign": "c", "camera": "cam", "verdict": "explained", "steps": [STEP, SPREAD]}
    (folder / "cam.json").write_text(json.dumps(diagnosis | {"candidates": [CANDIDATE]}))
    (tmp_path / "config/twins/c").mkdir(parents=True)
    return tmp_path / "config/twins/c/cam.yaml"


def run(*arguments):
    """Run the command as the shell would; return its exit status."""
    try:
        adopt_effect.main([*arguments, "--campaign", "c"])
    except SystemExit as end:
        return end.code or 0
    return 0


def test_the_verdicts_effects_one_after_the_other(place, capsys):
    """The user types one word per effect; the third time there is nothing left, and that is said."""
    assert run("cam") == 0
    assert load_twin(place).effects == [("lens_blur", {"sigma_px": 0.8312, "softness": 1.0})]
    assert "3.20 -> 1.40" in place.read_text() and "+- 0.011" in place.read_text()
    assert run("cam") == 0
    assert load_twin(place).effects[0] == ("ink_spread", {"spread_m": 0.0000212})
    before = place.read_text()
    assert run("cam") == 1
    assert place.read_text() == before


def test_a_lens_too_small_for_a_name_is_adopted_as_the_whole_lens_has_it(place, tmp_path):
    """Fails if of a board's small terms the values of a candidate fitted alone are written, or none."""
    path = tmp_path / "results/c/diagnosis/cam.json"
    whole = {
        "effect": CANDIDATE["effect"],
        "parameters": {k: {"value": v, "se": 0.01} for k, v in CANDIDATE["parameters"].items()},
    }
    first = next(iter(whole["parameters"]))
    whole["parameters"][first] = {"value": 0.125, "se": 0.01}
    path.write_text(json.dumps(json.loads(path.read_text()) | {"whole_lens": {"effects": [whole]}}))
    assert run("cam", CANDIDATE["effect"]) == 0
    assert "fitted with the whole lens" in place.read_text() and f"{first}: 0.125" in place.read_text()


@pytest.mark.parametrize(("effect", "beside"), [("radial_distortion", ["focal_length"]), ("lens_blur", [])])
def test_a_lens_brings_the_focal_length_that_was_fitted_beside_it(place, tmp_path, effect, beside):
    """Fails if a lens is taken without the focal length that it was found with, or a blur with one; or anything twice."""
    path = tmp_path / "results/c/diagnosis/cam.json"
    lens = STEP | {"effect": "radial_distortion", "parameters": {"k1": {"value": -0.25, "se": 0.01}}}
    nuisances = {"focal_length": {"ratio": 1.2}, "exposure": {"scale": 1.3}}
    path.write_text(json.dumps(json.loads(path.read_text()) | {"steps": [lens, STEP], "nuisances": nuisances}))
    assert run("cam", effect) == 0
    assert sorted(dict(load_twin(place).effects)) == sorted([effect, *beside])
    assert run("cam") == 0
    assert sorted(dict(load_twin(place).effects)) == ["focal_length", "lens_blur", "radial_distortion"]
    assert place.read_text().count("ratio: 1.2") == 1


def test_comments_and_order_are_kept(place):
    """A file that people keep must not be rewritten behind their backs."""
    place.write_text(WRITTEN)
    assert run("cam", "lens_blur") == 0
    text = place.read_text()
    for comment in ("measured on the bench in May", "from the data sheet", "the ring light", "by eye", "balance, last"):
        assert comment in text
    places = [text.index(name) for name in ("radial_distortion", "vignetting", "colour_balance", "lens_blur")]
    assert places == sorted(places)
    assert "'fit'" in text and "1.10" in text


def test_adopting_beside_a_number_adds_the_others(place):
    """Fails if an effect that stands already is written a second time, or the number that stands there is written anew."""
    place.write_text(WRITTEN)
    assert run("cam", "vignetting") == 0
    text = place.read_text()
    assert text.count("vignetting") == 1 and "# by eye" in text
    assert dict(load_twin(place).effects)["vignetting"] == {"a2": 0.3, "a4": -0.02, "a6": 0.0}


@pytest.mark.parametrize("number", ["0.123456789", "1.234567891e-1", "0.30", "1"])
def test_a_number_stays_as_it_was_written(place, number, capsys):
    """Fails if what the user fixed beside a `fit` is rounded, written in another way, or told otherwise than it stands."""
    given = f"effects:\n  - effect: vignetting\n    parameters: {{a2: {number}, a4: fit, a6: 0.0}}\n"
    place.write_text(given)
    assert run("cam", "vignetting") == 0
    kept, _, origin = place.read_text().partition("    origin:")
    assert kept == given.replace("fit", "-0.02") and "candidate of the diagnosis" in origin
    assert f"a2 = {float(number):g}, a4 = -0.02" in capsys.readouterr().out


def test_a_number_of_the_twin_that_is_extended_comes_with_all_digits(place):
    """Fails if what the user fixed in the file that this one extends is fitted anew, or rounded, where the entry is copied."""
    base = "effects:\n  - effect: vignetting\n    parameters: {a2: 0.123456789, a4: fit}\n"
    place.with_name("base.yaml").write_text(base)
    place.write_text("extends: base.yaml\n")
    assert run("cam", "vignetting") == 0
    assert place.with_name("base.yaml").read_text() == base
    assert dict(load_twin(place).effects)["vignetting"] == {"a2": 0.123456789, "a4": -0.02, "a6": 0.0}


def test_an_effect_whose_numbers_all_stand_is_not_adopted(place, capsys):
    """Fails if numbers of the user pass for the diagnosis's: its origin beside them, and success told."""
    given = "effects:\n  - effect: vignetting\n    parameters: {a2: 0.123456789, a4: 0.01}\n    origin: by hand\n"
    place.write_text(given)
    assert run("cam", "vignetting") == 1
    assert place.read_text() == given and "write `fit`" in capsys.readouterr().err


def test_adopt_and_remove_is_a_round_trip(place):
    """Taking out is as easy, and what others wrote stays byte for byte."""
    place.write_text(WRITTEN)
    assert run("cam", "--remove", "vignetting") == 0
    taken_out = WRITTEN[WRITTEN.index("  - effect: vignetting") : WRITTEN.index("  # white balance")]
    assert place.read_text() == WRITTEN.replace(taken_out, "")
    for name in ("radial_distortion", "colour_balance"):
        assert run("cam", name, "--remove") == 0
    assert load_twin(place).effects == []
    assert "# measured on the bench in May" in place.read_text()
    assert run("cam") == 0
    assert [n for n, _ in load_twin(place).effects] == ["lens_blur"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("cam", "no_such"),
        ("other",),
        ("cam", "sharpening"),
        ("cam", "--remove"),
        ("cam", "lens_blur", "--auto"),
        ("cam", "--remove", "exposure"),
    ],
)
def test_what_cannot_be_done_is_said(place, arguments, capsys):
    """Status 1 and one message; no file appears."""
    assert run(*arguments) == 1
    assert not place.exists()
    assert "Traceback" not in capsys.readouterr().err


def test_a_wrong_file_is_not_built_upon(place):
    """Adopting into a broken file would hide the break."""
    place.write_text("effects:\n  - effect: lens_blur\n    parameters: {sigma_px: 900}\n")
    before = place.read_text()
    assert run("cam", "ink_spread") == 1
    assert place.read_text() == before
    assert [p.name for p in place.parent.iterdir()] == ["cam.yaml"]


DRY_RUN = """\
Job stats:
job                count
---------------  -------
all                    1
expose_twin            1
render_stations        2
total                  4

Reasons:
"""


def test_auto_adopts_until_nothing_is_left(place, monkeypatch, capsys):
    """All steps are adopted and diagnosed again; at the end stands the verdict and what will rerun."""
    folder = place.parents[3] / "data/raw/c"
    folder.mkdir(parents=True)
    (folder / "campaign.yaml").write_text("name: c\n")
    diagnosis = place.parents[3] / "results/c/diagnosis/cam.json"
    calls = []

    def snakemake(campaign, *arguments):
        calls.append(arguments)
        if "-n" not in arguments:
            after = json.loads(diagnosis.read_text()) | {"verdict": "adequate", "steps": []}
            diagnosis.write_text(json.dumps(after))
        return subprocess.CompletedProcess([], 0, DRY_RUN, "")

    monkeypatch.setattr(adopt_effect, "snakemake", snakemake)
    assert run("cam", "--auto") == 0
    assert [n for n, _ in load_twin(place).effects] == ["ink_spread", "lens_blur"]
    assert calls[0][0] == "results/c/diagnosis/cam.json" and len(calls) == 2
    said = capsys.readouterr().out
    assert "verdict on cam is now: adequate" in said
    assert "expose_twin x 1, render_stations x 2" in said and "Nothing is rendered" not in said


@pytest.fixture
def project(place):
    """Return the folder of ``place`` with a campaign in it that can be diagnosed again by another process."""
    folder = place.parents[3]
    (folder / "data/raw/c").mkdir(parents=True)
    (folder / "data/raw/c/campaign.yaml").write_text("name: c\n")
    (folder / "snakemake.py").write_text(DIAGNOSING)
    return folder


def piped(project, *command, lines=0):
    """Run Python in a process of its own; close its standard output after ``lines`` lines; return (status, stderr)."""
    reading, writing = os.pipe()
    if not lines:
        os.close(reading)
    command = [sys.executable, *command]
    buffered = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    process = subprocess.Popen(command, cwd=project, env=buffered, stdout=writing, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    if lines:
        with open(reading) as output:
            for _ in range(lines):
                output.readline()
    return process.wait(), process.stderr.read()


@pytest.mark.parametrize(("lines", "adopted"), [(0, []), (1, ["ink_spread", "lens_blur"])])
def test_a_closed_pipe_ends_auto_between_whole_adoptions(place, project, lines, adopted):
    """Fails if `--auto | head` leaves an effect in the twin's file that the diagnosis does not know."""
    status, said = piped(project, adopt_effect.__file__, "cam", "--auto", "--campaign", "c", lines=lines)
    assert (status, said) == (1, CLOSED)
    assert [n for n, _ in load_twin(place).effects] == adopted
    diagnosis = json.loads((project / "results/c/diagnosis/cam.json").read_text())
    assert diagnosis.get("made_for") == (place.read_text() if adopted else None)


def test_an_adoption_that_nobody_reads_of_is_whole(place, project):
    """Fails if the interpreter flushes to a closed pipe as it ends: a traceback, and status 120."""
    said = piped(project, adopt_effect.__file__, "cam", "lens_blur", "--campaign", "c")
    assert said == (1, CLOSED)
    assert dict(load_twin(place).effects) == {"lens_blur": {"sigma_px": 0.8312, "softness": 1.0}}


def test_bad_input_stays_the_message_where_the_pipe_is_closed_too(project):
    """Fails if what was printed before is flushed as the interpreter ends."""
    code = "import job\njob.set_up_log()\nwith job.one_message():\n print('x')\n raise job.InputError('y')"
    (project / "told.py").write_text(f"import sys\nsys.path.insert(0, {str(SCRIPTS)!r})\n{code}\n")
    assert piped(project, "told.py") == (1, "error: y\n")
