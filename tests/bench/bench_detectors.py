"""Detectors side by side, as Markdown tables: ``python tests/bench/bench_detectors.py [--images N]``.

All detectors run on the same images in one process, their order turning from image to image, so that another load on
the machine hits all alike; times are medians. Images are made here (marker_scenes.py); real photographs and videos are
read from ../shared/real where they are. The figures that have an aim are recorded (record.py).
"""

import argparse
import platform
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests")]

import cv2  # noqa: E402
import numpy as np  # noqa: E402
from tabulate import tabulate  # noqa: E402

from bench.detector_figures import linear_figures, real_figures, sequence_figures, single_figures  # noqa: E402
from bench.marker_scenes import compare, encode, scene, texture  # noqa: E402
from detect_markers import read_images  # noqa: E402
from detectors import bart, contract  # noqa: E402
from detectors.bart import quads as bart_quads  # noqa: E402
from detectors.bart.tracker import Tracker  # noqa: E402
from record import record  # noqa: E402

NAMES = ("aruco", "aruco_subpix", "aruco3", "bart")
REAL = ROOT.parent / "shared" / "real"
REAL_SETS = {
    "aruco_original_single": "DICT_ARUCO_ORIGINAL",
    "aruco_original_board": "DICT_ARUCO_ORIGINAL",
    "aruco5x5_ubiquity_photos": "DICT_5X5_1000",
    "charuco5x5_wpical_1080p": "DICT_5X5_1000",
    "charuco6x6_hard_views": None,
    "charuco_gopro12_mirror": None,
}
ABLATIONS = {
    "all of it": {},
    "threshold: otsu": {"threshold": "otsu"},
    "threshold: both": {"threshold": "both"},
    "multi_scale: False": {"multi_scale": False},
    "exact_corners: False": {"exact_corners": False},
    "finer_levels: 0": {"finer_levels": 0},
    "finer_levels: 2": {"finer_levels": 2},
    "light: srgb": {"light": "srgb"},
    "light: linear": {"light": "linear"},
    "wrong_bits: 0": {"wrong_bits": 0},
}


def table(head, rows):
    """Return a Markdown table."""
    return tabulate(rows, head, tablefmt="github", disable_numparse=True) + "\n"


def run_all(detectors, image, number):
    """Return {name: (milliseconds, detections)}; the order turns with ``number``; the second of two runs counts."""
    names = list(detectors)
    found = {}
    for k in range(len(names)):
        name = names[(k + number) % len(names)]
        detectors[name].detect(image)
        start = time.perf_counter()
        result = detectors[name].detect(image)
        found[name] = (1000 * (time.perf_counter() - start), result)
    return found


def measure(detectors, scenes):
    """Return {name: dict of ms (n,), errors (m, 2), found (k,), false} over (image, truth) pairs."""
    sums = {name: {"ms": [], "errors": [], "found": [], "false": 0} for name in detectors}
    for number, (image, truth) in enumerate(scenes):
        for name, (ms, detections) in run_all(detectors, image, number).items():
            errors, found, false = compare(truth, detections)
            sums[name]["ms"].append(ms)
            sums[name]["errors"].append(errors.reshape(-1, 2))
            sums[name]["found"].append(found)
            sums[name]["false"] += false
    for s in sums.values():
        s["errors"], s["found"] = np.concatenate(s["errors"]), np.concatenate(s["found"])
    return sums


def accuracy_rows(sums):
    """Return rows: name, ms, 95 %, found, false ids, bias x, y, RMS of the corner's distance and per axis."""
    rows = []
    for name, s in sums.items():
        e = s["errors"] if len(s["errors"]) else np.full((1, 2), np.nan)
        rows.append(
            [
                name,
                f"{np.median(s['ms']):.2f}",
                f"{np.percentile(s['ms'], 95):.2f}",
                f"{s['found'].sum()} of {len(s['found'])}",
                s["false"],
                f"{e[:, 0].mean():+.4f}, {e[:, 1].mean():+.4f}",
                f"{np.sqrt((e**2).sum(axis=1).mean()):.3f}",
                f"{np.sqrt((e**2).mean()):.3f}",
            ]
        )
    return rows


ACCURACY_HEAD = ["detector", "ms", "ms 95 %", "found", "false ids", "bias x, y px", "RMS px", "RMS px per axis"]


def single_images(detectors, count):
    """Return the section on single images, for both encodings, and its figures."""
    parts, figures = [], []
    for encoding, figures_of in (("srgb", single_figures), ("linear", linear_figures)):
        sums = measure(detectors, (scene(np.random.default_rng(k), encoding=encoding) for k in range(count)))
        parts.append(f"Encoding {encoding}:\n\n" + table(ACCURACY_HEAD, accuracy_rows(sums)))
        figures += figures_of(sums)
    text = (
        "## Single images\n\n1920x1080, 20 markers (10 of each dictionary), side 45 to 150 px, tilt 0 to 50 degrees, "
        f"blur 0.7 px, noise 2 DN, clutter; {count} images each.\n\n" + "\n".join(parts)
    )
    return text, figures


