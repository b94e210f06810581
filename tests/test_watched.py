"""Bounds that keep account of what is compared with them, and the page that tells what half and double of each turn."""

from types import ModuleType

import numpy as np
import pandas as pd
import pytest

import bench_bounds
import watched
from workflow_runs import PROJECT


@pytest.fixture
def module(monkeypatch):
    """Return a module of two watched constants."""
    monkeypatch.setattr(watched, "counts", {})
    made = ModuleType("made")
    exec("SHARE, MANY = 0.5, 4\ndef closes(gain, share=SHARE):\n    return gain > share / (1 - share)\n", vars(made))
    watched.watch([made], ["SHARE", "MANY"])
    return made


def told(name):
    """Return (compared, turned by half, turned by double)."""
    return tuple(watched.counts[name][key] for key in ("compared", *watched.SCALES))


@pytest.mark.parametrize(
    ("value", "turned"), [(0.3, (1, 1, 0)), (0.7, (1, 0, 1)), (1.5, (1, 0, 0)), (np.float64(0.3), (1, 1, 0))]
)
def test_a_comparison_knows_what_half_and_double_would_say(module, value, turned):
    """Fails if a bound answers otherwise than a plain number, or if a turn goes uncounted, from numpy's numbers too."""
    assert bool(value > module.SHARE) == bool(value > 0.5) and told("SHARE") == turned


def test_what_is_computed_from_a_bound_keeps_account(module):
    """Fails if a product, a default of a function or an array's comparison forgets the bound, or a doubled share of 1 raises."""
    assert module.closes(2.0) and told("SHARE") == (1, 0, 1)
    assert (np.array([0.3, 0.7]) > 0.5 * module.SHARE).all() and told("SHARE") == (2, 0, 2)
    assert 3 < module.MANY and told("MANY") == (1, 1, 0)
    assert [*range(9)][: module.MANY] == [0, 1, 2, 3]


def test_the_page_of_bounds_is_what_its_table_makes():
    """Fails if the page was edited by hand, or if a bound of the method is missing from it."""
    table = pd.read_csv(PROJECT / "docs/bounds.csv", dtype={"commit": str})
    for _, of_run in table.groupby("run"):
        assert of_run.bound.tolist() == bench_bounds.bounds_of_method()
    assert (PROJECT / "docs/bounds.md").read_text(encoding="utf-8") == bench_bounds.page_of(table)


def test_runs_are_added_and_done_anew():
    """Fails if a run that is done again counts twice, or takes another's rows with it."""
    name = bench_bounds.bounds_of_method()[0]
    rows = {n: bench_bounds.table_of([{name: (n, n, 0)}]) for n in (5, 3, 4)}
    table = bench_bounds.with_run(rows[5].assign(run="a", commit="1"), "b", "2", rows[3])
    table = bench_bounds.with_run(table, "b", "3", rows[4])
    assert table[table.bound == name][["run", "commit", "compared"]].to_numpy().tolist() == [
        ["a", "1", 5],
        ["b", "3", 4],
    ]
    line = next(line for line in bench_bounds.page_of(table).splitlines() if line.startswith(f"| {name} "))
    assert [cell.strip() for cell in line.split("|")[2:4]] == ["9", "9 in 2"]


def test_counts_of_trials_are_added():
    """Fails if trials in which something turned are counted as often as it did."""
    name = bench_bounds.bounds_of_method()[0]
    row = bench_bounds.table_of([{name: (5, 2, 0)}, {name: (3, 1, 0)}, {}]).iloc[0]
    assert row[["compared", "half", "double", "trials_half", "trials_double", "trials"]].tolist() == [8, 3, 0, 2, 0, 3]
