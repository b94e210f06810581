"""Every board set of ../shared/real as it is: ``python tests/bench/bench_real_boards.py [SET ...]``. Writes docs/real-photographs.md.

Each set is expanded, registered, observed and diagnosed by its points and its cells as the workflow does it. Its left-out photographs are
also projected by OpenCV's calibration with five coefficients, fitted to the same photographs as the twin. docs/real-photographs.csv
holds a row a set and the commit that made it; without names all are done anew. Figures are recorded (record.py).
"""

import argparse
import json
import logging
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests"), str(ROOT / "tests/bench")]

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

import job  # noqa: E402
from case_files import load_measured, load_photographs, read_capture  # noqa: E402
from declared_effects import declared_of  # noqa: E402
from describe_files import describe_files  # noqa: E402
from diagnose_camera import looked_at, telling_record, verdict_record  # noqa: E402
from diagnose_patches import both_looks, gaps_on_the_way, look_at_patches  # noqa: E402
from effects import library  # noqa: E402
from expand_tables import expand_tables  # noqa: E402
from gap.boards.board import polynomial_terms  # noqa: E402
from gap.boards.capture_light import photograph_light  # noqa: E402
from gap.boards.needs import cannot_tell  # noqa: E402
from gap.boards.whole_lens import left_out_px, with_whole_lens  # noqa: E402
from gap.observables import SIGNS  # noqa: E402
from gap.select.select_effects import BUDGET, verdict  # noqa: E402
from gap.signatures.needs_of_cells import cells_cannot_tell  # noqa: E402
from gap.signatures.signature_case import NumbersOf, is_seen_in_cells  # noqa: E402
from inputs.campaign import load_campaign  # noqa: E402
from observe_patches import observe_patches  # noqa: E402
from record import commit_of, record  # noqa: E402
from register_captures import register_captures  # noqa: E402
from reporting.sentences import effect_words, or_others, plain  # noqa: E402
from rig.errors import InputError  # noqa: E402
from rig.geometry import N_POSE, perturb_pose  # noqa: E402
from rig.light import free_numbers, in_own_light  # noqa: E402
from told_apart import auc, patches_of  # noqa: E402

REAL = ROOT.parent / "shared/real"
TABLE, PAGE = ROOT / "docs/real-photographs.csv", ROOT / "docs/real-photographs.md"
AT_FLOOR = 1.2  # floors
MAX_DRAWN = 4  # photographs whose grey levels are compared
MOVED = ", moved while read"  # of a set's photographs
COLUMNS = [
    "set",
    "photographs",
    "size",
    "verdict",
    "effects",
    "before",
    "after",
    "after_points",
    "lives",
    "edges_off",
    "noise_off",
    "noise_px",
    "own_bend",
    "not_told",
    "needs",
    "over_opencv",
    "over_opencv_named",
    "dn_nominal",
    "dn_own_light",
    "told_apart",
    "cpu_s",
    "commit",
]
HEAD = """# Real photographs

What the program says of sets of photographs by real cameras that others published, as they are; nobody knows the truth. Made by
`python tests/bench/bench_real_boards.py` from `../shared/real`, where each set has its source and licence; the table behind it is
[real-photographs.csv](real-photographs.csv). Points of the boards are looked at first, then their cells.

- **gap**: of left-out photographs, in floors, with the ideal pinhole and with the effects named ([method](method.md)): of points and of
  what cells show; **of points** alone. Where it is above 1.2 afterwards, the groups of observables that are, the largest first.
- **edges off**: by how much the second moment of edges' spread differs between left-out photographs and twins, square pixels, before
  and after; **noise off**: by which factor their noise does.
- **own bend**: how far points lie off, in floors, in the median left-out photograph, and what is left beside a polynomial of second order
  of the photograph's own: what falls is smooth and another in each photograph, as of a sheet held by hand or of a moving shutter.
- **left out, over OpenCV**: root mean square of left-out points, poses by least squares, over that of OpenCV's calibration with five
  coefficients, which is fitted to the same photographs; of the twin with its whole lens (what is too small for a name is fitted as
  well), and with the effects named alone. Below 1 the twin projects better; far below where photographs moved while their rows were
  read (**verdict**), as the twin has each one's motion, which OpenCV's model has not.
- **levels off**: root mean square difference, grey levels, of left-out photographs and their twins between the board's outermost
  points, the median photograph; in the nominal light, and with all effects named in the light, behind them, that each photograph's own
  white and black show.
- **told apart**: area under the ROC curve of a logistic model that tells patches of 32 pixels of left-out photographs from those of
  their twins by fixed features, after it was shown the others'; the nominal twin, and that in each photograph's own light with all
  effects named. 1: always told, 0.5: never.
- **cannot be told**: effects that would stay unseen at the amount worth naming, and what would show them; of cells too in rows since 436ffd4.
- **commit**: of the code that made the row; a set is done anew by its name.

Not in the table is what is no campaign of a board with six photographs by one camera: charuco_gopro12_mirror (three photographs),
charuco6x6_hard_views (four, by two cameras), aruco_original_board (one) and charuco5x5_wpical_1080p (a video).

"""