def recall(detectors, count):
    """Return the section on recall against one condition at a time."""
    base = {"width": 960, "height": 540, "markers": 8, "side_px": (50, 51), "tilt_deg": (0, 40)}
    sweeps = {
        "side px": [("side_px", (v, v + 1), v) for v in (12, 16, 20, 25, 32, 45, 70)],
        "tilt deg": [("tilt_deg", (v, v + 1), v) for v in (0, 30, 45, 55, 65, 75)],
        "blur px": [("blur_px", v, v) for v in (0.0, 0.7, 1.5, 2.5, 3.5)],
        "noise DN": [("noise_dn", v, v) for v in (0.0, 2.0, 5.0, 10.0, 20.0)],
    }
    parts = []
    for title, values in sweeps.items():
        rows = {name: [name] for name in detectors}
        for key, value, _ in values:
            scenes = [scene(np.random.default_rng(7000 + k), **(base | {key: value})) for k in range(count)]
            for name, s in measure(detectors, scenes).items():
                rows[name].append(f"{100 * s['found'].mean():.0f}" + (f" ({s['false']} false)" if s["false"] else ""))
        parts.append(table([title] + [v for _, _, v in values], rows.values()))
    return (
        f"## Recall in per cent\n\n960x540, 8 markers of 50 px, tilt 0 to 40 degrees, {count} images a column; one "
        "condition changes at a time.\n\n" + "\n".join(parts)
    )


def false_ids(detectors, count):
    """Return the section on images without markers, and its figure."""
    ids = dict.fromkeys(detectors, 0)
    ms = {name: [] for name in detectors}
    for k in range(count):
        rng = np.random.default_rng(1000 + k)
        image = encode(rng, texture(rng, 540, 960), 0.7, 2.0)
        for name, (t, found) in run_all(detectors, image, k).items():
            ids[name] += len(found)
            ms[name].append(t)
    rows = [[name, ids[name], f"{np.median(ms[name]):.2f}", f"{np.percentile(ms[name], 95):.2f}"] for name in detectors]
    head = ["detector", f"ids in {count} images", "ms", "ms 95 %"]
    false = f"{ids['bart']} ({ids['aruco']}) in {count}"
    figures = [("BART (ArUco), false ids on textured images", false, "images")]
    return "## Textured images without markers\n\n960x540.\n\n" + table(head, rows), figures


def sequence_frames(count):
    """Return 1080p frames of 20 markers that sway by some pixels, and the true centres' shift of each."""
    image, truth = scene(np.random.default_rng(77))
    phase = 2 * np.pi * np.arange(count) / 45
    shifts = np.stack([25 * np.sin(phase), 10 * np.sin(2 * phase)], axis=1)
    rng = np.random.default_rng(5)
    frames = []
    for dx, dy in shifts:
        moved = cv2.warpAffine(image, np.array([[1, 0, dx], [0, 1, dy]]), image.shape[::-1], borderMode=1)
        frames.append(np.clip(moved + rng.normal(0, 1, moved.shape), 0, 255).astype(np.uint8))
    return frames, truth, shifts


def sequences(count):
    """Return the section on BART's tracker at 30 frames a second, and its figures."""
    frames, truth, _ = sequence_frames(count)
    K = np.array([[1400.0, 0, 959.5], [0, 1400.0, 539.5], [0, 0, 1]])
    cases = {
        "search beside": {"asynchronous": True},
        "search beside, poses filtered": {"asynchronous": True, "K": K, "code_m": 0.07},
        "search beside, budget 4 ms": {"asynchronous": True, "budget_ms": 4.0},
        "search in the loop": {},
        "search in the loop, budget 4 ms": {"budget_ms": 4.0},
        "no regions": {"regions": False},
    }
    rows, times = [], {}
    for title, parameters in cases.items():
        tracker = Tracker(**parameters)
        tracker.update(frames[0])
        tracker.reset()
        ms, seen, partial = [], 0, 0
        for frame in frames:
            start = time.perf_counter()
            result = tracker.update(frame)
            ms.append(result.ms)
            seen += sum(m.seen for m in result.markers)
            partial += result.partial
            time.sleep(max(0.0, 1 / 30 - (time.perf_counter() - start)))
        late = times[title] = ms[1:]
        row = [title, f"{np.median(late):.2f}", f"{np.percentile(late, 99):.2f}", f"{max(late):.2f}", f"{ms[0]:.2f}"]
        rows.append([*row, f"{seen} of {len(truth) * count}", partial])
    head = ["tracker", "ms", "ms 99 %", "longest", "first frame", "seen", "partial frames"]
    text = f"## Sequences\n\n1920x1080, 20 swaying markers, {count} frames at 30 a second.\n\n" + table(head, rows)
    return text, sequence_figures(times)


def expected_of(folder):
    """Return {image: set of ids} of a set's verified.csv where it lists ids of our dictionaries."""
    expected = {}
    for line in (folder / "verified.csv").read_text().splitlines()[1:]:
        image, markers = line.split(",")[:2]
        for part in markers.split(";"):
            dictionary, _, ids = part.strip().partition(":")
            if dictionary in ("ARUCO_ORIGINAL", "5X5_1000"):
                expected[image] = {int(i) for i in ids.split()}
    return expected


