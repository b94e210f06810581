"""Campaigns are untrusted input: every departure from the format is one message that names file, row, column, value."""

import math

import pytest

from expand_tables import facts_of
from inputs.campaign import load_campaign
from register.registration import prior_of
from rig.errors import InputError
from shared_files import SHARED, shared
from tiny_campaign import CAPTURES, MARKERS, board, write_campaign


def test_a_good_campaign_is_read_as_it_stands(tmp_path):
    campaign = write_campaign(tmp_path / "a folder with spaces")
    read = load_campaign(campaign)
    assert list(read.captures.capture) == ["left_a", "left_b", "right_a", "right_b"]
    assert list(read.markers.id) == [3, 3]  # the same id in two dictionaries is two markers
    assert read.captures.tilt_deg.iloc[3] == 22.5
    assert read.captures.rx.isna().all()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("DICT_ARUCO_ORIGINAL", "DICT_5X5_1000", ["row 3", "column id", "row 2"]),
        ("DICT_ARUCO_ORIGINAL", "DICT_9X9", ["row 3", "column dictionary", "'DICT_9X9'"]),
        ("DICT_ARUCO_ORIGINAL", "DICT_5X5_1000.__class__", ["row 3", "column dictionary"]),
        ("0.4,0,0,0,0\nDICT_A", "nan,0,0,0,0\nDICT_A", ["row 2", "column y", "'nan'"]),
        ("0.4,0,0,0,0\nDICT_A", "near,0,0,0,0\nDICT_A", ["row 2", "column y", "'near'"]),
        ("0.4,0,0,0,0\nDICT_A", "1e999,0,0,0,0\nDICT_A", ["row 2", "column y", "'1e999'"]),
        ("0.4,0,0,0,0\nDICT_A", ",0,0,0,0\nDICT_A", ["row 2", "column y", "''"]),
        ("1000,3,0.07,0.1", "1000,3,0.12,0.1", ["row 2", "column code_m", "0.12", "plate_m 0.1"]),
        ("1000,3,0.07,0.1", "1000,1000,0.07,0.1", ["row 2", "column id", "'1000'", "0 to 999"]),
        ("1000,3,0.07,0.1", "1000,3.5,0.07,0.1", ["row 2", "column id", "'3.5'"]),
        ("1000,3,0.07,0.1", "1000,3,-0.07,0.1", ["row 2", "column code_m", "'-0.07'"]),
        (",plate_m,", ",plate_mm,", ["row 1", "'plate_m'"]),
        ("0,0,0,0\nDICT_A", "0,0,0,0,7\nDICT_A", ["row 2", "11 values for 10 columns"]),
    ],
)
def test_a_bad_marker_is_named(tmp_path, old, new, words):
    assert old in MARKERS
    campaign = write_campaign(tmp_path / "c", markers=MARKERS.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        load_campaign(campaign)
    for word in ["markers.csv", *words]:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("left_b,", "left_a,", ["row 3", "column capture", "'left_a'", "row 2"]),
        ("images/left/b.png", "images/left/a.png", ["row 3", "column image", "row 2"]),
        ("images/left/b.png", "images/./left/a.png", ["row 3", "column image", "row 2"]),
        ("left_b,left", "left_b,middle", ["row 3", "column camera", "'middle'", "left, right"]),
        ("images/left/b.png", "/etc/passwd", ["row 3", "column image", "'/etc/passwd'", "inside"]),
        ("images/left/b.png", "../c2/b.png", ["row 3", "column image", "inside"]),
        ("images/left/b.png", "images/left/none.png", ["row 3", "column image", "no such file"]),
        ("images/left/b.png", "images/{x}.png", ["row 3", "column image", "braces"]),
        ("left_b,left,0.3", "left_b,left,high", ["row 3", "column height_m", "'high'"]),
        ("left_b,left,0.3,45", "left_b,left,0.3,", ["row 3", "column tilt_deg", "''"]),
        ("left_b,", "../b,", ["row 3", "column capture"]),
        ("0.3,45,1", "0.3,45,-1", ["row 3", "column trial", "'-1'"]),
    ],
)
def test_a_bad_capture_is_named(tmp_path, old, new, words):
    assert old in CAPTURES
    campaign = write_campaign(tmp_path / "c", captures=CAPTURES.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        load_campaign(campaign)
    for word in ["captures.csv", *words]:
        assert word in str(error.value)


def test_a_link_out_of_the_campaign_is_refused(tmp_path):
    """Otherwise an untrusted campaign could have any file of the user's opened and shown in a report."""
    campaign = write_campaign(tmp_path / "c")
    (tmp_path / "secret.png").write_bytes(b"x")
    (campaign / "images/left/b.png").unlink()
    (campaign / "images/left/b.png").symlink_to(tmp_path / "secret.png")
    with pytest.raises(InputError, match="row 3.*leaves the campaign"):
        load_campaign(campaign)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(name="../x"), ["name", "'../x'"]),
        (lambda d: d.update(schema=2), ["schema", "1"]),
        (lambda d: d.update(colour="red"), ["colour", "unknown key", "reflectance"]),
        (lambda d: d["cameras"]["left"].update(f=3), ["cameras.left.f", "unknown key", "width"]),
        (lambda d: d["cameras"]["left"].update(width="64"), ["cameras.left.width", "'64'"]),
        (lambda d: d["cameras"]["left"].update(fx=None), ["cameras.left", "all four null"]),
        (lambda d: d["cameras"]["left"].update(fx=math.nan), ["cameras.left.fx", "nan"]),
        (lambda d: d["cameras"]["left"].update(height=10**9), ["cameras.left.height"]),
        (lambda d: d["cameras"].update({"a/b": dict(d["cameras"]["left"])}), ["'a/b'"]),
        (lambda d: d.update(markers="/etc/passwd"), ["markers", "'/etc/passwd'"]),
        (lambda d: d.update(captures="../captures.csv"), ["captures", "inside"]),
        (lambda d: d.update(target={"type": "chessboard", "columns": 9, "rows": 6}), ["square_m"]),
        (lambda d: d["reflectance"].update(white=0.01), ["reflectance", "white"]),
        (lambda d: d["reflectance"].update(grey=0.2), ["reflectance.grey", "unknown key", "ground"]),
        (lambda d: d.update(reflectance="auto"), ["reflectance", "'auto'", "white", "unknown"]),
        (lambda d: d.update(reflectance=0.8), ["reflectance", "'0.8'", "white", "unknown"]),
        (lambda d: d.update(exposure="unknown"), ["exposure", "'unknown'", "number", "auto"]),
        (lambda d: d.update(exposure=-1), ["exposure", "'-1'", "greater than 0"]),
        (lambda d: d.update(exposure=True), ["exposure", "'True'", "number", "auto"]),
        (lambda d: d.update(exposure=None), ["exposure", "'None'", "number", "auto"]),
        (lambda d: d.update(light="lamp"), ["light", "'lamp'", "even", "unknown"]),
        (lambda d: d.update(light=["unknown"]), ["light", "even", "unknown"]),
        (lambda d: d.update(white_balance=5500), ["white_balance", "'5500'", "neutral", "auto"]),
        (lambda d: d.update(tolerance="good"), ["tolerance", "'good'", "position_m", "exact", "unknown"]),
        (lambda d: d["tolerance"].update(angle_deg=-1), ["tolerance.angle_deg", "'-1'"]),
        (lambda d: d["tolerance"].pop("angle_deg"), ["tolerance.angle_deg", "required"]),
        (lambda d: d["tolerance"].update(tilt_deg=1), ["tolerance.tilt_deg", "unknown key", "angle_deg"]),
        (lambda d: d.update(tolerance=0.1), ["tolerance", "'0.1'"]),
    ],
)
def test_a_bad_description_is_named(tmp_path, change, words):
    campaign = write_campaign(tmp_path / "c", describe=change)
    with pytest.raises(InputError) as error:
        load_campaign(campaign)
    for word in ["campaign.yaml", *words]:
        assert word in str(error.value)


