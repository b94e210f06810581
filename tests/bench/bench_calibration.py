"""Calibration and reading of real photographs: ``python tests/bench/bench_calibration.py``. Figures are recorded
(record.py).

Board sets under ../shared/real against the residuals of their READMEs (OpenCV 4.11 there), by the finder that the
README names; marker photographs against the ids of their verified.csv, as OpenCV's detector comes.
"""

import csv
import re
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests")]

import cv2  # noqa: E402
from tabulate import tabulate  # noqa: E402

from detectors import contract  # noqa: E402
from inputs.campaign import CalibrationBoard, load_campaign  # noqa: E402
from inputs.images import read_image  # noqa: E402
from record import record  # noqa: E402
from register import boards, calibration  # noqa: E402
from register.finders import USUAL, board_finders, by_finder, trusted_finder, usable_views  # noqa: E402
from rig.errors import InputError  # noqa: E402

REAL = ROOT.parent / "shared" / "real"
VIDEO_SET = "charuco5x5_wpical_1080p"
VIDEO_BOARD = CalibrationBoard(
    type="charuco", dictionary="DICT_5X5_1000", columns=12, rows=8, square_m=0.01801, marker_m=0.014
)  # as its README has it
RMS_LINE = re.compile(
    r"reprojection RMS pinhole ([\d.]+) px, 5 coefficients ([\d.]+) px, 8 coefficients \(rational\) ([\d.]+) px"
)
FALSE_READINGS = ("ARUCO_MIP_36h12",)  # what READMEs call false positives, as is all of the mirrored set
WITHIN = 0.05


def table(head, rows):
    """Return a Markdown table."""
    return tabulate(rows, head, tablefmt="github", disable_numparse=True) + "\n"


def video_frames(path, numbers):
    """Yield (number, image) of some frames of a video."""
    video = cv2.VideoCapture(str(path))
    for number in range(max(numbers) + 1):
        good, image = video.read()
        if not good:
            return
        if number in numbers:
            yield number, image


def published(folder):
    """Return [(by_sectors, (pinhole, 5, 8))]: the residuals that a README states, a line a finder."""
    found = []
    for line in (folder / "README.md").read_text().splitlines():
        match = RMS_LINE.search(line)
        if match:
            found.append(("findChessboardCornersSB" in line, tuple(map(float, match.groups()))))
    return found


def board_set(name):
    """Return (board, [(file name, image)]) of a set, images one by one; the video by every eighth frame."""
    folder = REAL / name
    if name == VIDEO_SET:
        frames = video_frames(folder / "testcalibration.mp4", range(0, 161, 8))
        return VIDEO_BOARD, ((f"testcalibration.mp4#frame{n}", image) for n, image in frames)
    campaign = load_campaign(folder)
    return campaign.file.target, ((c.image, read_image(folder / c.image)) for c in campaign.captures.itertuples())


def board_rows(name):
    """Return the table's rows of one board set: one a README line, and what the program itself takes."""
    board, images = board_set(name)
    finders, found, start = board_finders(board), {}, time.perf_counter()
    for file, image in images:
        found[file] = [find(image) for find in finders]
        size = image.shape[1::-1]
    seconds = (time.perf_counter() - start) / len(found)
    listed = sum(int(r["board_corners"] or 0) for r in verified(name))
    finder = trusted_finder(found, size, []) if len(finders) > 1 else USUAL
    taken, rows = by_finder(found, finder), []
    for by_sectors, stated in published(REAL / name):
        points = {file: v[1 if by_sectors else 0] for file, v in found.items()}
        views = usable_views(points)
        fits = calibration.calibrate_all(views, size)
        ours = [fits[model]["rms_px"] for model in calibration.MODELS]
        ratios = [a / b for a, b in zip(ours, stated, strict=True)]
        corners = sum(len(v.image) for v in views.values())
        rows.append(
            [
                name + (" (sectors)" if by_sectors else ""),
                f"{len(views)} of {len(found)}",
                f"{corners} ({listed})",
                " / ".join(f"{v:.3f}" for v in ours),
                " / ".join(f"{v:.3f}" for v in stated),
                " / ".join(f"{v:.3f}" for v in ratios),
                "yes" if all(abs(r - 1) <= WITHIN for r in ratios) else "no",
                "yes" if all(taken[file] is points[file] for file in found) else "no",
                f"{1000 * seconds:.0f}",
            ]
        )
    return rows


def verified(name):
    """Return the rows of a set's verified.csv."""
    with open(REAL / name / "verified.csv", newline="") as file:
        return list(csv.DictReader(file))


