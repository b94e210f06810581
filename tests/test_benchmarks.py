"""docs/benchmarks.md says what docs/benchmarks.csv holds, and a measurement replaces the one before it."""

import subprocess

import pandas as pd
import pytest
import yaml

import bench_board_cells
import bench_bounds
import bench_hand_motion
import bench_photographs
import bench_real_boards
import bench_size
import bench_slurm
import bench_turned_boards
import record
import run_benchmarks
from trials.summarise_trials import summary_of
from trials.trial_names import KINDS
from workflow_runs import PROJECT, numbers_of


def row(what, command, **more):
    """Return a row of figures, measured unless it is told otherwise."""
    stamp = {"figure": "1", "unit": "px", "commit": "0123456", "date": "2026-01-02", "machine": "a machine"}
    return {"what": what, "aim": "", **stamp, "command": command, **more}


def table(*rows):
    """Return a table of figures."""
    return pd.DataFrame(rows, columns=record.COLUMNS, dtype=str)


def test_the_page_is_what_the_table_makes():
    """Fails if the page was edited by hand, or the table without writing the page."""
    figures = record.read_figures(PROJECT / "docs/benchmarks.csv")
    assert (PROJECT / "docs/benchmarks.md").read_text(encoding="utf-8") == record.page_of(figures)


def test_every_row_of_a_benchmark_or_with_an_aim_is_one_that_is_recorded():
    """Fails if a figure is recorded under another name than the table's: it would stand there twice, once without its aim."""
    recording = [*(PROJECT / "tests/bench").glob("*.py"), PROJECT / "scripts/trials/summarise_trials.py"]
    texts = [path.read_text(encoding="utf-8") for path in recording]
    figures = record.read_figures(PROJECT / "docs/benchmarks.csv")
    by_hand = figures.command.str.startswith("time make") | figures.figure.str.startswith("not made")
    told = figures[figures.command.str.startswith("python tests/bench/") | ((figures.aim != "") & ~by_hand)]
    assert len(told) and [what for what in told.what if not any(f'"{what}"' in text for text in texts)] == []


def test_no_figure_stands_twice():
    """Fails if two rows have one name and one command: a measurement would renew only the first."""
    figures = record.read_figures(PROJECT / "docs/benchmarks.csv")
    assert not figures.duplicated(["what", "command"]).any()


def test_a_measurement_replaces_the_last_one_and_keeps_its_aim():
    """Fails if a row is added instead, another command's row is touched, or the aim is lost."""
    old = table(row("blur", "a", aim="at most 2 px"), row("blur", "b"), row("edges", "a"))
    new = record.upsert(old, [{k: v for k, v in row("blur", "a", figure="3").items() if k != "aim"}])
    assert (
        new.values.tolist()
        == table(row("blur", "a", aim="at most 2 px", figure="3"), row("blur", "b"), row("edges", "a")).values.tolist()
    )
    assert old.figure[0] == "1"


def test_a_first_measurement_fills_the_row_that_waits_for_it():
    """Fails if a row without command stays as not measured beside its figure."""
    waiting = row("blur", "", aim="0", figure="", unit="", commit="", date="", machine="")
    new = record.upsert(table(waiting), [{k: v for k, v in row("blur", "a").items() if k != "aim"}])
    assert new.values.tolist() == table(row("blur", "a", aim="0")).values.tolist()


def test_a_figure_that_the_table_lacks_is_added_at_its_end():
    """Fails if it is dropped, or takes the place of another."""
    assert record.upsert(table(row("blur", "a")), [row("noise", "a")]).what.tolist() == ["blur", "noise"]


def test_a_new_command_takes_the_aim_of_its_figure():
    """Fails if what `make bench` measures stands without the aim that another command's row of the same name has."""
    old = table(row("blur", "by hand"), row("blur", "a", aim="at most 2 px"), row("edges", "a", aim="0"))
    measured = [{k: v for k, v in row(what, "b").items() if k != "aim"} for what in ("blur", "noise")]
    assert record.upsert(old, measured).aim.tolist() == ["", "at most 2 px", "0", "at most 2 px", ""]


