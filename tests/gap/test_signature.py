"""What photographs of a board show besides where points lie, laid on by code that shares nothing with the effects under test."""

import numpy as np
import pytest
from drawn_board import board_case, photograph

import gap.signatures.signature_changes
from effects import library
from effects.pipeline import map_points
from gap.bounds import TWICE
from gap.observables import SIGNS
from gap.signatures.signature import OF_CODEC, TURNS, Photograph, _fineness
from gap.signatures.signature_changes import (
    Layer,
    candidates_of,
    compared,
    scaled,
    signature_changes,
    signatures_of,
    starts_of,
    tried,
    ways_of,
)
from generator import nominal
from generator.photographs import Retaken
from rig.geometry import project

BLUR = [("lens_blur", library.nulls_of("lens_blur") | {"sigma_px": 0.6})]
NAMES = ["lens_blur", "sharpening", "sensor_noise", "exposure"]


def taken(part, effects, numbers, moved_px=0):
    """Return the Photographs, taken again with the generator's effects laid on, of some captures; then moved over the pixels."""
    case = board_case(14)
    camera, found = nominal.Camera("camera", 320, 240, 420.0), []
    retaken = Retaken(camera, effects, part)
    for k in numbers:
        view = case.captures[k].view
        image = retaken.photograph(photograph(case, k, BLUR).astype(np.uint8), view.capture)
        image = np.roll(image, (moved_px, moved_px), (0, 1))
        corners = project(view.K, view.T_cam_world, case.corners) + moved_px
        plates, features = case.patches_seen(image, corners)
        found.append(Photograph(image, view, case.codes, plates, features))
    return found


@pytest.fixture(scope="module")
def before():
    """Seven photographs with nothing laid on."""
    return taken("before", {}, range(0, 14, 2))


def after(effects):
    """Return seven other photographs by the camera with the generator's effects laid on."""
    return taken("after", effects, range(1, 14, 2))


def test_nothing_is_named_where_nothing_has_changed(before):
    """Fails if other photographs, each in its own light and pose, pass for another camera."""
    found, p, _ = signature_changes(before, after({}), NAMES, "c")
    assert not found and p > 0.01


@pytest.mark.parametrize(
    ("name", "laid", "parameter", "value"),
    [
        ("lens_blur", {"sigma_px": 1.2}, "sigma_px", 1.2),
        ("sharpening", {"amount": 1.0, "sigma_px": 1.0}, "amount", 1.0),
        ("exposure", {"scale": 0.5}, "scale", 0.5),
    ],
)
def test_what_was_laid_on_is_named_with_its_size(before, name, laid, parameter, value):
    """Fails if a change gets another name, goes the wrong way, or its size is not the generator's."""
    found, p, _ = signature_changes(before, after({name: laid}), NAMES, "c")
    assert [(c.effect, c.less) for c in found] == [(name, False)] and p > 0.01
    off = found[0].parameters[parameter] - value
    assert abs(off) < 0.1 * value + 3 * found[0].errors[parameter]
    assert found[0].after < 0.6 * found[0].before
    assert found[0].like_light == (name == "exposure")


def test_what_is_too_small_for_a_name_leaves_it_to_the_next(before, monkeypatch):
    """Fails if a blur has no name because another effect, too small to matter, explains it a little better."""
    monkeypatch.setattr(gap.signatures.signature_changes, "is_significant", lambda effect, *_: effect != "lens_blur")
    found, *_ = signature_changes(before, after({"lens_blur": {"sigma_px": 1.2}}), ["lens_blur", "defocus"], "c")
    assert [c.effect for c in found] == ["defocus"]


def test_no_candidate_is_no_name(before):
    """Fails if a campaign whose candidates are all of geometry ends in an error."""
    found, p, _ = signature_changes(before, after({"lens_blur": {"sigma_px": 1.2}}), ["radial_distortion"], "c")
    assert not found and p <= 0.01


def test_less_of_an_effect_is_a_change_too():
    """Fails if only what is added counts: here a blur goes away, and noise, which comes after a lens, stays."""
    noise = {"sensor_noise": {"full_well_e": 3000.0, "read_noise_e": 20.0}}
    sets = taken("before", {"lens_blur": {"sigma_px": 1.2}} | noise, range(0, 14, 2)), after(noise)
    found, *_ = signature_changes(*sets, NAMES, "c")
    assert [(c.effect, c.less) for c in found] == [("lens_blur", True)]


