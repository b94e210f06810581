"""BART on single images: exact corners, recall, no false ids, whatever the image."""

import cv2
import numpy as np
import pytest

from bench.marker_scenes import compare, encode, scene, texture
from detectors import contract
from detectors.bart.codes import code_tables
from rig.plates import aruco_dictionary
from shared_files import shared


@pytest.fixture(scope="module")
def bart():
    return contract.make("bart")


@pytest.mark.parametrize("encoding", ["srgb", "linear"])
def test_corners_are_exact_and_unbiased_whatever_the_encoding(bart, encoding):
    """The gamma of sRGB moves edges by a third of a pixel: unseen, corners would lie inside the truth."""
    errors, found, outward = [], [], []
    for k in range(3):
        rng = np.random.default_rng(100 + k)
        image, truth = scene(rng, 1280, 720, 10, side_px=(60, 120), tilt_deg=(0, 40), encoding=encoding)
        e, f, false = compare(truth, bart.detect(image))
        assert false == 0
        errors.append(e.reshape(-1, 2))
        found.append(f)
        for t, d in zip(np.array(truth, dtype=object)[f], e, strict=True):
            ray = t.corners - t.corners.mean(axis=0)
            outward.append((d * ray / np.linalg.norm(ray, axis=1)[:, None]).sum(axis=1).mean())
    errors = np.concatenate(errors)
    assert np.concatenate(found).all()
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.06
    assert np.abs(errors.mean(axis=0)).max() < 0.01
    assert abs(np.mean(outward)) < 0.02


def test_it_finds_what_opencv_finds_and_more_in_noise(bart):
    opencv = contract.make("aruco_subpix")
    counts = np.zeros(2, int)
    for k in range(3):
        image, truth = scene(np.random.default_rng(k), 960, 540, 8, (40, 70), (0, 45), noise_dn=5)
        counts += [compare(truth, d.detect(image))[1].sum() for d in (bart, opencv)]
    assert counts[0] >= counts[1] and counts[0] >= 23


def test_textures_without_markers_have_no_ids(bart):
    for k in range(20):
        rng = np.random.default_rng(5000 + k)
        assert bart.detect(encode(rng, texture(rng, 400, 600), 0.7, 2.0)) == []


@pytest.mark.parametrize("dictionary", ["DICT_4X4_1000", "DICT_6X6_1000", "DICT_APRILTAG_36h11", "DICT_7X7_1000"])
def test_markers_of_other_dictionaries_are_not_misread(bart, dictionary):
    table = aruco_dictionary(dictionary)
    rng = np.random.default_rng(3)
    for module in (2.2, 3.4, 7.0):
        sheet = np.full((600, 800), 210, np.uint8)
        n = table.markerSize + 2
        side = int(module * n)
        for y in range(20, 600 - side, side * 2):
            for x in range(20, 800 - side, side * 2):
                marker = table.generateImageMarker(int(rng.integers(len(table.bytesList))), n * 8)
                marker = cv2.resize(np.minimum(marker, 210), (side, side), interpolation=cv2.INTER_AREA)
                sheet[y : y + side, x : x + side] = marker
        assert bart.detect(sheet) == []
        assert len(contract.make("bart", [dictionary]).detect(sheet)) > 0


def test_mirrored_markers_are_not_read():
    """The original dictionary is left out: its codes' mirror images are codes of it."""
    bart = contract.make("bart", ["DICT_5X5_1000"])
    image, truth = scene(np.random.default_rng(1), 960, 540, 8, (50, 80))
    assert len(bart.detect(image)) == sum(t.dictionary == "DICT_5X5_1000" for t in truth)
    assert bart.detect(np.ascontiguousarray(image[:, ::-1])) == []


def test_codes_without_a_corner_order_are_left_out():
    """Id 1023 of the original dictionary looks the same after half a turn: its corners would be a guess."""
    (group,) = code_tables(["DICT_ARUCO_ORIGINAL"])
    assert 1023 not in group["owner"][:, 1]
    assert len(np.unique(group["words"])) == len(group["words"])
    assert group["wrong_bits"][0] == 0  # its distance forgives nothing


@pytest.mark.parametrize(
    "parameters",
    [
        {"threshold": "otsu"},
        {"threshold": "both"},
        {"multi_scale": False},
        {"exact_corners": False},
        {"light": "srgb"},
        {"wrong_bits": 0},
    ],
)
def test_every_switch_still_finds_large_markers(parameters):
    image, truth = scene(np.random.default_rng(2), 800, 600, 6, (70, 90), (0, 20), pieces=0)
    _, found, false = compare(truth, contract.make("bart", parameters=parameters).detect(image))
    assert found.sum() >= 5 and false == 0


