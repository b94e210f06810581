"""The independent generator of blind campaigns: exact geometry and levels, repeatable, of no code of the project."""

import itertools
from pathlib import Path

import cv2
import numpy as np
import pytest

from generator import LIBRARY, OUTSIDE, draw_effect, generate_campaign, nominal, optics, rays, tracer
from generator.campaign import CampaignCamera, plate_maps
from generator.processing import drawn_order, process
from job_inputs import names_imported

CAMERA = nominal.Camera("hp325", 480, 270, 369.5)
TINY = nominal.RIGS["tiny"].cameras[0]


def pose(height=0.5, tilt=20.0, turn=(0.02, 0.03, 0.05)):
    """A station's pose, turned a little so that no edge lies along the pixels."""
    rotation = cv2.Rodrigues(np.array(turn, float))[0] @ nominal.station_rotation(tilt)
    return rotation, np.array([0.01, 0.0, height])


def project(points, rotation, centre, k1=0.0, k2=0.0, p1=0.0, p2=0.0):
    """OpenCV's projection of world points (N, 3) to pixels."""
    k = np.array([[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fx, CAMERA.cy], [0, 0, 1]])
    rvec = cv2.Rodrigues(rotation)[0]
    pixels, _ = cv2.projectPoints(np.asarray(points, float), rvec, -rotation @ centre, k, np.array([k1, k2, p1, p2]))
    return pixels.reshape(-1, 2)


def black_square_image(effects, rotation, centre):
    """Light of the rig with every code all black, so that a code is one quadrilateral, on white
    everywhere else.
    """
    rig = CampaignCamera(CAMERA, effects, "s")
    rig.plates[2][:] = 1
    maps, eyes = plate_maps(rig.plates, *rays.row_poses(rotation, centre, CAMERA, effects, 0, 1))
    dx, dy = rig.grids[0]
    return tracer.trace(
        dx,
        dy,
        rotation[None, :, 2].copy(),
        maps,
        eyes,
        rig.plates[2],
        0.05,
        rig.plates[3],
        0.0,
        np.zeros(40),
        0,
        np.array([1.0, 0.0, 1.0, 1.0]),
        tracer.PIXEL_NET,
        4,
    )[0]


def outline(marker, side, n=200):
    """World points (4 n, 3) around a square of ``side`` m about a marker, clockwise from its top left
    corner.
    """
    t = np.linspace(-0.5, 0.5, n, endpoint=False)
    ring = np.concatenate(
        [
            np.column_stack([t, t * 0 + 0.5]),
            np.column_stack([t * 0 + 0.5, -t]),
            np.column_stack([-t, t * 0 - 0.5]),
            np.column_stack([t * 0 - 0.5, t]),
        ]
    )
    return np.column_stack([marker["x"] + side * ring[:, 0], marker["y"] + side * ring[:, 1], np.zeros(4 * n)])


def area_and_centroid(polygon):
    """Shoelace area and centroid of a closed polygon (N, 2)."""
    origin = polygon.mean(0)
    p, q = polygon - origin, np.roll(polygon - origin, -1, 0)
    cross = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
    return cross.sum() / 2, origin + ((p + q) * cross[:, None]).sum(0) / (3 * cross.sum())


@pytest.mark.parametrize(
    "lens",
    [{}, {"k1": -0.15, "k2": 0.04, "p1": 0.006, "p2": -0.004}],
    ids=["pinhole", "distorted"],
)
def test_codes_lie_where_opencv_projects_them(lens):
    """Area and centroid of every whole code agree with OpenCV's projection; else rays, lens or pixel
    centres are off.
    """
    rotation, centre = pose()
    effects = {}
    if lens:
        effects["radial_distortion"] = {"model": "brown", "k1": lens["k1"], "k2": lens["k2"]}
        effects["tangential_distortion"] = {"p1": lens["p1"], "p2": lens["p2"]}
    dark = 1.0 - black_square_image(effects, rotation, centre).astype(float)
    checked = 0
    for marker in nominal.rail_plates():
        polygon = project(outline(marker, 0.07), rotation, centre, **lens)
        low, high = np.floor(polygon.min(0)).astype(int) - 2, np.ceil(polygon.max(0)).astype(int) + 2
        if (low < 0).any() or (high >= [CAMERA.width, CAMERA.height]).any():
            continue
        patch = dark[low[1] : high[1] + 1, low[0] : high[0] + 1]
        v, u = np.mgrid[low[1] : high[1] + 1, low[0] : high[0] + 1]
        area, middle = area_and_centroid(polygon)
        perimeter = np.linalg.norm(polygon - np.roll(polygon, 1, 0), axis=1).sum()
        # The mean displacement of the outline, and of the whole, in pixels.
        assert abs(patch.sum() - area) / perimeter < 0.01
        assert np.abs(np.array([(patch * u).sum(), (patch * v).sum()]) / patch.sum() - middle).max() < 0.01
        checked += 1
    assert checked >= 15