@pytest.mark.parametrize("write", [lambda d: d.pop("tolerance"), lambda d: d.update(tolerance=None)])
def test_stations_without_a_tolerance_are_refused(tmp_path, write):
    """Fails if an absent tolerance is taken for unknown or for exact: a mount would never be named, or always."""
    with pytest.raises(InputError) as error:
        load_campaign(write_campaign(tmp_path / "c", describe=write))
    for word in ["campaign.yaml", "tolerance", "left_a", "position_m", "angle_deg", "exact", "unknown"]:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("written", "sigma"),
    [
        ({"position_m": 0.002, "angle_deg": 0.2}, [math.radians(0.2)] * 3 + [0.002] * 3),
        ({"position_m": 0.0, "angle_deg": 0.2}, [math.radians(0.2)] * 3 + [1e-9] * 3),
        ("exact", [1e-9] * 6),
        ("unknown", [math.inf] * 6),
    ],
)
def test_a_tolerance_becomes_the_poses_prior(tmp_path, written, sigma):
    """Fails if `exact` and `unknown` are taken for each other, degrees for radians, or zero for a division by zero."""
    campaign = write_campaign(tmp_path / "c", describe=lambda d: d.update(tolerance=written))
    assert prior_of(facts_of(load_campaign(campaign).file)["tolerance"]).tolist() == sigma