def board_sets():
    """Return the names of the sets that are campaigns of a board."""
    return sorted(p.parent.name for p in REAL.glob("*/campaign.yaml") if load_campaign(p.parent).file.target)


def measured_points(campaign, camera, folder):
    """Return ((expand, register_json, observations), BoardCase) of a board's only camera, measured into a folder.

    Raises InputError or ValueError where a campaign's photographs are refused.
    """
    expand, intrinsics, observations = folder / "expand", folder / "r.json", folder / "observations.npz"
    expand_tables(campaign, None, camera, expand)
    register_captures(expand, campaign, camera, folder / "r.csv", intrinsics, observations)
    return (expand, intrinsics, observations), load_measured(expand, intrinsics, camera, observations)


def told_by_points(case):
    """Return (what is not looked at in points, Search, base Twin, Outcome, the verdict's record) of a BoardCase."""
    competing, unseen = looked_at(case, sorted(library.available_effects()))
    search, base, first, outcome = verdict(case, candidates=competing)
    result = verdict_record(base, first, outcome, dict(case.nuisances))
    result |= telling_record(result["steps"], *cannot_tell(search, outcome.twin, competing))
    return unseen, search, base, outcome, result


def diagnosed(name, folder):
    """Return the table's row of a set (dict); what is refused is said in its verdict."""
    campaign, start = REAL / name, time.process_time()
    (camera,) = load_campaign(campaign).captures.camera.unique()
    row = dict.fromkeys(COLUMNS, "") | {"set": name}
    try:
        (expand, intrinsics, observations), case = measured_points(campaign, camera, folder)
    except (InputError, ValueError) as why:
        return row | {"verdict": f"refused: {str(why).rpartition(': ')[2]}"}
    unseen, search, base, outcome, result = told_by_points(case)
    files, patches, points_after = folder / "files.csv", folder / "patches.npz", result["gap"]
    describe_files(expand / "captures.csv", campaign, camera, files)
    observe_patches(expand, intrinsics, campaign, camera, observations, patches)
    result["where"] = []  # pictures of it are not drawn here
    of_camera, off = (expand, intrinsics, camera, patches), {"edges": "", "noise": ""}
    effects, declared = list(outcome.twin.effects), declared_of(files)
    try:
        closer_search, own, tried, closer, _ = look_at_patches(
            of_camera, case, outcome, list(unseen), set(), declared, BUDGET, 1, None, None
        )
        of_cells = verdict_record(own, tried, closer)
        of_cells |= telling_record(of_cells["steps"], *cells_cannot_tell(closer_search, closer.twin, closer.steps))
        result = both_looks(result, of_cells, gaps_on_the_way(base, outcome, own, closer))
        off = signs_off(closer_search, own, closer.twin)
        effects = [e for e in effects if not is_seen_in_cells(e[0])] + list(closer.twin.effects)
    except ValueError as why:
        result["verdict"] += f" ({why})"
    ours, theirs = left_out_px(search, with_whole_lens(search, outcome.twin)), opencv_left_out_px(search)
    view = case.captures[0].view
    return row | {
        "photographs": len(search.train) + len(search.test),
        "size": f"{view.width} x {view.height}",
        "verdict": result["verdict"] + (MOVED if search.problem.gap_at_rest else ""),
        "effects": "; ".join(effect_words(step) + or_others(step) for step in result["steps"]),
        "before": f"{result['gap_as_configured']:.2f}",
        "after": f"{result['gap']:.2f}",
        "after_points": f"{points_after:.2f}",
        "lives": lives_in(result),
        "edges_off": off["edges"],
        "noise_off": off["noise"],
        "noise_px": f"{case.noise_px:.3f}",
        "own_bend": own_bend(search, outcome.twin),
        "not_told": ", ".join(plain(n) for n in result["not_told"]),
        "needs": "; ".join(sorted({need["text"].partition(": ")[2] for need in result["needs"]})),
        "over_opencv": f"{ours / theirs:.3f}",
        "over_opencv_named": f"{left_out_px(search, outcome.twin) / theirs:.3f}",
        **against_photographs(search, outcome.twin, effects, declared, (expand, intrinsics, campaign)),
        "cpu_s": f"{time.process_time() - start:.0f}",
        "commit": commit_of(ROOT),
    }