@pytest.mark.parametrize("size", nominal.RIGS)
def test_plates_are_as_large_as_their_rig_declares(size):
    """Fails if a rig's plates are drawn with another one's margin, in other reflectances, or elsewhere than it declares."""
    rig, checked = nominal.RIGS[size], 0
    rotation, centre = pose(rig.heights_m[0], rig.tilts_deg[-1])
    light = CampaignCamera(CAMERA, {}, "s", rig=rig).linear_light(rotation, centre)[..., 0]
    for marker in rig.plates:
        rings = {(rig.code_m + rig.plate_m) / 2: "white", 1.1 * rig.plate_m: "ground"}
        for side, surface in rings.items():
            x, y = np.rint(project(outline(marker, side), rotation, centre)).astype(int).T
            if np.ptp(y) < 30 or min(x.min(), y.min()) < 0 or x.max() >= CAMERA.width or y.max() >= CAMERA.height:
                break
            assert set(light[y, x]) == {np.float32(rig.reflectance[surface])}
            checked += 1
    assert checked >= 4


def test_corners_of_the_nearest_codes_to_a_hundredth_of_a_pixel():
    """Lines through the sub-pixel crossings of each edge meet where OpenCV projects the corner; else a
    corner is off.
    """
    rotation, centre = pose(0.5, 45.0, (0.02, 0.03, 0.2))
    image = black_square_image({}, rotation, centre).astype(float)
    checked = 0
    for marker in nominal.rail_plates():
        corners = project(outline(marker, 0.07, 1), rotation, centre)
        if corners.min() < 8 or (corners.max(0) > [CAMERA.width - 8, CAMERA.height - 8]).any():
            continue
        lines = []
        for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
            along = int(np.abs(b - a).argmax())  # columns or rows, whichever the edge runs along
            low, high = sorted((a[along], b[along]))
            stations = np.arange(int(np.ceil(low + 3)), int(np.floor(high - 3)) + 1)
            if len(stations) < 4:
                break
            across = (a + (b - a) * ((stations - a[along]) / (b - a)[along])[:, None])[:, 1 - along]
            inner = corners.mean(0)[1 - along]
            crossing = []
            for s, c in zip(stations, across, strict=True):
                near = np.arange(round(c) - 4, round(c) + 5)
                profile = 1 - (image[near, s] if along == 0 else image[s, near])
                share = profile.sum()  # how much of the window is black
                crossing.append(near[0] - 0.5 + share if inner < c else near[-1] + 0.5 - share)
            slope, offset = np.polyfit(stations, crossing, 1)
            lines.append((along, slope, offset))
        if len(lines) < 4:
            continue
        for k in range(4):
            rows = [((-m, 1.0) if along == 0 else (1.0, -m)) for along, m, _ in (lines[k - 1], lines[k])]
            met = np.linalg.solve(rows, [lines[k - 1][2], lines[k][2]])
            assert np.abs(met - corners[k]).max() < 0.01, (marker, k, met - corners[k])
        checked += 1
    assert checked >= 4


def test_levels_are_exact():
    """White, black, ground and background come out at their encoded values; else encoding or flats are
    wrong.
    """
    rotation, centre = pose(tilt=12.0)
    light = CampaignCamera(CAMERA, {}, "s").linear_light(rotation, centre)[..., 0]
    values, counts = np.unique(light, return_counts=True)
    assert set(np.float32([0.8, 0.05, 0.35, 0.3])) == set(values[counts > 200])
    image = np.stack([CampaignCamera(CAMERA, {}, "s").photograph(rotation, centre, f"c{k}") for k in range(4)])
    for level in (0.8, 0.05, 0.35, 0.3):
        expected = 255 * (1.055 * level ** (1 / 2.4) - 0.055)
        seen = image[:, light == np.float32(level)]
        assert abs(seen.mean() - expected) < 0.06
        assert abs(seen.std() - np.sqrt(nominal.RIGS["tiny"].noise_dn ** 2 + 1 / 12)) < 0.05


@pytest.mark.parametrize(("dictionary", "name"), [("DICT_5X5_1000", 0), ("DICT_ARUCO_ORIGINAL", 0)])
def test_bits_are_those_of_opencv(dictionary, name):
    """The modules equal OpenCV's drawing; else codes would be of another dictionary."""
    table = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    for number in (0, 7, 19):
        drawn = cv2.aruco.generateImageMarker(table, number, 7)
        assert np.array_equal(nominal.black_modules(dictionary, number), drawn == 0)