def test_random_and_cut_up_images_neither_crash_nor_give_ids(bart):
    rng = np.random.default_rng(0)
    image, truth = scene(rng, 640, 480, 5, (50, 80))
    known = {(t.dictionary, t.id) for t in truth}
    for _ in range(150):
        h, w = rng.integers(1, 200, 2)
        y, x = rng.integers(0, 480 - h), rng.integers(0, 640 - w)
        cut = image[y : y + h, x : x + w].copy()
        strips = np.array_split(cut, rng.integers(1, 6))
        rng.shuffle(strips)
        for picture in (cut, np.concatenate(strips), rng.integers(0, 256, (h, w), dtype=np.uint8)):
            for d in bart.detect(picture):
                assert (d.dictionary, d.id) in known and np.isfinite(d.corners).all()


def test_two_threads_get_what_one_gets(bart):
    from concurrent.futures import ThreadPoolExecutor

    images = [scene(np.random.default_rng(k), 640, 480, 5, (50, 80))[0] for k in range(4)]
    alone = [[(d.id, d.corners.tolist()) for d in bart.detect(i)] for i in images]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(bart.detect, images * 4))
    assert [[(d.id, d.corners.tolist()) for d in r] for r in together] == alone * 4


def test_memory_stays_over_ten_thousand_frames(bart):
    """Process memory in pages, from the kernel: a leak of 100 bytes a frame would be a megabyte."""
    from pathlib import Path

    image = scene(np.random.default_rng(4), 200, 160, 1, (50, 51), (0, 5), pieces=3)[0]

    def resident_mb():
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6

    for _ in range(500):
        bart.detect(image)
    before = resident_mb()
    for _ in range(10_000):
        bart.detect(image)
    assert resident_mb() - before < 8


@pytest.mark.parametrize("name", ["aruco_original_board", "aruco_original_single", "aruco5x5_ubiquity_photos"])
def test_real_photographs_are_read_completely(bart, name):
    """Ids of the set's verified.csv, which OpenCV read, and no other."""
    short = {"ARUCO_ORIGINAL": "DICT_ARUCO_ORIGINAL", "5X5_1000": "DICT_5X5_1000"}
    for line in (shared(f"real/{name}") / "verified.csv").read_text().splitlines()[1:]:
        file, markers = line.split(",")[:2]
        if "#" in file:
            continue
        expected = set()
        for part in markers.split(";"):
            dictionary, _, ids = part.strip().partition(":")
            if dictionary in short:
                expected |= {(short[dictionary], int(i)) for i in ids.split()}
        found = bart.detect(cv2.imread(str(shared(f"real/{name}") / file)))
        assert {(d.dictionary, d.id) for d in found} == expected


def test_markers_seen_at_a_grazing_angle_are_looked_at_more_finely(bart):
    """Wrong if only regions that are small both ways got a finer look: 45 x 12 px lack pixels one way only."""
    found = 0
    for marker in range(20, 40):
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_1000)
        code = np.minimum(cv2.aruco.generateImageMarker(dictionary, marker, 7 * 8), 210)
        paper = cv2.copyMakeBorder(code, 12, 12, 12, 12, cv2.BORDER_CONSTANT, value=210)
        side = len(paper) - 1
        # eight times larger than seen, narrower at the far end
        seen = np.float32([[140, 150], [610, 150], [640, 285], [110, 285]]) + np.float32([marker % 5, marker % 7])
        h = cv2.getPerspectiveTransform(np.float32([[0, 0], [side, 0], [side, side], [0, side]]), seen)
        large = cv2.warpPerspective(paper, h, (800, 480), flags=cv2.INTER_LINEAR, borderValue=120)
        image = cv2.GaussianBlur(cv2.resize(large, (100, 60), interpolation=cv2.INTER_AREA), (0, 0), 0.4)
        image = cv2.copyMakeBorder(image, 40, 40, 40, 40, cv2.BORDER_REPLICATE)
        found += [(d.dictionary, d.id) for d in bart.detect(image)] == [("DICT_5X5_1000", marker)]
    assert found >= 12


def test_one_thread_and_two_find_the_same(bart):
    """Wrong if the division of an image hung on the threads: tables would differ from machine to machine."""
    image, _ = scene(np.random.default_rng(12), 960, 540, 8, (14, 60), (0, 50), noise_dn=4)
    threads, found = cv2.getNumThreads(), []
    try:
        for number in (1, 2):
            cv2.setNumThreads(number)
            found.append([(d.dictionary, d.id, d.corners.tolist()) for d in bart.detect(image)])
    finally:
        cv2.setNumThreads(threads)
    assert len(found[0]) > 4 and found[0] == found[1]
