"""What a board's cells cannot tell, and which further photographs would: drawn ones, so that what is hidden is known."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "bench"))

from diagnose_patches import both_looks  # noqa: E402
from effects import library  # noqa: E402
from gap.boards.instructions import EXPOSURES, FURTHER, MORE, PLACES  # noqa: E402
from gap.boards.needs import MIN_INFORMATION, Told  # noqa: E402
from gap.observables import SIGNS, SIGNS_OF_GROUP  # noqa: E402
from gap.select.outcome import Step  # noqa: E402
from gap.select.search import Search  # noqa: E402
from gap.select.twin import Candidate  # noqa: E402
from gap.signatures.needs_of_cells import OfCells, cells_cannot_tell  # noqa: E402
from reporting.sentences import needs_words  # noqa: E402
from retaken_board import signatures_of  # noqa: E402
from rig.light import LIGHT, exposed  # noqa: E402

COMPETING = ["exposure", "field_curvature", "lens_blur", "sensor_noise", "veiling_glare", "vignetting"]
CORNERS = PLACES[0].words


@pytest.fixture(scope="module")
def photographs():
    """Return (Search, Twin) of photographs by a camera with noise, which the twin has; a tenth more than floors is left open."""
    search = Search(signatures_of({"sensor_noise": {"full_well_e": 3000.0, "read_noise_e": 12.0}}, 4), COMPETING)
    twin = search.fitted([("sensor_noise", library.starts_of("sensor_noise")[0])])
    return search, replace(twin, floors=dict.fromkeys(SIGNS_OF_GROUP, twin.gap / 1.1))


def test_what_cells_hide_is_said_with_what_would_show_it(photographs):
    """Fails if what a photograph's own light takes up counts as seen, a clear blur as hidden, or corners that a board has not
    been in as no help for what grows towards them.
    """
    hidden, alike, needs = cells_cannot_tell(*photographs)
    assert hidden == ["exposure", "field_curvature", "veiling_glare", "vignetting"] and alike == {}
    assert needs == [{"effect": "field_curvature", "text": f"to tell field curvature: {CORNERS}"}]


def test_exposure_is_each_photographs_own_light(photographs):
    """Fails if light is not free in a photograph, or free by other numbers than those that its exposure changes."""
    search, twin = photographs
    look = OfCells(search, twin)
    effects = [*twin.effects, ("exposure", {"scale": 1.0})]
    J, Jp = look.derivatives(effects, [("exposure", "scale")], look.photographs[0])
    left, light = J - Jp @ np.linalg.lstsq(Jp, J, rcond=None)[0], list(look.counted).index(SIGNS.index("light"))
    assert J[light] == pytest.approx(10.0, rel=0.1)  # a floor of 0.1 in the logarithm of light
    assert abs(left[light]) < 0.2 * J[light] and (left**2).sum() < 0.4 * (J**2).sum()  # levels are rounded


def test_what_one_further_photograph_alone_shows_is_chance(photographs):
    """Fails if a lucky photograph makes an instruction of which another like it shows nothing."""
    told = Told(*photographs, ["field_curvature"], OfCells)

    def seen(more):
        return told.seen("field_curvature", more)

    nothing, lucky = ([], FURTHER), (told.look.photographs, 1000.0)
    told.look.further = lambda instruction, k: (lucky, nothing)[k]
    # The same again is no luck
    assert told.need("field_curvature", "", MIN_INFORMATION, seen)["text"].endswith(MORE.words)
    assert told.need("field_curvature", "", 40 * MIN_INFORMATION, seen) is None
    told.look.further, told._brought = lambda instruction, k: lucky, {}
    assert told.need("field_curvature", "", 40 * MIN_INFORMATION, seen)["text"].endswith(CORNERS)


def test_further_photographs_are_as_the_instruction_says(photographs):
    """Fails if a photograph from half the distance shows cells as small, or a shorter exposure leaves the light as it was."""
    look = OfCells(*photographs)
    _, half, double = PLACES

    def first(instruction):
        (of_one,), times = look.further(instruction, 0)
        assert times == FURTHER
        return of_one

    def side_px(photograph):
        corners = photograph.features[:, :8].reshape(-1, 4, 2)
        return np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2))

    plain = look.photographs[0]
    assert side_px(first(half)) > 1.7 * side_px(plain)
    assert side_px(first(double)) < 0.6 * side_px(plain)
    dark = first(EXPOSURES[0])
    np.testing.assert_allclose(dark.light, exposed(plain.light, 0.25))
    assert dark.light[LIGHT.index("gain")] == pytest.approx(plain.light[LIGHT.index("gain")] - np.log(4))
    assert np.median(dark.levels()) < 0.7 * np.median(plain.levels())


@pytest.fixture(scope="module")
def blurred():
    """Return (Search, Twin, its Step) of blurred photographs: another blur, and one that is none, had been near to the step."""
    case = signatures_of(
        {"sensor_noise": {"full_well_e": 3000.0, "read_noise_e": 12.0}, "lens_blur": {"sigma_px": 0.9}}, 6
    )
    search = Search(case, ["defocus", "lens_blur", "motion_blur", "sensor_noise"])
    twin = search.fitted([(name, library.starts_of(name)[0]) for name in ("sensor_noise", "lens_blur")])
    near = [Candidate(n, library.nulls_of(n) | library.starts_of(n)[0], twin, True) for n in ("defocus", "motion_blur")]
    return search, twin, Step("lens_blur", twin, tuple(near), ("defocus", "motion_blur"), "edges")


def test_effects_that_cells_confuse_get_an_instruction(blurred):
    """Fails if small amounts stand for real ones (both blurs are then apart), what was near once counts as alike, or any further
    photographs are said to tell, the corners first.
    """
    search, twin, step = blurred
    _, alike, needs = cells_cannot_tell(search, twin, [step])
    assert alike == {"lens_blur": ["defocus"]}
    assert needs[-1] == {"effect": "defocus", "text": f"to tell defocus from lens blur: {PLACES[1].words}"}


def test_both_looks_say_what_they_cannot_tell():
    """Fails if what cells hide takes the place of what points do, or is lost behind it."""
    look = {
        "verdict": "adequate",
        "steps": [],
        "floor": {},
        "candidates": [],
        "candidates_left": [],
        "within_budget": True,
    }
    look |= {"where": [], "gap": 1.0, "gap_se": 0.1, "gap_as_configured": 1.0, "groups": {}}
    need = {"effect": "field_curvature", "text": f"to tell field curvature: {CORNERS}"}
    points = look | {"not_told": ["print_stretch"], "needs": []}
    cells = look | {"not_told": ["field_curvature", "vignetting"], "needs": [need]}
    record = both_looks(points, cells, [SimpleNamespace(value=1.0, error=0.1, groups={})])
    assert record["not_told"] == ["print_stretch", "field_curvature", "vignetting"] and record["needs"] == [need]
    said = needs_words(record)
    assert "would not show print stretch, field curvature and vignetting at a size worth naming" in said
    assert f"To tell field curvature: {CORNERS}. None of the instructions that were tried would tell" in said