def lives_in(result):
    """Return the groups of observables that are above AT_FLOOR in a record whose gap is, in words, the largest first."""
    groups = sorted(result["groups"].items(), key=lambda item: -item[1])
    above = [f"{name} {gap:.1f}" for name, gap in groups if gap > AT_FLOOR]
    return ", ".join(above) if result["gap"] > AT_FLOOR else ""


def own_bend(search, twin):
    """Return "as it is / beside a second-order polynomial of its own" of the median left-out photograph's points, RMS in floors."""
    off, left = [], []
    for i in search.test:
        observation = search.problem.captures[i].observation
        residuals = search.solver.residuals(i, list(twin.effects), twin.poses[i])["corners"].reshape(-1, 2)
        xy = observation.features.reshape(len(observation.features), -1)[observation.measured, :2]
        terms = polynomial_terms((xy - xy.mean(axis=0)) / np.ptp(xy), 2)
        if len(residuals) == len(xy) > 2 * terms.shape[1]:
            rest = residuals - terms @ np.linalg.lstsq(terms, residuals, rcond=None)[0]
            off.append(np.sqrt((residuals**2).mean()))
            left.append(np.sqrt((rest**2).sum() / (rest.size - 2 * terms.shape[1])))
    return f"{np.median(off):.2f} / {np.median(left):.2f}" if off else ""


def signs_off(search, before, after):
    """Return {"edges", "noise": words} of how far left-out photographs lie off two Twins of a SignatureCase: the mean of them."""
    case, of = search.problem, {"edges": ["spread_x", "spread_y"], "noise": ["noise_white", "noise_black"]}

    def off(twin, names):
        shown = np.array([case.signature(i, list(twin.effects)) for i in search.test])
        columns = [SIGNS.index(name) for name in names]
        return float(np.nanmean(np.abs(np.nanmean(case.signs[search.test][:, columns] - shown[:, columns], axis=0))))

    edges, noise = ([off(twin, names) for twin in (before, after)] for names in of.values())
    factors = [np.exp(v / 2) for v in noise]  # signs of noise are logarithms of variances
    return {"edges": "{:.3f} / {:.3f}".format(*edges), "noise": "{:.1f} / {:.1f}".format(*factors)}