def test_poses_without_a_station_need_no_tolerance(tmp_path):
    """Fails if campaigns of poses in full or of unknown ones must write what they do not know."""
    rows = ["p,left,images/left/a.png,1.5,0,0,0,0.3,0.7", "u,right,images/right/a.png,,,,,,"]
    captures = "\n".join(["capture,camera,image,rx,ry,rz,tx,ty,tz", *rows]) + "\n"
    campaign = write_campaign(tmp_path / "c", describe=lambda d: d.pop("tolerance"), captures=captures)
    assert (prior_of(facts_of(load_campaign(campaign).file)["tolerance"]) == math.inf).all()


OPEN_WORDS = {"light": "unknown", "exposure": "auto", "white_balance": "auto", "reflectance": "unknown"}


def facts(folder, describe):
    """Return what scene.json would hold of the tiny campaign, changed."""
    return facts_of(load_campaign(write_campaign(folder, describe=describe)).file)


@pytest.mark.parametrize("key", OPEN_WORDS)
def test_each_thing_is_left_open_by_itself(tmp_path, key):
    """Fails if one word opens another thing as well, or if a twin is left without a value to render with."""
    found = facts(tmp_path / "c", lambda d: d.update({key: OPEN_WORDS[key]}))
    assert found["left_open"] == [key]
    assert found["exposure"] == 1.0 and found["light"] == "even" and found["white_balance"] == "neutral"
    assert found["reflectance"] == {"white": 0.8, "black": 0.05, "ground": 0.35, "background": 0.3}


def test_what_is_declared_is_not_left_open(tmp_path):
    """Fails if a rig of markers, which says nothing of light, is taken for photographs in any light."""
    found = facts(tmp_path / "c", lambda d: d.update(exposure=2, reflectance={"white": 0.9}))
    assert found["left_open"] == [] and found["exposure"] == 2 and found["reflectance"]["white"] == 0.9


def test_photographs_of_a_board_leave_all_open_but_what_is_declared(tmp_path):
    """Fails if a board photographed at home is taken to be under the nominal light, or if a declaration is lost."""

    def describe(data):
        board(data)
        del data["reflectance"], data["exposure"]

    assert facts(tmp_path / "all", describe)["left_open"] == list(OPEN_WORDS)

    def declared(data):
        describe(data)
        data |= {"light": "even", "exposure": 1.5}

    found = facts(tmp_path / "some", declared)
    assert found["left_open"] == ["white_balance", "reflectance"] and found["exposure"] == 1.5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("!!python/object/apply:os.system ['touch owned']", "line 1"),
        ("name: a\nname: b\n", "line 2: key 'name' stands twice"),
        ("name: {a: 1,\n a: 1}", "line 2: key 'a' stands twice"),
        ("name: a\n? [1, 2]\n: b\n", "line 2: key .* is not a word"),
        ("name: !!timestamp soon", "line 1"),
        ("!!map [1]", "line 1"),
        ("a: &a [x, x]\nb: [*a, *a]\n", "aliases"),
        ("[" * 3000, "campaign.yaml"),
        ("- 1\n", "keys and values"),
        ("name: [1", "line 1"),
        ("", "keys and values"),
        ("\xff", "campaign.yaml"),
        ("schema: 1" + "0" * 5000, "campaign.yaml"),
        ("name: 2024-13-45", "campaign.yaml"),
    ],
)
def test_hostile_yaml_ends_in_one_message(tmp_path, text, words):
    campaign = write_campaign(tmp_path / "c")
    (campaign / "campaign.yaml").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=words):
        load_campaign(campaign)


def test_numbers_with_an_exponent_are_numbers(tmp_path):
    """Fails if YAML is read as its version 1.1, which takes 2e-3 for text (and `no` for a bool)."""
    campaign = write_campaign(tmp_path / "c", describe=lambda d: d.update(name="no"))
    description = campaign / "campaign.yaml"
    description.write_text(description.read_text().replace("0.002", "2e-3").replace("'no'", "no"))
    file = load_campaign(campaign).file
    assert (file.name, file.tolerance.position_m) == ("no", 0.002)


def test_a_board_with_more_markers_than_its_dictionary_is_refused(tmp_path):
    def large(data):
        del data["markers"]
        data["target"] = {
            "type": "aruco_grid",
            "dictionary": "DICT_4X4_50",
            "columns": 8,
            "rows": 8,
            "marker_m": 0.03,
            "gap_m": 0.01,
        }

    with pytest.raises(InputError, match="needs 64 markers; DICT_4X4_50 has 50"):
        load_campaign(write_campaign(tmp_path / "c", describe=large))


def test_every_campaign_at_hand_is_accepted():
    """The reader must not be stricter than the format."""
    shared("campaigns/frame")
    found = [path.parent for path in sorted(SHARED.glob("*/*/campaign.yaml"))]
    assert len(found) >= 7
    for folder in found:
        assert len(load_campaign(folder).captures) > 0
