"""What bench_detectors.py records: lists of (what, figure, unit) from its measures.

``sums`` are those of bench_detectors.measure: {detector: dict of ms (n,), errors (m, 2), found (k,), false}.
"""

import numpy as np


def median_ms(sums, name):
    """Return a detector's median milliseconds."""
    return float(np.median(sums[name]["ms"]))


def fastest_right_one(sums):
    """Return the name of the fastest of OpenCV's detectors that find most."""
    others = [name for name in sums if name != "bart"]
    most = max(sums[name]["found"].sum() for name in others)
    return min((n for n in others if sums[n]["found"].sum() == most), key=lambda n: median_ms(sums, n))


def single_figures(sums):
    """Return the figures of BART on single sRGB images, against OpenCV's fastest right detector."""
    bart_ms, other = median_ms(sums, "bart"), fastest_right_one(sums)
    return [
        ("BART, single 1080p images, median", bart_ms, "ms"),
        ("BART, single 1080p images, over OpenCV's fastest right one", bart_ms / median_ms(sums, other), "of its time"),
        ("BART, single images, markers found (ArUco)", found_words(sums), "markers"),
        ("BART, single images, corners, RMS", rms_px(sums), "px"),
        ("BART, single images, corners, bias, the larger axis", bias_px(sums), "px"),
    ]


def linear_figures(sums):
    """Return the figures of BART on single images of linear light."""
    return [
        ("BART, images of linear light, markers found (ArUco)", found_words(sums), "markers"),
        ("BART, images of linear light, corners, RMS", rms_px(sums), "px"),
        ("BART, images of linear light, corners, bias, the larger axis", bias_px(sums), "px"),
    ]


def found_words(sums):
    """Return how many markers BART found, and in brackets ArUco."""
    found = {name: sums[name]["found"] for name in ("bart", "aruco")}
    return f"{found['bart'].sum()} ({found['aruco'].sum()}) of {len(found['bart'])}"


def rms_px(sums):
    """Return the RMS distance of BART's corners from the truth."""
    return float(np.sqrt((sums["bart"]["errors"] ** 2).sum(axis=1).mean()))


def bias_px(sums):
    """Return the mean error of BART's corners on the axis where it is larger."""
    return float(np.abs(sums["bart"]["errors"].mean(axis=0)).max())


def sequence_figures(times):
    """Return the figures of BART's tracker; times: {case: milliseconds of its frames}."""
    limited = (times["search beside, budget 4 ms"], times["search in the loop, budget 4 ms"])
    longest = " / ".join(f"{max(ms):.1f}" for ms in limited)
    return [
        ("BART, sequences at 1080p, median / 99 %", two_times(times["search beside"]), "ms"),
        ("BART, sequences with filtered poses, median / 99 %", two_times(times["search beside, poses filtered"]), "ms"),
        ("BART, longest frame under a budget of 4 ms, search beside / in the loop", longest, "ms"),
    ]


def real_figures(sums):
    """Return the figures of real photographs and video; sums: {detector: (ids right, ids wrong)}."""
    bart, aruco = sums["bart"], sums["aruco"]
    return [
        ("BART (ArUco) on real photographs and video, right ids", f"{bart[0]} ({aruco[0]})", "markers"),
        ("BART (ArUco) on real photographs and video, wrong ids", f"{bart[1]} ({aruco[1]})", "markers"),
    ]


def two_times(ms):
    """Return the median and the 99th percentile of milliseconds, in words."""
    return f"{np.median(ms):.1f} / {np.percentile(ms, 99):.1f}"
