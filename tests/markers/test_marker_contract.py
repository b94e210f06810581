"""Marker types are found by being there, know their ids, and say which squares their corners are of."""

import ctypes
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import markers
from imports import imports_of
from inputs.campaign import read_markers
from inputs.experiment import rig_markers
from markers import contract
from rig.errors import InputError
from workflow_runs import PROJECT

PAGE = PROJECT / "docs" / "markers.md"
COLUMNS = "dictionary,id,code_m,plate_m,x,y,z,rx,ry,rz\n"


@pytest.fixture(autouse=True)
def forget():
    """Have every test look for types anew."""
    yield
    contract.type_of.cache_clear()
    contract.drawing_of.cache_clear()


def test_types_are_found_by_being_there_and_share_no_family():
    """Fails if a file is no type, lacks a part of the contract, or takes another's family for its own."""
    families = ("DICT_4X4_50", "DICT_APRILTAG_36h11", "tagStandard41h12", "STAG_HD21", "DICT_9X9", "")
    types = {name: contract.importlib.import_module(f"markers.{name}") for name in contract.available()}
    assert {"opencv_dictionary", "apriltag_standard", "stag"} <= set(types)
    for module in types.values():
        assert module.__doc__ and module.FAMILIES and module.CORNERS
    assert [sum(m.ids(f) is not None for m in types.values()) for f in families] == [1, 1, 1, 1, 0, 0]


@pytest.mark.parametrize(
    ("family", "count"),
    [("DICT_ARUCO_ORIGINAL", 1024), ("DICT_APRILTAG_36h11", 587), ("DICT_APRILTAG_25h9", 35), ("DICT_APRILTAG_16h5", 30),
     ("tagStandard41h12", 2115), ("STAG_HD13", 2884), ("STAG_HD23", 6)],
)  # fmt: skip
def test_a_family_has_the_ids_that_its_makers_gave_it(family, count):
    """Fails if an id is lost, if one beyond the last is drawn, or if two ids look alike."""
    assert contract.count_of(family) == count
    with pytest.raises(InputError, match=f"{family} has the ids 0 to {count - 1}, not {count}"):
        contract.drawing_of(family, count)
    drawings = [contract.drawing_of(family, k) for k in range(min(count, 200))]
    assert len({(d.white.tobytes(), d.discs.tobytes()) for d in drawings}) == len(drawings)


def test_standard_tags_are_those_of_the_library():
    """Fails if a code or the place of a bit differs from what AprilTag's own library draws."""
    bindings = pytest.importorskip("pupil_apriltags.bindings", reason="optional extra 'trackers' is not installed")
    (path,) = list(Path(bindings.__file__).parent.glob("lib*/libapriltag*.so"))[:1]
    create = ctypes.CDLL(str(path)).tagStandard41h12_create
    create.restype = ctypes.POINTER(bindings._ApriltagFamily)
    family = create().contents
    assert family.ncodes == contract.count_of("tagStandard41h12")
    for number in (0, 1, 777, 2114):
        white = contract.drawing_of("tagStandard41h12", number).white
        bits = [
            white[ctypes.c_int32(family.bit_y[k]).value + 2, ctypes.c_int32(family.bit_x[k]).value + 2]
            for k in range(family.nbits)
        ]
        assert int("".join(str(int(b)) for b in bits), 2) == family.codes[number]


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("DICT_9X9,3,0.07,0.1", "row 2, column dictionary: 'DICT_9X9' is no family of markers; known are .*STAG_HD"),
        ("STAG_HD21,12,0.07,0.1", "row 2, column id.*12"),
        ("tagStandard41h12,3,0.07,0.1", "row 2, column plate_m: 0.1 is less than 1.8 times code_m 0.07"),
        ("DICT_4X4_50,50,0.07,0.1", "row 2, column id.*50"),
    ],
)
def test_a_marker_that_does_not_exist_or_does_not_fit_is_named(tmp_path, row, words):
    """Fails if a family, an id outside it or a plate that is too small comes to a job, or without file, row and value."""
    (tmp_path / "markers.csv").write_text(f"{COLUMNS}{row},0,0.5,0,0,0,0\n")
    with pytest.raises(InputError, match=f"markers.csv, {words}"):
        read_markers(tmp_path / "markers.csv")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ("dictionary: STAG_HD21, plates: 13", "STAG_HD21 has 12"),
        ("dictionary: tagStandard41h12, plates: 3", "1.8 times code_m"),
        ("dictionary: NOBODYS, plates: 3", "no family of markers"),
    ],
)
def test_a_designed_rigs_markers_are_looked_at_too(tmp_path, changes, words):
    """Fails if a ladder is laid out of markers that its family has not."""
    rig = tmp_path / "rig.yaml"
    rig.write_text(f"ladders: [{{{changes}, columns_x_m: [0.0], first_y_m: 0.3, step_y_m: 0.2}}]\n")
    with pytest.raises(InputError, match=words) as refusal:
        rig_markers(rig)
    assert "rig.yaml" in str(refusal.value)


def test_whoever_draws_markers_depends_on_all_types(monkeypatch):
    """Fails if a type's edit leaves the tables, renders or detections that were made of it standing."""
    monkeypatch.chdir(PROJECT)
    types = {f"scripts/markers/{name}.py" for name in contract.available()}
    for script in ("expand_tables.py", "render_stations.py", "detect_captures.py", "aggregate_detections.py"):
        assert types | {"scripts/markers/_stag_codes.py"} <= set(imports_of(script))


def test_the_page_tells_of_every_type():
    """Fails if a type is added and the page of markers does not say what lies at its corners."""
    text = PAGE.read_text()
    for name in contract.available():
        module = contract.importlib.import_module(f"markers.{name}")
        assert f"`{name}`" in text and module.CORNERS in text.replace("\n", " "), name


def test_the_pages_example_is_a_type_in_one_file(tmp_path, monkeypatch):
    """Fails if what users copied from the page is no longer found, drawn and read."""
    from detectors import contract as detectors

    (example,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "house_marks.py").write_text(example)
    monkeypatch.setattr(contract, "__file__", str(tmp_path / "contract.py"))
    monkeypatch.setattr(markers, "__path__", [*markers.__path__, str(tmp_path)])
    contract.type_of.cache_clear()
    try:
        assert contract.available() == ["house_marks"]
        assert contract.count_of("HOUSE_3X3") == 40
        place = dict.fromkeys(("x", "y", "z", "rx", "ry", "rz"), 0.0)
        plate = contract.marker_plate(SimpleNamespace(dictionary="HOUSE_3X3", id=7, code_m=0.05, plate_m=0.08, **place))
        cells = np.kron(plate.white[::-1], np.ones((16, 16)))
        image = np.where(cells > 0, 220, 30).astype(np.uint8)
        able = [n for n in ("aruco", "aruco_subpix", "stag") if detectors.reads(n, "HOUSE_3X3")]
        assert able == ["aruco", "aruco_subpix"]
        (found,) = detectors.make("aruco", ["HOUSE_3X3"]).detect(image)
        assert (found.dictionary, found.id) == ("HOUSE_3X3", 7)
        with pytest.raises(InputError, match="none of stag reads markers of HOUSE_3X3; aruco"):
            detectors.readers(["stag"], ["HOUSE_3X3"], "configuration: detectors")
    finally:
        sys.modules.pop("markers.house_marks", None)
