"""Where the gap lives: what is wrong everywhere must not read as if it followed the trial's number."""

import numpy as np
import pandas as pd
import pytest

from gap.explain.where import COVARIATES, EXPLAINED, explained_shares


def plates(overshoot):
    """Return a table of plates whose covariates are unrelated and whose gap in ``overshoot`` is a function of them."""
    rng = np.random.default_rng(3)
    n = 600
    table = pd.DataFrame({name: rng.uniform(0, 1, n) for name in COVARIATES})
    table["trial"] = rng.integers(0, 2, n)
    table["capture"] = np.where(rng.random(n) < 0.5, "train", "test")
    for observables in EXPLAINED.values():
        for name in observables:
            table[name] = rng.normal(0, 0.01, n)
    table["overshoot"] += overshoot(table)
    return table


@pytest.mark.parametrize(
    ("overshoot", "named"),
    [
        (lambda t: 0.5, ["everywhere"]),
        (lambda t: 0.5 * (t.distance_m - 0.5), ["distance_m"]),
        (lambda t: 0.3 + 0.4 * t.image_radius, ["image_radius", "everywhere"]),
    ],
)
def test_a_covariate_is_named_for_what_it_adds(overshoot, named):
    """A gap alike everywhere is predicted by every covariate's bins: ten of them would hide that none matters."""
    rows = [r for r in explained_shares(plates(overshoot), ["train"]) if r["observable"] == "overshoot"]
    assert [r["covariate"] for r in rows if r["share"] > 0.1] == named
    assert rows[0]["share"] > 0.9