def real_sets(detectors):
    """Return the section on real photographs and videos, and its figures (none where these are not there)."""
    rows, sums = [], {name: np.zeros(2, int) for name in detectors}
    for name, dictionary in REAL_SETS.items():
        folder = REAL / name
        if not folder.exists():
            rows.append([name, "not beside this repository"] + [""] * 4)
            continue
        files = [str(f) for f in sorted(folder.iterdir()) if f.suffix in (".png", ".jpg", ".avi", ".mp4")]
        known = set().union(*expected_of(folder).values()) if dictionary else set()
        if name == "charuco5x5_wpical_1080p":
            known = set(range(48))  # its README
        counts = {d: [0, 0, []] for d in detectors}
        frames = 0
        for number, (_, image) in enumerate(read_images(files)):
            frames += 1
            for d, (ms, found) in run_all(detectors, image, number).items():
                right = [f for f in found if f.dictionary == dictionary and f.id in known]
                counts[d][0] += len(right)
                counts[d][1] += len(found) - len(right)
                counts[d][2].append(ms)
        for d, (right, wrong, ms) in counts.items():
            sums[d] += right, wrong
            rows.append([name, frames, d, right, wrong, f"{np.median(ms):.2f}"])
    text = (
        "## Real photographs and video\n\nRight: ids that the set is known to hold. The last two sets "
        "hold other or mirrored markers: whatever is reported is wrong.\n\n"
        + table(["set", "images", "detector", "right", "wrong ids", "ms"], rows)
    )
    return text, real_figures(sums) if REAL.is_dir() else []


def ablation(count):
    """Return the section on what each of BART's switches brings."""
    detectors = {title: contract.make("bart", parameters=p) for title, p in ABLATIONS.items()}
    sums = measure(detectors, [scene(np.random.default_rng(300 + k)) for k in range(count)])
    return f"## BART's switches\n\n{count} images as above, sRGB.\n\n" + table(ACCURACY_HEAD, accuracy_rows(sums))


def milliseconds(function, *arguments):
    """Return the median of nine calls."""
    times = []
    for _ in range(9):
        start = time.perf_counter()
        function(*arguments)
        times.append(1000 * (time.perf_counter() - start))
    return np.median(times)


def time_budget():
    """Return the section on where BART's time goes, and what reading the pixels once takes."""
    image, _ = scene(np.random.default_rng(0))
    detector = contract.make("bart")
    parts = {"reading all pixels once": milliseconds(cv2.sumElems, image)}
    parts["halving"] = milliseconds(bart._halved, image)
    small = bart._halved(image)
    parts["adaptive threshold (half size)"] = milliseconds(detector._dark, small, "mean")
    dark, regions = detector._regions(small, "mean")
    parts["dark regions"] = milliseconds(bart_quads.components, dark.view(np.uint64))
    parts["borders and quads"] = milliseconds(bart_quads.quads_of, regions, dark)
    quads, boxes = bart_quads.quads_of(regions, dark)
    quads = bart._to_full(quads - 1, 1)
    parts["codes and edges of quads"] = milliseconds(detector.read, image, quads)
    found = bart.best_of_each(detector.read(image, quads))
    parts["finer looks"] = milliseconds(detector._search_finer, image, [image, small], boxes - 1, found)
    parts["light"] = milliseconds(detector.light_of, image, found)
    parts["whole detection"] = milliseconds(detector.detect, image)
    rows = [[name, f"{ms:.2f}"] for name, ms in parts.items()]
    times = parts["whole detection"] / parts["reading all pixels once"]
    return (
        "## Where BART's time goes\n\nOne 1920x1080 image as above. The whole is "
        f"{times:.0f} times one read of its pixels; parts from the borders on are shared by two threads.\n\n"
        + table(["part", "ms"], rows)
    )


def main():
    """Print the report and record what has an aim."""
    parser = argparse.ArgumentParser(description="Measure the detectors side by side.")
    parser.add_argument("--images", type=int, default=12, help="images of each encoding; others in proportion")
    parser.add_argument("--threads", type=int, default=2, help="threads of OpenCV")
    arguments = parser.parse_args()
    cv2.setNumThreads(arguments.threads)
    n = arguments.images
    detectors = {name: contract.make(name) for name in NAMES}
    single, singles = single_images(detectors, n)
    textured, falses = false_ids(detectors, max(200 * n // 12, 2))
    video, videos = sequences(max(25 * n, 20))
    real, reals = real_sets(detectors)
    sections = [
        f"# Detectors side by side\n\nOpenCV {cv2.__version__}, {arguments.threads} threads of OpenCV, Python "
        f"{platform.python_version()}, {platform.machine()}; one run of `tests/bench/bench_detectors.py "
        f"--images {n}`.\n",
        single,
        recall(detectors, max(n // 4, 1)),
        textured,
        video,
        ablation(max(n // 2, 1)),
        time_budget(),
        real,
    ]
    print("\n".join(sections))
    record([*singles, *falses, *videos, *reals])


if __name__ == "__main__":
    main()