def test_what_nobody_measured_is_said_on_the_page():
    """Fails if an empty figure looks like a figure, or figures as text lose digits."""
    assert record.NOT_MEASURED in record.page_of(table(row("blur", "a", figure="")))
    assert " 0.20 " in record.page_of(table(row("noise", "a", figure="0.20", unit=""), row("blur", "a", unit="")))


def test_growth_is_shown_where_it_was_measured():
    """Fails if the picture of growth is on no page, or on one without its figures."""
    growth = row("plan", "python tests/bench/bench_growth.py 100")
    assert "](growth.png)" in record.page_of(table(growth)) and (PROJECT / "docs/growth.png").is_file()
    assert "growth.png" not in record.page_of(table(row("blur", "a")))


def test_recording_writes_table_and_page(tmp_path):
    """Fails if a benchmark's figures do not reach the page, or their date, machine and commit are left out."""
    path = tmp_path / "benchmarks.csv"
    table(row("blur", "a", aim="2")).to_csv(path, index=False)
    record.record([("blur", 0.123456, "px"), ("count", 7, "files")], command="a", table_path=path)
    figures = record.read_figures(path)
    assert figures.figure.tolist() == ["0.12", "7"] and figures.aim.tolist() == ["2", ""]
    assert (figures[["commit", "date", "machine"]] != "").all(axis=None)
    assert path.with_suffix(".md").read_text() == record.page_of(figures)


@pytest.mark.parametrize(("figure", "text"), [(0.00123456, "0.0012"), (5.44, "5.4"), (25.63, "26"), (412.4, "412")])
def test_numbers_have_two_digits_that_count(figure, text):
    """Fails if small figures are rounded to nothing or large ones lose whole units."""
    assert record.as_text(figure) == text


def test_a_commit_with_changes_is_marked(tmp_path):
    """Fails if figures of changed code pass as those of a commit; the page that they are written to is no change."""

    def git(*arguments):
        subprocess.run(["git", "-C", str(tmp_path), *arguments], check=True, capture_output=True)

    assert record.commit_of(tmp_path) == "unknown"
    git("init", "-q")
    (tmp_path / "docs").mkdir()
    for name in ("code.py", "docs/benchmarks.csv"):
        (tmp_path / name).write_text("1\n")
    git("add", ".")
    git("-c", "user.name=a", "-c", "user.email=a@b", "commit", "-qm", "first")
    (tmp_path / "docs/benchmarks.csv").write_text("2\n")
    clean = record.commit_of(tmp_path)
    assert len(clean) == 7
    (tmp_path / "code.py").write_text("2\n")
    assert record.commit_of(tmp_path) == f"{clean}+"


def outcome(folder):
    """Write summary.csv and power.csv of ten single trials, four with nothing hidden and eight parameters to ``folder``."""
    single = [
        {"kind": "single", "hidden": "a", "named": "a", "first_right": k > 0, "set_right": False} for k in range(10)
    ]
    nothing = [{"kind": "none", "hidden": "", "named": ""} for _ in range(4)]
    trials = pd.DataFrame(single + nothing).assign(strength=1.0, verdict="adequate", gap=0.9, said_unseen=False)
    parameters = pd.DataFrame({"inside_95": [True] * 7 + [False], "miss": [0.1 * k for k in range(1, 8)] + [2.5]})
    summary_of(trials, parameters).to_csv(folder / "summary.csv", index=False)
    (folder / "power.csv").write_text("hidden,0.25,0.5,smallest_seen,was\na,1.0,1.0,0.25,x\nb,0.0,1.0,0.5,y\n")


def test_outcomes_of_blind_trials_become_figures(tmp_path):
    """Fails if figures are read from columns that no summary has, counts are no whole numbers, or an interval is left out."""
    outcome(tmp_path)
    figures = {what: (figure, unit) for what, figure, unit in run_benchmarks.trial_figures(tmp_path)}
    assert figures["single effects: the right one first"] == ("9 of 10 (60 to 98 %)", "")
    assert figures["stated 95 % intervals that hold the truth"] == ("7 of 8 (53 to 98 %)", "")
    assert figures["stated errors: median miss"] == ("0.45 (0.1 to 2.5)", "standard errors")
    assert figures["a quarter of the clear strength: named alone"] == ("1 of 2", "")
    assert not [what for what in figures if what.startswith("two effects")]


