"""What the paper's run took is summed from its jobs, and its page gets the study's tables."""

import bench_paper
from workflow_runs import PROJECT


def write_job_times(folder, **seconds):
    """Write Snakemake's measurements of jobs {path with __ for /: CPU seconds}, 1 GiB and twice the clock's time each."""
    for name, cpu in seconds.items():
        path = folder / f"benchmarks/{name.replace('__', '/')}.tsv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"s\tmax_rss\tcpu_time\n{2 * cpu}\t1024\t{cpu}\n")


def test_a_detectors_edit_counts_its_own_jobs_and_what_follows(tmp_path):
    """Fails if renders or another detector's jobs count as run again, or the study as part of the run."""
    write_job_times(
        tmp_path, render_stations__a=600, detect_captures__a_aruco=60, detect_captures__a_bart=120, make_tables=30,
        run_figure3=30, study_twin__a=300, detect_captures__a_aruco_subpix=60,
    )  # fmt: skip
    figures = {what: (value, unit) for what, value, unit in bench_paper.figures_of(bench_paper.jobs_of(tmp_path))}
    told = [value for value, _ in figures.values()]
    assert told == [15.0, 30.0, 1.0, 2.0, 4.0, 5.0]


def test_the_page_has_a_place_for_the_tables():
    """Fails if tables are lost or doubled when the page is renewed, or the page lost their place."""
    page = (PROJECT / "docs/paper.md").read_text(encoding="utf-8")
    once = bench_paper.with_tables(page, "one\n")
    assert once.count("one\n") >= 1 and bench_paper.with_tables(once, "two\n") == bench_paper.with_tables(page, "two\n")
    assert "## Another experiment" in once
