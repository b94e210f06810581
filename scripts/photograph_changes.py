"""Two sets of photographs of a board by one camera, on files, compared in all that they show: where points lie, and how sharp,
noisy, coloured and compressed they are.

What has changed besides points is laid on the other set, whose points are then found again: a blur moves points as well, and
would pass for a lens. What points show is laid on as well: another lens smooths noise, and would pass for a quieter sensor.
"""

import json
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from case_files import load_measured, load_photographs, read_capture
from effects import library
from gap.boards.photographs import expected_corners
from gap.changes.changes import MIN_CAPTURES, Changes, changes
from gap.fit.split import usable
from gap.signatures.signature import MIN_PATCHES, OF_CODEC, Photograph
from gap.signatures.signature_changes import laid_on_numbers, least_seen_of, signature_changes, why_not_comparable
from inputs import tables
from inputs.campaign import CalibrationBoard
from register.boards import nothing_found
from register.finders import SECTORS, USUAL, board_finders, board_views, save_points


@dataclass(frozen=True)
class PhotographSet:
    """Where the photographs of a set are: folders campaign and expand, files register_json and observations."""

    campaign: Path
    expand: Path
    register_json: Path
    observations: Path

    @property
    def board(self):
        """The inputs.campaign.CalibrationBoard that is photographed, None of a rig."""
        target = json.loads((Path(self.expand) / "scene.json").read_text())["target"]
        return CalibrationBoard.model_validate(target) if target else None

    @property
    def finder(self):
        """The number of the finder that found the board's points (register.finders)."""
        with np.load(self.observations) as stored:
            return int(stored["finder"])

    def measured(self, camera, observations=None):
        """Return the problem of where points lie, from other ``observations`` than the set's own where given."""
        measured = observations or self.observations
        return load_measured(self.expand, self.register_json, camera, measured, MIN_CAPTURES)

    def photographs(self, camera, views):
        """Return [signature.Photograph], seen from {capture: view}; those that show no patches have no plates."""
        table = tables.read_table(Path(self.expand) / "captures.csv", tables.CAPTURES).set_index("capture")
        images = {name: pixels_of(read_capture(self.campaign, table.image[name])) for name in views}
        with np.load(self.observations) as stored:
            points, pixels = stored["points"], stored["pixels"]
        case, found = load_photographs(self.expand, self.register_json, camera), []
        for (name, image), xy in zip(images.items(), pixels, strict=True):
            plates, features = case.patches_seen(image, expected_corners(points, xy, case.patches))
            found.append(Photograph(image, views[name], case.codes, plates, features))
        return found


def pixels_of(image):
    """Return an image (H, W, C) of grey levels in 8 bits, of one channel where all are the same."""
    pixels = np.rint(image).astype(np.uint8)
    return pixels if (pixels != pixels[..., :1]).any() else pixels[..., :1]


@dataclass(frozen=True)
class WhatChanged:
    """Changes of where points lie, changes [signature_changes.SignatureChange] of all else and p of what these leave.

    least_seen {effect: (times, {parameter: value}) or None}: the least amount that would have been seen (power.least_seen)
    photographs are those of each set [signature.Photograph] that were compared; ``why_points_alone`` says why nothing but
    points was, None where more was.
    """

    points: Changes
    signatures: tuple
    p_left: float = 1.0
    least_seen: dict = field(default_factory=dict)
    photographs: tuple = ((), ())
    why_points_alone: str | None = None