@pytest.mark.parametrize("name", [*LIBRARY, *OUTSIDE])
def test_every_effect_changes_the_image_and_grows(name):
    """Each effect changes the noise-free-seeded image at clear strength and less at a tenth; else it
    hides nothing.
    """
    rotation, centre = pose()
    ideal = CampaignCamera(TINY, {}, "s").photograph(rotation, centre, "c").astype(float)

    def change(strength):
        effects = {name: draw_effect(name, strength, TINY, "seed")}
        image = CampaignCamera(TINY, effects, "s").photograph(rotation, centre, "c")
        return np.sqrt(np.mean((image - ideal) ** 2))

    assert change(1.0) > 0.7
    assert change(0.1) < change(1.0)


def moments(name, parameters):
    """Mean square distance (px^2) along x and y between a fine sample of light and the pixels that it
    lands in.
    """
    camera = nominal.Camera("x", 41, 41, 40.0)
    total = np.zeros(2)
    for place in itertools.product(range(optics.FINE), repeat=2):
        fine = np.zeros((41 * optics.FINE, 41 * optics.FINE), np.float32)
        fine[20 * optics.FINE + place[1], 20 * optics.FINE + place[0]] = 1.0
        out = optics.spread(fine, np.ones(fine.shape), camera, {name: parameters}, 0).astype(float)
        distance = [np.arange(41) - 20 - (k - 1) / optics.FINE for k in place]
        total += (out.sum(0) * distance[0] ** 2).sum(), (out.sum(1) * distance[1] ** 2).sum()
    return tuple(total)


@pytest.mark.parametrize(
    ("name", "parameters", "expected"),
    [
        ("lens_blur", {"sigma_px": 1.3}, (1.69, 1.69)),
        ("lens_blur", {"sigma_px": 0.4}, (0.16, 0.16)),
        ("motion_blur", {"length_px": 5.0, "angle_deg": 0.0}, (25 / 12, 0.0)),
        ("motion_blur", {"length_px": 4.0, "angle_deg": 90.0}, (0.0, 16 / 12)),
        ("defocus", {"focus_m": 0.5, "aperture_m": 0.15}, (9 / 4, 9 / 4)),
    ],
)
def test_spreads_have_the_second_moment_of_their_physics(name, parameters, expected):
    """Spread and pixel box add up to the physical variances; else blur is biased by the fine grid."""
    box = (optics.FINE**2 - 1) / 12 / optics.FINE**2  # a pixel as so many fine samples side by side
    assert moments(name, parameters) == pytest.approx(np.add(expected, box), rel=0.005, abs=0.005)


def test_a_camera_that_pans_while_it_reads_shears_the_image():
    """The rotating camera's shear equals f times its rate at the image's middle; else truth and image
    disagree in sign.
    """
    rotation, centre = pose(turn=(0, 0, 0))
    rate = 0.01 / CAMERA.fx
    effects = {"rolling_shutter": {"model": "moving camera", "turn_rad_per_row": [0, rate, 0],
                                   "slide_m_per_row": [0, 0, 0]}}  # fmt: skip
    poses, _ = rays.row_poses(rotation, centre, CAMERA, effects, 0, 1)
    along_axis = rotation[2]
    seen = poses[200] @ along_axis
    assert CAMERA.fx * seen[0] / seen[2] == pytest.approx(0.01 * (200 - CAMERA.cy), rel=1e-3)


def test_same_seed_same_bytes_other_seed_other_images(tmp_path):
    """A campaign repeats byte for byte by its seed's name, and another seed gives another; else trials
    do not repeat.
    """
    effects = [("sensor_noise", draw_effect("sensor_noise", 1, TINY, "a"))]
    generate_campaign(tmp_path / "1" / "c", tmp_path / "e1", effects, "a", "tiny")
    generate_campaign(tmp_path / "2" / "c", tmp_path / "e2", effects, "a", "tiny")
    generate_campaign(tmp_path / "3" / "c", tmp_path / "e3", effects, "b", "tiny")
    files = [p.relative_to(tmp_path / "1") for p in (tmp_path / "1").rglob("*") if p.is_file()]
    assert len(files) == 7
    for file in files:
        assert (tmp_path / "1" / file).read_bytes() == (tmp_path / "2" / file).read_bytes()
        same = (tmp_path / "1" / file).read_bytes() == (tmp_path / "3" / file).read_bytes()
        assert same == (file.suffix != ".png")
    assert (tmp_path / "e1/truth.json").read_bytes() == (tmp_path / "e2/truth.json").read_bytes()


