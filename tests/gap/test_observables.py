"""The table of observables, what is derived of it, and that the rooms of the diagnosis build upon each other one way."""

import numpy as np
import pytest

from gap import observables
from gap.observables import CORNERS, EDGES, FEATURE_GROUPS, FEATURES, GAP_GROUPS, LEVELS, OBSERVABLES, SIGNS
from job_inputs import names_imported
from workflow_runs import PROJECT

SCRIPTS = PROJECT / "scripts"


def test_the_table_is_in_the_order_of_stored_observations():
    """Fails if a row is moved, renamed or dropped: what was measured and kept would be read as something else."""
    assert [*FEATURES] == [
        *(f"corner_{axis}{k}" for k in range(4) for axis in "xy"),
        *("white", "black", "ground", "white_slope_u", "white_slope_v"),
        *("spread_x", "spread_y", "spread_xy", "overshoot", "ink", "rim"),
    ]
    of_colour = ["white", "black", "ground", "dx", "dy"]
    assert [*observables.COLOUR_FEATURES] == [f"{channel}_{name}" for channel in ("red", "blue") for name in of_colour]
    assert [*observables.NOISE_FEATURES] == [
        *(f"noise_{surface}" for surface in ("ground", "white", "black", "sky")),
        *("noise_y_over_x", "noise_lag2_x", "noise_lag2_y", "noise_tails", "blocks_x", "blocks_y"),
        *("stripes_row", "stripes_column", "noise_colour"),
    ]
    assert SIGNS[:5] == FEATURES[EDGES][:5] and len(set(SIGNS)) == len(SIGNS) == 23


def test_groups_partition_the_columns():
    """Fails if a slice misses a feature of its group, takes one of another's, or a group has no least floor."""
    assert GAP_GROUPS == ("corners", "levels", "edges", "colour", "field", "noise")
    assert set(observables.MIN_FLOOR) == set(GAP_GROUPS)
    group_of = {o.name: o.group for o in OBSERVABLES}
    assert len(group_of) == len(OBSERVABLES) == 43
    taken = [(k, group) for group, part in FEATURE_GROUPS.items() for k in range(len(FEATURES))[part]]
    assert taken == [(k, group_of[name]) for k, name in enumerate(FEATURES)]
    assert (CORNERS, LEVELS, EDGES) == (slice(0, 8), slice(8, 13), slice(13, 19))
    assert FEATURES[observables.SURFACES] == ("white", "black", "ground")


def test_floors_and_ridges_lie_beside_their_features():
    """Fails if a floor or a ridge slips to a neighbour's column, or one of another group is taken."""
    for name, floor, ridge in (("corner_y3", 0.006, 1e-4), ("overshoot", 0.004, 1e-2), ("rim", 0.006, 1e-4)):
        k = FEATURES.index(name)
        assert (observables.FEATURE_FLOOR[k], observables.FEATURE_RIDGE[k]) == (floor, ridge)
    assert observables.FLOORS["colour"].tolist() == 2 * [0.15, 0.15, 0.15, 0.006, 0.006]
    assert observables.MIN_SIGN_FLOOR[SIGNS.index("ink")] == 0.015


def test_a_state_is_the_features_that_iterations_move():
    """Fails if what a fit moves is not held where it starts, or if what is held to sense moves: columns would be confused."""
    state = [FEATURES[k] for k in observables.STATE_FEATURES]
    assert state == [*FEATURES[CORNERS], *FEATURES[LEVELS], "rim"] and state[observables.STATE_RIM] == "rim"
    assert [FEATURES[k] for k in observables.HELD_FEATURES] == [*FEATURES[EDGES][:-1]]


@pytest.mark.parametrize("shape", [(3, 19), (0, 19), (2, 2), (19,)])
def test_corners_are_the_first_features_and_move_alone(shape):
    """Fails if x and y are exchanged, a board's points or an image without plates raise, or a shift reaches a level."""
    features = np.arange(float(np.prod(shape))).reshape(shape)
    corners = observables.corners_in(features)
    assert corners.shape == (*shape[:-1], min(shape[-1], 8) // 2, 2)
    np.testing.assert_array_equal(corners.reshape(features[..., :8].shape), features[..., :8])
    if len(shape) == 1:
        change = observables.shifted(features, [5.0, -3.0]) - features
        assert change.tolist() == [5.0, -3.0] * 4 + [0.0] * 11


def modules_of(scripts):
    """Return {module: the modules that it imports} of scripts/gap."""
    modules = {".".join(p.relative_to(scripts).with_suffix("").parts): p for p in (scripts / "gap").rglob("*.py")}
    return {module: names_imported(path) & set(modules) for module, path in modules.items()}


def rooms_of(scripts):
    """Return {room: the rooms whose modules its own import} of scripts/gap: its folders, and its files beside them."""
    rooms = {}
    for module, imported in modules_of(scripts).items():
        room = ".".join(module.split(".")[:2])
        others = {".".join(name.split(".")[:2]) for name in imported}
        rooms[room] = rooms.get(room, set()) | others - {room}
    return rooms


def in_cycles(rooms):
    """Return the rooms of cycles and those upon them: left when what imports nothing that is left is taken away in turn."""
    left = dict(rooms)
    while free := [room for room, needs in left.items() if not needs & set(left)]:
        left = {room: needs for room, needs in left.items() if room not in free}
    return set(left)


def test_rooms_build_upon_each_other_one_way():
    """Fails if a room imports one that stands upon it, as measure and predict did, or a module in it one that imports it in
    turn, and if the table stands upon anything."""
    rooms, modules = rooms_of(SCRIPTS), modules_of(SCRIPTS)
    assert len(modules) > 50 and "gap.pixels" in rooms["gap.measure"] and "gap.measure" in rooms["gap.predict"]
    assert "gap.fit.residuals" in modules["gap.fit.solver"]
    assert in_cycles(rooms) == in_cycles(modules) == set() and rooms["gap.observables"] == set()


def test_a_cycle_of_rooms_is_seen_where_no_module_is_in_one(tmp_path):
    """Fails if modules alone are looked at, or an import within a function is overlooked."""
    for name, text in {
        "a/low": "import numpy",
        "a/high": "def f():\n    from gap.b.only import x",
        "b/only": "from gap.a import low",
        "top": "from gap.a.high import f",
    }.items():
        path = tmp_path / f"gap/{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    assert in_cycles(rooms_of(tmp_path)) == {"gap.a", "gap.b", "gap.top"}


def test_nothing_below_imports_the_diagnosis():
    """Fails if effects, geometry, readers of files, detectors or registration lean on what stands upon them."""
    below = ("effects", "rig", "inputs", "detectors", "markers", "register", "blender", "calibrations")
    files = [path for room in below for path in (SCRIPTS / room).rglob("*.py")]
    assert len(files) > 60 and [f for f in files if any(n.split(".")[0] == "gap" for n in names_imported(f))] == []