def against_photographs(search, twin, effects, declared, files):
    """Return {column: words} of what tells photographs from their twins inside the board, of a BoardCase's Search.

    Twin ``twin`` has the poses; effects are all that were named, declared {capture: effects} what photographs' files say; files
    (expand, register_json, campaign). Grey levels are of left-out photographs, the median of them.
    """
    left_out = Drawn(search, twin, effects, declared, files, search.test)
    shown = Drawn(search, twin, effects, declared, files, search.train)
    if not (shown.rms and left_out.rms):
        return {}  # too little of the board is seen
    off = np.median(left_out.rms, axis=0)
    words = {name: f"{value:.1f}" for name, value in zip(("dn_nominal", "dn_own_light"), off, strict=True)}
    areas = [auc(*shown.patches(which), *left_out.patches(which)) for which in ("nominal", "closest")]
    return words | {"told_apart": "{:.3f} / {:.3f}".format(*areas)}


class Drawn:
    """Photographs and their twins, as full images: ``rms`` [(nominal light, own light)] in grey levels, and their patches."""

    def __init__(self, search, twin, effects, declared, files, indices):
        expand, intrinsics, campaign = files
        case = search.problem
        images = pd.read_csv(expand / "captures.csv", dtype=str).set_index("capture").image
        drawn = load_photographs(expand, intrinsics, case.camera)
        free, zero = free_numbers(load_campaign(campaign).file.left_open), np.zeros(6)
        self.rms, self.found = [], {"photograph": [], "nominal": [], "closest": []}
        for i in indices[:MAX_DRAWN]:
            name = case.captures[i].view.capture
            capture = replace(
                drawn.captures[i], view=replace(case.captures[i].view, T_cam_world=moved_pose(case, i, twin))
            )
            image, observed = read_capture(campaign, images[name]), case.captures[i].observation.features
            closest = closest_twin(drawn, capture, [*effects, *declared.get(name, ())])
            try:
                light = photograph_light(image, drawn.scene, case.points, observed, drawn.codes.lut, free, closest)
            except ValueError:
                continue  # too little of the board is seen
            inside = board_mask(case.points, observed, image.shape)
            nominal = drawn.image_of(drawn.radiance_of(capture, twin.effects, zero), capture, twin.effects, zero)
            self.rms.append([np.sqrt(np.mean((image[inside] - v[inside]) ** 2)) for v in (nominal, closest(light))])
            closest = closest(light, NumbersOf(name))
            for key, shown in (("photograph", image), ("nominal", nominal), ("closest", closest)):
                self.found[key].append(patches_of(np.rint(shown), inside))

    def patches(self, which):
        """Return the patches (n, 32, 32, 3) of the photographs, and as many of their twins, "nominal" or "closest"."""
        return tuple(np.concatenate(self.found[name]) for name in ("photograph", which))


def moved_pose(case, i, twin):
    """Return T_cam_world of photograph i in a Twin."""
    return perturb_pose(case.captures[i].view.T_cam_world, twin.poses[i, :N_POSE])


def closest_twin(drawn, capture, effects):
    """Return a function (LIGHT, random numbers) -> the image (H, W, 3) of a capture's twin with effects, in a light."""
    zero = np.zeros(6)
    radiance = drawn.radiance_of(capture, effects, zero)  # blur and ink are drawn

    def image(light, numbers=None):
        lit = in_own_light(radiance, light, capture.view, drawn.place)
        return drawn.image_of(lit, capture, effects, zero, numbers)

    return image


def board_mask(points, pixels, shape):
    """Return which pixels (H, W) lie within the outermost points that a photograph shows of a board."""
    hull = cv2.convexHull(pixels[np.isfinite(pixels).all(1)].astype(np.float32)).round().astype(np.int32)
    return cv2.fillConvexPoly(np.zeros(shape[:2], np.uint8), hull, 1) > 0