def test_the_generator_shares_no_code_with_the_project():
    """No import of the project's modules; else a trial would be an inverse crime."""
    bench, scripts = Path(__file__).parent / "bench", Path(__file__).parents[1] / "scripts"
    own = {path.stem for path in scripts.iterdir()}
    assert {"inputs", "rig", "effects", "gap", "job", "trials"} <= own
    for file in (bench / "generator").glob("*.py"):
        assert not {name.split(".")[0] for name in names_imported(file)} & own
    generate = names_imported(scripts / "trials/generate_trials.py")
    assert {name for name in generate if name.split(".")[0] in own} == {
        "rig.errors",
        "rig.errors.InputError",
        "trials.real_trials",
        "trials.real_trials.generate_real_trial",
        "trials.trial_names",
        *(f"trials.trial_names.{name}" for name in ("KINDS", "POWER_STRENGTHS", "identity")),
    }
    of_photographs = names_imported(scripts / "trials/real_trials.py")  # reads campaigns, but lays on what is its own
    assert not {name.split(".")[0] for name in of_photographs} & {"effects", "gap"}


def test_unknown_effects_are_refused(tmp_path):
    """Fails if a misspelt effect is passed over: a trial would hide nothing."""
    with pytest.raises(ValueError, match="lens_blurr"):
        generate_campaign(tmp_path / "c", tmp_path / "e", [("lens_blurr", {})], "s", "tiny")
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    "names", [("defocus", "field_curvature"), ("motion_blur", "lens_blur"), ("plate_curl", "rolling_shutter"),
              ("lateral_chromatic_aberration", "defocus"), ("specular_highlight", "ghost_double")]
)  # fmt: skip
def test_effects_of_one_stage_work_together(names, tmp_path):
    """Two effects change the image more than either alone; else one of a pair is dropped on the way."""
    rotation, centre = pose()
    effects = {name: draw_effect(name, 1, TINY, "seed") for name in names}

    def photograph(hidden):
        return CampaignCamera(TINY, hidden, "s").photograph(rotation, centre, "c").astype(float)

    both = photograph(effects)
    for name in names:
        assert np.sqrt(np.mean((both - photograph({name: effects[name]})) ** 2)) > 0.7


def test_the_curves_place_is_drawn_where_it_meets_a_filter():
    """Every order comes, denoising before sharpening, the same for the same seed; else only one kind of camera is tried."""
    effects = dict.fromkeys(("denoising", "sharpening", "tone_curve", "lens_blur"), {})
    orders = {tuple(drawn_order(effects, f"seed {k}")) for k in range(40)}
    assert orders == {
        ("tone_curve", "denoising", "sharpening"),
        ("denoising", "tone_curve", "sharpening"),
        ("denoising", "sharpening", "tone_curve"),
    }
    both = {tuple(drawn_order({"tone_curve": {}, "sharpening": {}}, f"seed {k}")) for k in range(40)}
    assert both == {("tone_curve", "sharpening"), ("sharpening", "tone_curve")}
    assert all(drawn_order(effects, f"seed {k}") == drawn_order(effects, f"seed {k}") for k in range(10))
    for names in (["denoising"], ["sharpening"], ["tone_curve"], ["denoising", "sharpening"]):
        assert drawn_order(dict.fromkeys(names, {}), "s") == names


def test_steps_are_taken_in_the_order_of_the_truth(tmp_path):
    """An edge sharpened before the curve is another than one after it, and the campaign's is the one that the truth tells."""
    effects = {name: draw_effect(name, 1, TINY, "seed") for name in ("sharpening", "tone_curve")}
    edge = np.zeros((8, 20, 3), np.float32) + np.where(np.arange(20) < 10, 60, 180)[:, None]
    curve_last = process(process(edge, effects, ["sharpening"]), effects, ["tone_curve"])
    assert np.abs(process(edge, effects, ["sharpening", "tone_curve"]) - curve_last.astype(int)).max() <= 1
    assert np.abs(process(edge, effects, ["tone_curve", "sharpening"]) - curve_last.astype(int)).max() > 2
    seeds = {drawn_order(effects, f"s{k}")[0]: f"s{k}" for k in range(20)}
    images = {}
    for first, seed in seeds.items():
        truth = generate_campaign(tmp_path / first, tmp_path / "e", list(effects.items()), seed, "tiny")
        assert truth["order"][0] == first
        rig = CampaignCamera(TINY, effects, seed)
        rotation, centre = pose()
        images[first] = [rig.photograph(rotation, centre, "c")]
        rig.order = rig.order[::-1]
        images[first].append(rig.photograph(rotation, centre, "c"))
    assert len(images) == 2 and all((a != b).any() for a, b in images.values())
