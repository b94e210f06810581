"""Names of blind trials, that say nothing of what is hidden; light, because every start of snakemake reads them."""

import hashlib

KINDS = ("single", "pair", "none", "outside", "power", "whole", "real")
BASELINE, CHANGED = "baseline", "changed"  # the two campaigns of a trial on real photographs
POWER_STRENGTHS = (0.25, 0.5, 1.0)


def identity(kind, index, seed, effect=None, strength=None, size="standard"):
    """Return (the campaign's name, the name that seeds it, its strength) of a trial.

    Without ``strength``: 1, and for ``power`` the ``POWER_STRENGTHS`` in turn.
    """
    if strength is None:
        strength = POWER_STRENGTHS[index % len(POWER_STRENGTHS)] if kind == "power" else 1.0
    trial_seed = f"{seed}/{kind}/{index}/{effect}/{strength}/{size}"
    return "t" + hashlib.blake2b(trial_seed.encode(), digest_size=4).hexdigest(), trial_seed, strength


def names_of(counts, seed, size):
    """Return {name: (kind, index)} of all trials; ``counts`` is {kind: number}."""
    return {
        identity(kind, index, seed, size=size)[0]: (kind, index)
        for kind in KINDS
        for index in range(counts.get(kind, 0))
    }
