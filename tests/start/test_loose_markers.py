"""Where loose markers lie is estimated from photographs, with uncertainties that keep their word."""

from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from loose_photographs import Table, corners_seen, scattered, shoot, walk

import start_campaign
from inputs.campaign import load_campaign, read_description
from rig.errors import InputError
from start import patterns
from start.loose import named, place_loose_markers
from start.markers import Seen, detect

SIDE_M, FOCAL_PX, K1, SIZE = 0.06, 560.0, -0.12, (640, 480)
DICTIONARY, DICTIONARY_OF_PRINT = "DICT_5X5_1000", "DICT_6X6_1000"


def seen_of(tables, poses, rng, noise_px=0.15, focal_px=FOCAL_PX, k1=K1):
    """Return what a detector says of each photograph: {dictionary: [Seen]}, corners a little inside, with noise."""
    made = []
    for table, pose in zip(tables, poses, strict=True):
        ids, quads = corners_seen(table, pose, focal_px, k1, SIZE, inset_px=0.15)
        quads = quads + rng.normal(0, noise_px, quads.shape)
        once = [k for k in range(len(ids)) if list(ids).count(ids[k]) == 1]
        made.append(Seen(np.array(ids)[once], quads[once], tuple(sorted({i for i in ids if list(ids).count(i) > 1}))))
    return {DICTIONARY: made}


def place(found, photographs, focals=None):
    """Return where the markers of one camera lie."""
    return place_loose_markers(found, [SIZE], [0] * photographs, SIDE_M, focals or {})


def true_places(markers, ids, centres, turns):
    """Return the true centres (n, 2), in the frame of the first row's marker, of the rows of a table."""
    k = [list(ids).index(i) for i in markers.id]
    c, s = np.cos(turns[k[0]]), np.sin(turns[k[0]])
    return (centres[k] - centres[k[0]]) @ np.array([[c, -s], [s, c]])


def scores(seed):
    """Return the errors (n, 2) of one made-up table in its standard errors, and the errors in mm."""
    rng = np.random.default_rng(seed)
    ids = rng.choice(100, 8, replace=False)
    centres, turns = scattered(rng, 8)
    found = seen_of([Table(ids, centres, turns, SIDE_M)] * 8, walk(rng, 8), rng)
    placed = place(found, 8, {0: 0.95 * FOCAL_PX / SIZE[0]})
    assert placed.flat and not placed.left_out
    off = placed.markers[["x", "y"]].to_numpy()[1:] - true_places(placed.markers, ids, centres, turns)[1:]
    return off / placed.markers[["se_x", "se_y"]].to_numpy()[1:], 1000 * off


def test_errors_are_as_large_as_stated():
    """Fails if standard errors are a matrix's diagonal that means nothing: too small, or so large that they say nothing."""
    both = [scores(seed) for seed in range(3)]
    z = np.concatenate([b[0] for b in both])
    assert 0.35 < np.sqrt((z**2).mean()) < 1.4 and np.abs(z).max() < 4
    assert np.sqrt((np.concatenate([b[1] for b in both]) ** 2).mean()) < 0.6  # of half a metre


def test_what_moved_lies_twice_or_was_seen_once_is_named():
    """Fails if one marker that somebody pushed bends the places of all, or goes without a word."""
    rng = np.random.default_rng(5)
    ids = np.arange(10, 18)
    (*centres, spare), (*turns, spare_turn) = scattered(rng, 9)
    centres, turns = np.array(centres), np.array(turns)
    moved = centres.copy()
    moved[2] += 0.012, 0.0
    rest = np.append(ids, 16), np.vstack([centres, spare]), np.append(turns, spare_turn)  # 16 a second time
    late = np.append(ids, 40), np.vstack([moved, spare]), np.append(turns, spare_turn)
    tables = [Table(ids, centres, turns, SIDE_M)] * 3 + [Table(*rest, SIDE_M)]
    tables += [Table(ids, moved, turns, SIDE_M)] * 3 + [Table(*late, SIDE_M)]
    poses = walk(rng, 8)
    placed = place(seen_of(tables, poses, rng), 8, {0: FOCAL_PX / SIZE[0]})
    why = {named(key): words for key, words in placed.left_out}
    assert "lies twice in one photograph" in why[f"{DICTIONARY}/16"]
    assert "seen in one photograph only" in why[f"{DICTIONARY}/40"]
    assert "moved between them" in why[f"{DICTIONARY}/12"] and len(why) == 3
    off = placed.markers[["x", "y"]].to_numpy() - true_places(placed.markers, ids, centres, turns)
    assert sorted(placed.markers.id) == [10, 11, 13, 14, 15, 17] and np.abs(off).max() < 0.0015