def legacy_rows():
    """Return what is said of each ChArUco set, described with the wrong legacy flag."""
    rows = []
    for name in sorted(p.parent.name for p in REAL.glob("charuco*/campaign.yaml")):
        board, images = board_set(name)
        wrong = board.model_copy(update={"legacy_pattern": not board.legacy_pattern})
        images = [image for _, image in images]
        corners = sum(len(boards.find_board(image, wrong).image) for image in images)
        said = "nothing: it fits"
        if corners == 0:
            try:
                boards.check_legacy_pattern(images, wrong, "target")
                said = "nothing"
            except InputError as error:
                said = str(error)
        rows.append([name, board.legacy_pattern, board.rows, corners, said])
    return rows


def listed_ids(name):
    """Return [(image, {dictionary: [ids]})] of a set's verified.csv, without what its README calls false."""
    found = []
    for row in verified(name):
        ids = {}
        for part in row["markers"].split(";"):
            dictionary, _, numbers = part.strip().partition(":")
            if numbers and dictionary not in FALSE_READINGS:
                ids[f"DICT_{dictionary}"] = sorted(map(int, numbers.split()))
        found.append((row["image"], ids))
    return found


def frames_of(folder, files):
    """Yield (file, image) of images and of ``video#frameN``."""
    videos = {}
    for file in files:
        video, mark, number = file.partition("#frame")
        if mark:
            videos.setdefault(video, {})[int(number)] = file
        else:
            yield file, read_image(folder / file)
    for video, numbers in videos.items():
        for number, image in video_frames(folder / video, numbers):
            yield numbers[number], image


def count_read(detect, images, wanted):
    """Return (number read, [what was missed]) of the ids that {file: {dictionary: ids}} lists."""
    read, missed = 0, []
    for file, image in images:
        found = detect(image)
        for dictionary, ids in wanted[file].items():
            seen = [d.id for d in found if d.dictionary == dictionary]
            for i in sorted(set(ids)):
                here = min(ids.count(i), seen.count(i))
                read += here
                if here < ids.count(i):
                    missed.append(f"{file} {dictionary} {i}")
    return read, missed


def marker_row(name):
    """Return the table's row of one set of marker photographs."""
    wanted = dict(listed_ids(name))
    dictionaries = sorted({d for ids in wanted.values() for d in ids})
    images = list(frames_of(REAL / name, wanted))
    listed = sum(len(ids) for by_dictionary in wanted.values() for ids in by_dictionary.values())
    read, missed = count_read(contract.make("aruco", dictionaries).detect, images, wanted)
    return [name, len(wanted), listed, read, "; ".join(missed) or "-"]


def marker_sets():
    """Return the names of the sets whose verified.csv lists ids, without the mirrored one."""
    names = [p.parent.name for p in REAL.glob("*/verified.csv")]
    return sorted(n for n in names if "mirror" not in n and any(ids for _, ids in listed_ids(n)))


def main():
    """Print the tables and record what they come to."""
    if not REAL.is_dir():
        raise SystemExit(f"needs the photographs of {REAL}")
    cv2.setNumThreads(1)
    names = [VIDEO_SET, *sorted(p.parent.name for p in REAL.glob("*/campaign.yaml"))]
    head = [
        "set",
        "views",
        "corners (listed)",
        "RMS px: pinhole / 5 / 8",
        "README",
        "ratio",
        "within 5 %",
        "taken",
        "ms",
    ]
    parts = [f"Board sets, OpenCV {cv2.__version__}; ms per image for all finders, one thread. Taken: the finder that "]
    board_table = [row for name in names for row in board_rows(name)]
    parts[0] += "the program itself uses.\n\n" + table(head, board_table)
    head = ["set", "legacy_pattern", "rows", "corners by the wrong flag", "said"]
    parts.append("The wrong legacy flag.\n\n" + table(head, legacy_rows()))
    head = ["set", "images", "ids listed", "of these read", "missed"]
    marker_table = [marker_row(name) for name in marker_sets()]
    parts.append("Marker photographs, detector `aruco`.\n\n" + table(head, marker_table))
    print("\n".join(parts))
    furthest = max(abs(float(ratio) - 1) for row in board_table for ratio in row[5].split(" / "))
    listed, read = (sum(row[k] for row in marker_table) for k in (2, 3))
    record(
        [
            ("board sets: residual against that of their README, the furthest off", 100 * furthest, "%"),
            ("marker photographs: listed ids that `aruco` reads", f"{read} of {listed}", "ids"),
        ]
    )


if __name__ == "__main__":
    main()