def test_bounds_without_trials_are_those_of_their_page():
    """Fails if `make bench`, which names no trial, measures no bounds, or others than the page's are looked at."""
    page = (PROJECT / "docs/bounds.md").read_text(encoding="utf-8")
    assert all(f"bench_bounds.py {run}`" in page for run in bench_bounds.RUNS)


def test_trials_on_photographs_are_run_where_these_are(tmp_path, capsys):
    """Fails if `make bench` breaks off for want of photographs, leaves them out where they are, or says nothing of it."""
    project = tmp_path / "project"
    project.mkdir()
    assert "real" not in run_benchmarks.trial_counts(project) and run_benchmarks.PHOTOGRAPHS in capsys.readouterr().out
    (project / run_benchmarks.PHOTOGRAPHS).mkdir(parents=True)
    counts = yaml.safe_load(run_benchmarks.trial_counts(project).removeprefix("blind_trials="))
    assert counts["photographs"] == run_benchmarks.PHOTOGRAPHS and capsys.readouterr().out == ""
    assert {*counts} - {"photographs"} == {*KINDS} and min(counts["none"], counts["real"]) >= 200  # as the aims ask


@pytest.mark.parametrize("bench", [bench_board_cells, bench_size])
@pytest.mark.parametrize(("asked", "status"), [("--help", 0), ("--misspelt", 2)])
def test_help_measures_nothing(monkeypatch, bench, asked, status):
    """Fails if asking for help, or an option that is not there, measures and records."""
    monkeypatch.setattr(bench, "record", None)
    with pytest.raises(SystemExit) as left:
        bench.main([asked])
    assert left.value.code == status


@pytest.mark.parametrize("bench", [bench_hand_motion, bench_photographs, bench_real_boards, bench_turned_boards])
def test_without_photographs_nothing_is_recorded(tmp_path, monkeypatch, bench):
    """Fails if figures that stand already are recorded as of today, or a traceback is all that is said."""
    monkeypatch.setattr(bench, "REAL", tmp_path / "real")
    monkeypatch.setattr(bench, "record", None)
    with pytest.raises(SystemExit, match="needs the photographs"):
        bench.main([])


def test_every_benchmark_with_an_aim_is_run():
    """Fails if `make bench` leaves an aim unmeasured, or names a benchmark that is not there."""
    files = {path.stem.removeprefix("bench_"): path for path in (PROJECT / "tests/bench").glob("bench_*.py")}
    figures = record.read_figures(PROJECT / "docs/benchmarks.csv")
    aims = set(figures.what[figures.aim != ""])
    measuring = {name for name, path in files.items() if any(f'"{what}"' in path.read_text() for what in aims)}
    apart = {"fuzz", "kills", "mishaps", "paper", "studies"}  # have commands of their own (Makefile, docs/markers.md)
    assert measuring - apart <= {*run_benchmarks.SCRIPTS} <= {*files}


def test_an_unknown_benchmark_is_refused(capsys):
    """Fails if a misspelt name measures nothing and says so to nobody, or measures all."""
    with pytest.raises(SystemExit):
        run_benchmarks.main(["geometri"])
    assert "geometry" in capsys.readouterr().err


def test_a_run_that_differs_is_told(tmp_path):
    """Fails if two runs pass for equal though a table differs, is missing or is new; or if times count as numbers."""
    for side, tables in (("here", {"a": "1", "b": "2", "c": "3"}), ("there", {"a": "1", "b": "9", "d": "4"})):
        for name, text in (tables | {f"x_{side}_timing": "5"}).items():
            path = tmp_path / side / f"detect/left/{name}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
    first, second = numbers_of(tmp_path / "here"), numbers_of(tmp_path / "there")
    assert bench_slurm.differing(first, second) == [f"detect/left/{name}.csv" for name in "bcd"]