def test_too_little_is_said():
    """Fails if places are made up from photographs that share nothing."""
    rng = np.random.default_rng(6)
    centres, turns = scattered(rng, 2)
    with pytest.raises(InputError, match="at least 3 markers"):
        place(seen_of([Table([1, 2], centres, turns, SIDE_M)] * 4, walk(rng, 4), rng), 4)


def test_a_folder_of_loose_markers_becomes_a_campaign(tmp_path, capfd):
    """Fails if places are lost on the way from photographs, whose lens bends, to markers.csv, or the campaign can't be run."""
    rng = np.random.default_rng(1)
    ids = rng.choice(100, 7, replace=False)
    centres, turns = scattered(rng, 7)
    table = Table(ids, centres, turns, SIDE_M)
    for k, pose in enumerate(walk(rng, 6)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), shoot(table, pose, FOCAL_PX, K1, SIZE, rng))
    start_campaign.main([str(tmp_path), "--marker-mm", "60"])
    assert "estimated from the photographs" in capfd.readouterr().err
    campaign = load_campaign(tmp_path)
    markers = pd.read_csv(tmp_path / "markers.csv")
    assert campaign.file.left_open and len(campaign.captures) == 6 and set(markers.id) == set(ids)
    off = markers[["x", "y"]].to_numpy() - true_places(markers, ids, centres, turns)
    assert np.abs(off).max() < 0.002 and (markers.z == 0).all()
    assert (np.abs(off[1:]) < 4 * markers[["se_x", "se_y"]].to_numpy()[1:] + 1e-4).all()
    assert markers.plate_m.iloc[0] == pytest.approx(1.4 * SIDE_M, rel=0.06)


def test_photographs_of_a_print_tell_its_places():
    """Fails if paper, lens and sensor of a real camera are too much: the markers of a board, taken for loose ones."""
    folder = Path("data/raw/aruco6x6_gridboard")
    board = read_description(folder).target
    images = [cv2.imread(str(p), cv2.IMREAD_GRAYSCALE) for p in sorted(folder.glob("images/*.jpg"))[::3]]
    found = {DICTIONARY_OF_PRINT: [detect(image, DICTIONARY_OF_PRINT) for image in images]}
    placed = place_loose_markers(found, [images[0].shape[::-1]], [0] * len(images), board.marker_m, {})
    ids, step = placed.markers.id.to_numpy(), board.marker_m + board.gap_m
    true = np.stack([ids % board.columns, -(ids // board.columns)], axis=1) * step
    off_mm = 1000 * (placed.markers[["x", "y"]].to_numpy() - (true - true[0]))
    assert placed.flat and len(ids) == board.columns * board.rows and not placed.left_out
    assert np.sqrt((off_mm**2).mean()) < 0.6  # of 213 mm; the print itself is half a percent narrow


@pytest.mark.parametrize(
    ("shown", "placeable", "wanted"), [(3, True, "loose"), (3, False, "squares"), (2, True, "squares")]
)
def test_white_paper_between_markers_is_no_chessboard(monkeypatch, shown, placeable, wanted):
    """Fails if markers in most photographs are passed over for squares that their plates happen to make, or the other way."""
    seen = [Seen(np.arange(3 if k < shown else 1), np.zeros((3 if k < shown else 1, 4, 2)), ()) for k in range(5)]
    monkeypatch.setattr(patterns, "dictionaries_seen", lambda images: {DICTIONARY: seen})
    monkeypatch.setattr(patterns, "best_layout", lambda seen: None)
    monkeypatch.setattr(patterns, "_chessboard", lambda images, square_m: "squares")

    def loose(found):
        if not placeable:
            raise InputError("nothing holds them together")
        return "loose"

    assert patterns.find_pattern([None] * 5, None, None, [], loose) == wanted


@pytest.mark.parametrize(
    ("turn", "height_m", "room_m"), [(0.0, 0.0, 0.07), (np.pi / 4, 0.0, 0.07 / (0.5 + 0.5**0.5)), (0.0, 0.01, np.inf)]
)
def test_plates_do_not_overlap(turn, height_m, room_m):
    """Fails if the white of one marker's plate would lie over another's: the twin's plates would fight for it."""
    row = dict(dictionary=DICTIONARY, code_m=0.04, plate_m=0.0, rx=0.0, ry=0.0, y=0.0)
    rows = [row | {"id": 1, "x": 0.0, "z": 0.0, "rz": 0.0}, row | {"id": 2, "x": 0.07, "z": height_m, "rz": turn}]
    assert patterns.room_for_plates(pd.DataFrame(rows)) == pytest.approx(room_m)