def test_what_laying_on_does_is_nothing_where_an_effect_does_nothing(before):
    """Fails if windows are cut, encoded and decoded so that the photograph does not come back: all changes would have it."""
    plain = before[0].signature()
    again = before[0].signature([("lens_blur", library.nulls_of("lens_blur"))], np.random.default_rng(0))
    np.testing.assert_allclose(again, plain, atol=1e-6)


def test_a_whole_photograph_is_blurred_as_its_windows_are(before):
    """Fails if points are found again in other photographs than those that gave an effect its name."""
    shot, effects = before[0], [("lens_blur", library.nulls_of("lens_blur") | {"sigma_px": 1.0})]
    rng = [np.random.default_rng(0) for _ in range(2)]
    whole, windows = shot.whole(effects, rng[0]), shot.levels(effects, rng[1])
    k = int(np.argmax([w[1].stop - w[1].start for w in map(shot.atlas.window, range(len(shot.plates)))]))
    x0, y0, x1, y1 = shot.atlas.cores[k]
    np.testing.assert_allclose(windows[shot.atlas.core(k)], whole[y0:y1, x0:x1], atol=1)


@pytest.mark.parametrize(
    ("follow", "apart"), [(0.0, 0.0), (5.0, 1.5)], ids=["not at all", "closely, and sets lie apart"]
)
def test_p_says_how_often_chance_differs_however_signs_follow_poses(follow, apart):
    """Fails if permuted signs keep what regression took from the given ones: three of five sets drawn alike then have p <= 0.2,
    or one of forty.
    """
    rng, labels = np.random.default_rng(1), np.repeat([0.0, apart], 5)[:, None]

    def p_of_sets_drawn_alike():
        poses = rng.normal(size=(10, 3)) + labels
        signs = rng.normal(size=(10, len(SIGNS))) + follow * poses @ rng.normal(size=(3, len(SIGNS)))
        return compared(signs[:5], signs[5:], 0, poses).p

    assert 0.1 < np.mean([p_of_sets_drawn_alike() <= 0.2 for _ in range(150)]) < 0.32


def test_permuted_sets_tell_how_often_chance_differs_as_much():
    """Fails if p is small for sets drawn alike, or not the smallest for one that differs in every sign."""
    rng = np.random.default_rng(0)
    sets = [rng.normal(size=(7, len(SIGNS))) for _ in range(2)]
    assert compared(*sets, 0).p > 0.05
    assert compared(sets[0], sets[1] + 8, 0).p < 0.01
    assert [compared(*(rng.normal(size=(6, len(SIGNS))) for _ in range(2)), 0).p < 0.1 for _ in range(60)].count(
        True
    ) < 15


def test_a_small_change_along_an_effect_is_told():
    """Fails if what an effect moves is not looked at as one thing, is seen where nothing moved, or hides what no effect does."""
    rng, n = np.random.default_rng(1), len(SIGNS)
    ways, other = rng.normal(size=(40, n)), np.eye(n)[3]
    along = ways[7] / np.linalg.norm(ways[7])
    told = []
    for _ in range(30):
        first, second = rng.normal(size=(2, 6, n))
        moved = [(second + 4.0 * along, ways), (second + 4.0 * along, ()), (second + 5.0 * other, ways), (second, ways)]
        told.append([compared(first, later, 0, ways=of).p <= 0.01 for later, of in moved])
    of_effects, without, of_others, by_chance = np.mean(told, axis=0)
    assert of_effects > without + 0.2 and of_others > 0.8 and by_chance < 0.1


def test_ways_are_the_same_whichever_set_photographs_are_in(before):
    """Fails if effects are laid on one set's photographs alone: chance that is theirs then passes for a change."""
    sets = (before[:3], before[3:])
    first, second = (ways_of(["lens_blur"], of, map) for of in (sets, sets[::-1]))
    np.testing.assert_array_equal(first, second)