def what_changed(sets, camera, effects=(), candidates=None, threads=1):
    """Return the WhatChanged between two PhotographSets, the earlier first.

    effects [(name, parameters)] that either has, to start from; candidates: names of effects that may have changed.
    Raises ValueError where too few photographs show the board.
    """
    problems = [s.measured(camera) for s in sets]
    if not problems[0].is_board:
        points = changes(*problems, effects, candidates, threads)
        return WhatChanged(points, (), least_seen=points.least_seen)
    photographs = [
        s.photographs(camera, {c.view.capture: c.view for c in problem.captures})
        for s, problem in zip(sets, problems, strict=True)
    ]
    problems, finder = by_one_finder(sets, camera, problems, photographs)
    placed = [placed_in(problem) for problem in problems]
    showing = tuple(
        [p for p in of_set if p.view.capture in known and len(p.plates) >= MIN_PATCHES]
        for of_set, known in zip(photographs, placed, strict=True)
    )
    effects = [(name, p) for name, p in effects if library.is_pure_geometry(name)]  # all that points show
    points = changes(*problems, effects, candidates, threads)
    if why := why_not_comparable(*showing):
        return WhatChanged(points, (), least_seen=points.least_seen, why_points_alone=why)
    found, p_left, comparison = signature_changes(*showing, candidates, camera, threads)
    if found:
        again = list(problems)
        for less in (False, True):
            if laid := [effect for change in found if change.less == less for effect in change.laid]:
                again[less] = found_again(sets[less], camera, photographs[less], placed[less], laid, finder)
        laid_on = changes(*again, effects, candidates, threads)
        if points.changes and laid_on.changes and not with_other_lens(showing, points, candidates, camera, threads):
            found, p_left = [], 1.0
        elif points.changes or not laid_on.changes:
            points = laid_on
    least = points.least_seen | least_seen_of(comparison, *showing, found, candidates, threads)
    return WhatChanged(points, tuple(found), p_left, least, showing)


def by_one_finder(sets, camera, problems, photographs):
    """Return (problems, number) of two PhotographSets in which one finder found the points: two differ by more than noise.

    Where sets have another one each, it is that of sectors, if it sees as many photographs of the set that had the usual one.
    """
    finders = [s.finder for s in sets]
    if finders[0] == finders[1]:
        return problems, finders[0]
    for finder in (SECTORS, USUAL):
        k = next(k for k, own in enumerate(finders) if own != finder)
        every = {p.view.capture for p in photographs[k]}
        again = found_again(sets[k], camera, photographs[k], every, [], finder)
        if finder == USUAL or len(placed_in(again)) >= len(placed_in(problems[k])):
            return [again if n == k else problem for n, problem in enumerate(problems)], finder


def placed_in(problem):
    """Return the names of the captures of a board's problem that show enough points for a pose."""
    return {problem.captures[i].view.capture for i in usable(range(len(problem.captures)), problem)}


def with_other_lens(photographs, points, candidates, camera, threads):
    """Return what signatures [SignatureChange] of two sets of photographs show where the earlier ones have the later ones' lens.

    A lens that moves the picture over pixels and a codec's blocks leaves its own traces in noise, and so does interpolation: the
    later ones are interpolated alike. Blocks do not move with the picture, and are not compared. ``points`` are the Changes of
    where points lie.
    """
    lenses = [list(effects) for effects in points.last.effects]
    seen = [p.seen_by(*lenses) for p in photographs[0]], [p.interpolated_as_seen_by(*lenses) for p in photographs[1]]
    seen = [[p for p in of_set if len(p.plates) >= MIN_PATCHES] for of_set in seen]
    return [] if why_not_comparable(*seen) else signature_changes(*seen, candidates, camera, threads, OF_CODEC)[0]


def found_again(of_set, camera, photographs, placed, effects, finder):
    """Return the problem of a PhotographSet's points, found again by a finder in its photographs with effects laid on.

    Of captures that are not ``placed``, a set of names, nobody knows from where they see the board: nothing is laid on them.
    """
    board, found = of_set.board, {}
    find = board_finders(board)[finder]
    for photograph in photographs:
        if photograph.view.capture not in placed:
            found[photograph.view.capture] = nothing_found()
            continue
        image = np.ascontiguousarray(photograph.whole(effects, laid_on_numbers(photograph))[..., ::-1])
        found[photograph.view.capture] = find(image if image.shape[2] > 1 else image[..., 0])
    found = board_views(found, board, (), str(of_set.campaign), [])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "observations.npz"
        with path.open("wb") as file:
            save_points(file, [found[p.view.capture] for p in photographs], finder)
        return of_set.measured(camera, path)