def opencv_left_out_px(search):
    """Return whole_lens.left_out_px of OpenCV's calibration with five coefficients, fitted to the twin's photographs."""

    def points_of(indices):
        seen = {i: search.problem.captures[i].observation for i in indices}
        return [
            (search.problem.points[o.measured].astype(np.float32), o.features[o.measured].astype(np.float32))
            for o in seen.values()
        ]

    view = search.problem.captures[0].view
    board, image = zip(*points_of(search.train), strict=True)
    _, K, distortion, _, _ = cv2.calibrateCamera(
        board, image, (view.width, view.height), view.K.copy(), None, flags=cv2.CALIB_USE_INTRINSIC_GUESS
    )
    off = []
    for points, pixels in points_of(search.test):
        _, r, t = cv2.solvePnP(points, pixels, K, distortion)
        r, t = cv2.solvePnPRefineLM(points, pixels, K, distortion, r, t)
        off.append(cv2.projectPoints(points, r, t, K, distortion)[0][:, 0] - pixels)
    return float(np.sqrt((np.concatenate(off) ** 2).sum(1).mean()))


def page(table):
    """Return the text of the page."""
    shown = table.rename(
        columns={
            "photographs": "used",
            "effects": "the twin lacks",
            "before": "gap before",
            "after": "after",
            "after_points": "after, of points",
            "lives": "where the gap lives",
            "edges_off": "edges off, px2",
            "noise_off": "noise off, times",
            "noise_px": "a point's noise, px",
            "own_bend": "own bend, floors",
            "not_told": "cannot be told",
            "needs": "what would tell",
            "over_opencv": "left out, over OpenCV",
            "over_opencv_named": "with the named alone",
            "dn_nominal": "levels off, nominal light",
            "dn_own_light": "levels off, own light",
            "told_apart": "told apart, AUC",
            "cpu_s": "CPU, s",
        }
    )
    return HEAD + shown.to_markdown(index=False, disable_numparse=True) + "\n"


def figures(table):
    """Return [(what, figure, unit)] of the sets that were not refused."""
    done = table[table.after != ""]
    after, ratio = done.after.astype(float), done.over_opencv.astype(float)
    lensed = ["chess_opencv_left", "chess_gopro_wide", "charuco_screen_wide"]
    straight = ["chess_studio_control", "aruco6x6_gridboard"]
    first = done.set_index("set").effects
    lensed, straight = ([n for n in names if n in first.index] for names in (lensed, straight))
    right = sum(first.get(n, "").startswith("radial distortion") for n in lensed)
    clean = sum(not {"distortion", "shutter"} & set(first.get(n, "lens distortion").split()) for n in straight)
    return [
        ("board sets: gap after at most 1.2 floors", f"{(after <= AT_FLOOR).sum()} of {len(done)}", "sets"),
        ("board sets: left-out corners over OpenCV's with five coefficients, the worst", f"{ratio.max():.3f}", ""),
        ("board sets with a lens: radial distortion first", f"{right} of {len(lensed)}", "sets"),
        ("board sets without: no lens, no shutter named", f"{clean} of {len(straight)}", "sets"),
    ]


def stored_table():
    """Return the table as it stands."""
    stored = pd.read_csv(TABLE, dtype=str, keep_default_na=False) if TABLE.is_file() else pd.DataFrame(columns=COLUMNS)
    return stored.reindex(columns=COLUMNS, fill_value="")


def with_row(table, row):
    """Return a table with a set's row (dict) in place of what it said of it."""
    return pd.concat([table[table.set != row["set"]], pd.DataFrame([row])]).astype(str).sort_values("set")


def main(argv=None):
    """Read the command line, diagnose, write, record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="SET")
    given = parser.parse_args(argv)
    if not REAL.is_dir():
        raise SystemExit(f"needs the photographs of {REAL}")
    logging.disable()
    for name in given.names or board_sets():
        with tempfile.TemporaryDirectory() as folder:
            row = diagnosed(name, Path(folder))
        print(json.dumps(row), flush=True)
        table = with_row(stored_table(), row)
        with job.write_atomically(TABLE) as file:
            table.to_csv(file, index=False, lineterminator="\n")
        with job.write_atomically(PAGE) as file:
            file.write(page(table))
    record(figures(stored_table()), "python tests/bench/bench_real_boards.py")


if __name__ == "__main__":
    main()