def test_a_picture_that_moved_over_a_codecs_blocks_is_no_other_codec():
    """Fails if half a block's shift makes no difference to what is compared, or still makes one where blocks do not count."""
    laid = {"jpeg_compression": {"quality": 40, "subsampling": "4:2:0"}}
    sets = [taken("before", laid, range(0, 14, 2)), taken("after", laid, range(1, 14, 2), moved_px=4)]
    signs = [signatures_of(photographs, (), map) for photographs in sets]
    assert compared(*signs, 0).p < 0.01 < 0.05 < compared(*signs, 0, uncounted=OF_CODEC).p


def test_signs_that_are_rarely_shown_do_not_count():
    """Fails if a sign that most photographs lack is filled in, and then differs."""
    sets = [np.random.default_rng(k).normal(size=(6, len(SIGNS))) for k in (0, 1)]
    sets[1][:4, 3] = np.nan
    assert 3 not in compared(*sets, 0).counted and len(compared(*sets, 0).counted) == len(SIGNS) - 1


def test_grey_photographs_are_asked_for_no_colours():
    """Fails if what is invisible in grey is laid on, or the scene, which is in the light already."""
    asked = candidates_of(sorted(library.available_effects()), in_colour=False)
    assert "lens_blur" in asked and "sensor_noise" in asked
    assert not {"colour_balance", "lateral_chromatic_aberration", "marker_scale", "radial_distortion"} & set(asked)


def test_alternatives_that_a_start_mixes_are_tried_alone():
    """Fails if of four mosaics only their mean is laid on, which is none."""
    alone = [s for s in starts_of("bayer_demosaic") if max(s["rggb"], s["grbg"], s["gbrg"], s["bggr"]) == 1.0]
    assert len(alone) == 4


def test_a_start_is_scaled_from_nothing():
    """Fails if half of an effect is half of its numbers where nothing is not 0, or auxiliary numbers are scaled as well."""
    nulls = library.nulls_of("sharpening")
    half = scaled("sharpening", nulls | {"amount": 0.8, "radius_px": 2.0}, 0.5)
    assert half == {"amount": pytest.approx(0.4), "radius_px": 2.0}


def test_a_rival_of_what_was_laid_on_is_scaled_until_it_is_one(before):
    """Fails if how much of an effect there is, is asked of its start alone: a defocus then leaves three times what blur does."""
    later = after({"lens_blur": {"sigma_px": 0.9}})
    poses = np.array([p.pose for p in before + later])
    comparison = compared(*(signatures_of(photographs, (), map) for photographs in (before, later)), 1, poses)
    blur, defocus = (tried(name, Layer(before, [], 1, map), comparison) for name in ("lens_blur", "defocus"))
    assert defocus.left < TWICE * blur.left


def test_a_photograph_through_another_lens_shows_its_patches_there(before):
    """Fails if the picture goes one way and the patches' places the other, or the same lens changes the picture."""
    shot = before[0]
    bent = [("radial_distortion", library.nulls_of("radial_distortion") | {"k1": -0.15})]
    seen = shot.seen_by([], bent)
    kept = [shot.plates.tolist().index(k) for k in seen.plates]
    moved = np.abs(seen.features[:, :8] - shot.features[kept, :8]).max()
    view = shot.view
    expected = map_points(shot.features[kept, :8].reshape(-1, 2), view, bent).reshape(-1, 8)
    assert len(kept) >= 10 and moved > 1.0
    assert (
        np.median(np.abs(seen.features[:, :8] - expected)) < 0.06
    )  # a square that is bent is fitted by a straight one
    assert np.array_equal(shot.seen_by(bent, bent).image[20:-20, 20:-20], shot.image[20:-20, 20:-20])


def test_what_interpolation_does_to_noise_it_does_to_both_sets(before):
    """Fails if photographs seen through another lens are held against some whose noise nothing has smoothed."""
    moved = [("principal_point", library.nulls_of("principal_point") | {"dx_px": 5.5, "dy_px": -2.5})]
    noise = [SIGNS.index(name) for name in ("noise_white", "noise_black", "noise_coarse")]
    seen, alike = before[0].seen_by([], moved), before[0].interpolated_as_seen_by([], moved)
    plain, seen, alike = (shot.signature()[noise] for shot in (before[0], seen, alike))
    assert np.abs(seen - alike).max() < 0.1 < 0.3 < np.abs(seen - plain).max()


