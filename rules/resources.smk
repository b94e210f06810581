"""Resources: the memory and the time that a job asks for on a cluster, by what jobs were measured to take.

Needs: the names of rules/common.smk, config/resources.csv. Makes: nothing.
"""

import math

import pandas as pd

# What jobs were measured to take (`python tests/bench/bench_resources.py RESULTS`), and what they ask for above that.
MEASURED = pd.read_csv("config/resources.csv", index_col="rule")
MEASURED_MEGAPIXELS = 0.5
MEGAPIXEL_MB = 130  # of a render job, from 0.5 to 8.3 megapixels
SPARE_MEMORY, SPARE_TIME, SPARE_MINUTES = 1.5, 4, 5


def mem_mb_of(rule):
    """Return a function of a job: the memory that it asks for, MB; more where images are larger than the measured ones."""

    def mem_mb(wildcards, attempt):
        more = MEGAPIXEL_MB * max(megapixels(wildcards) - MEASURED_MEGAPIXELS, 0)
        return attempt * math.ceil(SPARE_MEMORY * measured(rule).mem_mb + more)

    return mem_mb


def runtime_of(rule):
    """Return a function of a job: the minutes that it asks for, by how many captures of which size it has."""

    def runtime(wildcards, attempt):
        size = max(megapixels(wildcards) / MEASURED_MEGAPIXELS, 1)
        seconds = measured(rule).capture_s * captures_in(wildcards) * size
        return attempt * math.ceil(SPARE_MINUTES + SPARE_TIME * seconds / 60)

    return runtime


def measured(rule):
    """Return the row of a rule in what was measured; that of ``other`` where it has none."""
    return MEASURED.loc[rule if rule in MEASURED.index else "other"]


def megapixels(wildcards):
    """Return the size of a job's images, of the largest where it has all cameras'."""
    camera = getattr(wildcards, "camera", None)
    cameras = SOURCE.file.cameras
    chosen = [cameras[camera]] if camera else list(cameras.values())
    return max(c.width * c.height for c in chosen) / 1e6


def captures_in(wildcards):
    """Return how many captures a job has to do with."""
    camera = getattr(wildcards, "camera", None)
    count = CAPTURE_COUNTS[camera] if camera else sum(CAPTURE_COUNTS.values())
    return min(count, config["batch"]) if hasattr(wildcards, "batch") else count
