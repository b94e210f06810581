"""The finder of a board's points that is trusted: two look at a few photographs, the slow one at the rest where it is better."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from register import finders
from register.boards import BoardPoints, nothing_found
from register.finders import MAX_COMPARED, SECTORS, USUAL, by_trusted_finder, first_look

BOARD, SIZE = SimpleNamespace(type="chessboard"), (640, 480)
K = np.array([[600.0, 0, 319.5], [0, 600, 239.5], [0, 0, 1]])
POINTS = np.array([[x, y, 0] for y in range(6) for x in range(8)]) * 0.03
NAMES = [f"{k:02d}" for k in range(12)]


def seen_from(k, noise_px):
    """Return the BoardPoints of view k, off by noise."""
    turn, place = np.array([0.5 * np.cos(k), 0.5 * np.sin(k), 0.1]), np.array([-0.1, -0.08, 0.5 + 0.02 * k])
    pixels = cv2.projectPoints(POINTS, turn, place, K, None)[0][:, 0]
    return BoardPoints(POINTS, pixels + np.random.default_rng(k).normal(0, noise_px, pixels.shape), 0)


@pytest.fixture
def look(monkeypatch):
    """Return a function of the usual finder's noise in pixels, and of how many photographs it sees, that returns (trusted finder,
    points by it, names of photographs that were opened again); an image is its view's number.
    """

    def looked(noise_px, usually_seen=12):
        def usual(k):
            return seen_from(k, noise_px) if k < usually_seen else nothing_found()

        monkeypatch.setattr(finders, "board_finders", lambda board: [usual, lambda k: seen_from(k, 0.05)])
        opened, at_first = [], first_look(NAMES, BOARD)
        found = {name: at_first(name, k) for k, name in enumerate(NAMES)}
        assert sum(len(points) == 2 for points in found.values()) == MAX_COMPARED

        def open_image(name):
            opened.append(name)
            return int(name)

        finder, points = by_trusted_finder(found, open_image, BOARD, SIZE, [])
        assert list(points) == NAMES
        return finder, points, opened

    return looked


def test_the_slow_finder_looks_at_few_photographs_where_it_is_not_needed(look):
    """Fails if that of sectors looks at every photograph, twenty times as long, though both find alike."""
    finder, points, opened = look(0.05)
    assert finder == USUAL and opened == []
    assert np.array_equal(points["03"].image, seen_from(3, 0.05).image)


def test_the_better_finder_finds_the_points_of_all_photographs(look):
    """Fails if photographs in which both were not compared keep the usual finder's points, or are opened twice."""
    finder, points, opened = look(1.0)
    assert finder == SECTORS and len(opened) == len(NAMES) - MAX_COMPARED
    assert all(np.array_equal(points[name].image, seen_from(k, 0.05).image) for k, name in enumerate(NAMES))


def test_both_finders_look_at_all_where_the_usual_one_sees_too_few(look):
    """Fails if boards that the usual finder misses are missed because it found no fault with the two that it sees."""
    finder, points, opened = look(0.05, usually_seen=2)
    assert finder == SECTORS and len(opened) == len(NAMES) - MAX_COMPARED
    assert all(len(v.image) == len(POINTS) for v in points.values())
