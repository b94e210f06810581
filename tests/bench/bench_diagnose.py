"""What a verdict costs: ``python tests/bench/bench_diagnose.py [--effects NAME ...] [--beside COMMIT]``.

Generates one campaign an effect (20 captures of half a megapixel, one camera; nothing is hidden in ``nothing``, eight
effects in ``eight``) and times ``snakemake --cores 2 diagnose`` of it, all candidates, in a copy of the project; with the
largest memory of any one process. Beside an earlier commit, both are timed in turn, after a campaign with nothing hidden that lets
each compile. Figures are recorded (record.py).
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests"), str(ROOT / "tests/bench")]

import pandas as pd

from record import record
from trials.generate_trials import generate_trial
from workflow_runs import copy_project, snakemake

NOTHING = "nothing"
EIGHT = "eight"  # effects at once, of a whole camera
EIGHT_SEED, EIGHT_INDEX = "gorse", 0
EFFECTS = (NOTHING, "lens_blur", "radial_distortion", "specular_highlight", "sensor_noise", EIGHT)
LONGEST_S = 3600


def timed(folder, project, effect):
    """Return a row: what is hidden, the verdict, its seconds."""
    kinds = {NOTHING: ("none", 0, "cost"), EIGHT: ("whole", EIGHT_INDEX, EIGHT_SEED)}
    drawn = kinds.get(effect, ("single", 0, "cost", effect))
    name, _ = generate_trial(folder / "campaigns", folder / "sealed_truths", *drawn)
    start = time.perf_counter()
    status, said = snakemake(
        project, "--cores", 2, "diagnose", "--config", f"campaign={folder / 'campaigns' / name}", timeout_s=LONGEST_S
    )
    seconds = time.perf_counter() - start
    if status:
        sys.exit(said[-5000:])
    (file,) = (project / "results" / name / "diagnosis").glob("*.json")
    verdict = json.loads(file.read_text())
    named = ", ".join(step["effect"] for step in verdict["steps"])
    return {"hidden": effect, "verdict": verdict["verdict"], "named": named, "s": round(seconds, 1)}


def project_at(commit, folder):
    """Return a clone, in a folder, of the project at an earlier commit."""
    subprocess.run(["git", "clone", "-q", str(ROOT), str(folder)], check=True)
    subprocess.run(["git", "-C", str(folder), "checkout", "-q", commit], check=True)
    return folder


def table_of(folder, effects, commit):
    """Return the table of some effects' verdicts and seconds, ``s_before`` those of an earlier commit, where one is given."""
    project = copy_project(folder / "project")
    if commit is None:
        return pd.DataFrame([timed(folder, project, effect) for effect in effects])
    before = project_at(commit, folder / "before")
    for either in (project, before):
        timed(folder, either, NOTHING)
    rows = [timed(folder, project, effect) | {"s_before": timed(folder, before, effect)["s"]} for effect in effects]
    return pd.DataFrame(rows)


def main():
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--effects", nargs="+", default=EFFECTS)
    parser.add_argument("--beside", metavar="COMMIT")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = table_of(Path(folder), given.effects, given.beside)
    print(rows.to_markdown(index=False))
    gib = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
    print(f"\nmedian {rows.s.median():.0f} s; largest memory of one process {gib:.2f} GiB")
    nothing, eight = rows[rows.hidden == NOTHING].s, rows[rows.hidden == EIGHT].s
    single = rows[~rows.hidden.isin([NOTHING, EIGHT])].s
    figures = [("diagnosis of one camera, largest memory of one process", gib, "GiB")]
    if len(nothing):
        figures.append(("diagnosis of one camera, 20 captures: nothing hidden", nothing.median(), "s"))
    if len(single):
        span = f"{single.min():.0f} to {single.max():.0f}"
        figures.append(
            ("diagnosis of one camera, 20 captures: a single effect", span, f"s{ratio_words(rows, given.beside)}")
        )
    if len(eight):
        figures.append(("diagnosis of one camera, 20 captures: eight effects", eight.median() / 60, "min"))
    record(figures)


def ratio_words(rows, commit):
    """Return how many times as fast single effects are as at an earlier commit, in words; none where nothing is beside."""
    if commit is None:
        return ""
    single = rows[~rows.hidden.isin([NOTHING, EIGHT])]
    times = single.s_before / single.s
    return f"; {times.min():.1f} to {times.max():.1f} times as fast as {commit} in the same run"


if __name__ == "__main__":
    main()