def test_what_follows_the_boards_distance_hides_no_change():
    """Fails if what signs follow of the pose counts as scatter, or is permuted with it: then a change of half of it is chance."""
    rng = np.random.default_rng(5)
    poses = rng.normal(size=(16, 3))
    signs = 0.05 * rng.normal(size=(16, len(SIGNS))) + poses[:, :1]
    signs[8:] += 0.5
    assert compared(signs[:8], signs[8:], 0).p > 0.05
    assert compared(signs[:8], signs[8:], 0, poses).p < 0.01


@pytest.mark.parametrize("seed", range(8))
def test_five_photographs_of_each_set_show_a_large_change(seed):
    """Fails if of 252 divisions more than the given one and its mirror image are as telling: five and five would never differ."""
    rng = np.random.default_rng(seed)
    signs, poses = rng.normal(size=(10, len(SIGNS))), rng.normal(size=(10, 3))
    signs[5:] += 20
    assert compared(signs[:5], signs[5:], seed, poses).p <= 2 / 252


def test_where_nothing_changed_a_pose_makes_no_change():
    """Fails if what regression leaves is more alike within the sets than between them: more than one in ten are chance."""
    rng = np.random.default_rng(6)
    found = []
    for _ in range(60):
        poses = rng.normal(size=(12, 3))
        signs = rng.normal(size=(12, len(SIGNS))) + poses @ rng.normal(size=(3, len(SIGNS)))
        found.append(compared(signs[:6], signs[6:], 0, poses).p)
    assert np.count_nonzero(np.array(found) < 0.1) < 15


@pytest.mark.parametrize(("dx", "dy"), [(3, 3), (3, -3), (4, 0)], ids=["down", "up", "across"])
def test_a_blur_along_a_line_shows_its_direction(before, dx, dy):
    """Fails if edges blurred along a diagonal count as blurred alike everywhere, or the two diagonals change places."""
    blur = ("motion_blur", library.nulls_of("motion_blur") | {"dx_px": float(dx), "dy_px": float(dy)})
    after, plain = (before[0].signature(laid, np.random.default_rng(0)) for laid in ([blur], []))
    change = dict(zip(SIGNS, after - plain, strict=True))
    assert change["fine_x"] < -0.15
    assert np.sign(np.rint(10 * change["fine_turn"])) == -np.sign(dy)


def test_noise_is_no_sharpness(before):
    """Fails if what flats differ by counts as edges that are sharper."""
    noise = ("sensor_noise", library.nulls_of("sensor_noise") | {"read_noise_dn": 3.0})
    after, plain = (before[0].signature(laid, np.random.default_rng(0)) for laid in ([noise], []))
    change = dict(zip(SIGNS, after - plain, strict=True))
    assert change["noise_black"] > 1 and max(abs(change[name]) for name in ("fine_x", "fine_y", "fine_turn")) < 0.06


@pytest.mark.parametrize("step", [(1, 0), (0, 1), *TURNS])
def test_a_patch_too_small_for_a_sign_takes_it_from_none(step):
    """Fails if one small patch of a photograph hides how sharp all others are, or none but small ones tell."""
    levels = np.random.default_rng(0).normal(100.0, 20.0, (24, 24))
    enough = _fineness([levels], step, 1.0)
    assert np.isfinite(enough) and _fineness([levels, levels[:4, :4]], step, 1.0) == enough
    assert np.isnan(_fineness([levels[:4, :4]], step, 1.0))


def test_a_lens_that_got_sharper_made_no_noise(before):
    """Fails if noise that came in is explained by a blur that went away: laid on, a blur would smooth it."""
    blur = "lens_blur", library.nulls_of("lens_blur") | {"sigma_px": 0.8}
    noise = [SIGNS.index(name) for name in ("noise_white", "noise_black", "noise_coarse")]
    less, more = (Layer(before, [], sign, map).move(*blur) for sign in (-1, 1))
    assert not less[noise].any() and less[SIGNS.index("fine_x")] > 0.1
    assert more[noise].any()
