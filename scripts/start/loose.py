"""Markers that lie loose on a table: where, by the photographs that show several of them, and how surely.

What moved between photographs, lies twice or was seen once is left out and named.
"""

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from rig.board_markers import COLUMNS
from rig.errors import InputError
from rig.geometry import camera_matrix
from start.bundle import PRIOR, Scene, Sightings, adjust
from start.first_guess import first_poses
from start.markers import smallest_dictionary

FOCAL_STARTS = (0.6, 0.9, 1.4)  # focal lengths to start from, in longer sides, where EXIF says nothing
MIN_VIEWS, MIN_MARKERS = 3, 3
MAX_VIEWS = 60  # with the most markers: more tell hardly more
FAR_SIGMA, FAR_PX = 6.0, 1.0  # a marker that is further off than both lies elsewhere
MOVED_SHARE = 0.25  # of its photographs, in which a marker lies elsewhere
OFF_SHARE = 0.5  # of a photograph's markers
FLAT_RATIO = 1.5  # of the RMS errors: markers lie in one plane, bent as paper is, if a plane fits not worse than that
SAME_SIDE = 0.3  # of a marker: two codes so near are one print
SE = ["se_x", "se_y", "se_z", "se_rx", "se_ry", "se_rz"]


@dataclass(frozen=True)
class Loose:
    """Where loose markers lie.

    markers    the markers' table with standard errors, its world the frame of the first row's marker
    left_out   [(marker, why)]
    seen       one bool a photograph: whether it was of use
    flat       whether all lie in one plane
    sigma_px   scatter of the corners
    focal_px   {camera number: (focal length, standard error)}, in the pixels that were looked at
    """

    markers: pd.DataFrame
    left_out: list
    seen: tuple
    flat: bool
    sigma_px: float
    focal_px: dict = field(default_factory=dict)


def place_loose_markers(found, sizes, camera, side_m, focals):
    """Return the Loose of markers that photographs show.

    found   {dictionary: [start.markers.Seen of each photograph]}
    sizes   (width, height) of each camera's images; camera the number of each photograph's camera
    focals  {camera number: focal length in longer sides of the image}, where EXIF has it
    Raises InputError where too few markers are seen together.
    """
    table, keys, left_out = _sightings(found, sizes, camera)
    table, out = _seen_often(table)
    left_out += [(keys[m], "seen in one photograph only: nothing tells how surely it lies there") for m in out]
    if len(np.unique(table.marker)) < MIN_MARKERS or len(np.unique(table.view)) < MIN_VIEWS:
        raise InputError(
            f"at least {MIN_MARKERS} markers, each in two photographs or more with others, and {MIN_VIEWS} photographs are "
            "needed to tell where they lie"
        )
    table = _richest(table)
    table, scene, numbers, views = _first_scene(table, side_m, focals)
    left_out += [(keys[m], "not seen together with the others") for m in np.setdiff1d(np.unique(table.marker), numbers)]
    table = _renumbered(table, numbers, views)
    keys_now, out, fit, table = _settled(table, side_m, scene, [keys[m] for m in numbers], flat=False)
    left_out += out
    fixed = _reference(table)
    plane = adjust(table, side_m, flattened(fit.scene, fixed), fixed, True)
    flat = np.square(plane.errors_px).mean() <= FLAT_RATIO**2 * np.square(fit.errors_px).mean()
    if flat:
        keys_now, out, fit, table = _settled(table, side_m, plane.scene, keys_now, flat=True)
        left_out += out
    seen = np.zeros(len(camera), bool)
    seen[np.array(views)[np.unique(table.view)]] = True
    longer = np.array(sizes).max(axis=1)
    focal = {
        c: (float(np.exp(p[0]) * longer[c]), float(np.exp(p[0]) * longer[c] * se[0]))
        for c, (p, se) in enumerate(zip(fit.scene.cameras, fit.se_cameras, strict=True))
    }
    return Loose(_table(table, fit, keys_now, side_m), left_out, tuple(seen), bool(flat), fit.sigma_px, focal)


def _sightings(found, sizes, camera):
    """Return (Sightings, [(dictionary, id)] of its markers, [(marker, why it is left out)])."""
    twice = {(name, int(k)) for name, seen in found.items() for s in seen for k in s.doubled}
    keys, rows = {}, []
    for view in range(len(camera)):
        taken = []
        for name, seen in found.items():  # the most frequent dictionary first
            s = seen[view]
            for k, quad, centre in zip(s.ids, s.quads, s.centres(), strict=True):
                side = np.linalg.norm(quad[1] - quad[0])
                if any(np.linalg.norm(centre - other) < SAME_SIDE * side for other in taken):
                    continue
                taken.append(centre)
                if (name, int(k)) not in twice:
                    rows.append((view, keys.setdefault((name, int(k)), len(keys)), quad))
    view, marker = (np.array([r[k] for r in rows], int) for k in (0, 1))
    quads = np.array([r[2] for r in rows], float).reshape(-1, 4, 2)
    out = [(key, "lies twice in one photograph: which is which can't be told") for key in sorted(twice)]
    return Sightings(tuple(sizes), np.asarray(camera), view, marker, quads), list(keys), out


def _seen_often(table):
    """Return (the Sightings of markers seen in two photographs or more, the other markers)."""
    counts = np.bincount(table.marker, minlength=1)
    return table.select(counts[table.marker] > 1), [m for m in range(len(counts)) if counts[m] == 1]


def _richest(table):
    """Return the Sightings of the photographs with the most markers: MAX_VIEWS of them, with two markers at least."""
    counts = np.bincount(table.view)
    best = [v for v in np.argsort(-counts, kind="stable")[:MAX_VIEWS] if counts[v] > 1]
    return table.select(np.isin(table.view, best))


def _first_scene(table, side_m, focals):
    """Return (its Sightings, Scene, numbers of its markers, numbers of its photographs) from the focal length that fits best."""
    best = None
    for start in FOCAL_STARTS if len(focals) < len(table.sizes) else (None,):
        share = [focals.get(c, start) for c in range(len(table.sizes))]
        Ks = [
            camera_matrix(f * max(w, h), f * max(w, h), (w - 1) / 2, (h - 1) / 2)
            for f, (w, h) in zip(share, table.sizes, strict=True)
        ]
        views, markers = first_poses(table, side_m, Ks)
        if len(markers) < MIN_MARKERS or len(views) < MIN_VIEWS:
            continue
        cameras = np.tile(PRIOR[0], (len(share), 1))
        cameras[:, 0] = np.log(share)
        v, m = sorted(views), sorted(markers)
        scene = Scene(cameras, np.array([views[k] for k in v]), np.array([markers[k] for k in m]))
        mine = _renumbered(table, m, v)
        fit = adjust(mine, side_m, scene, _reference(mine), False, rounds=1, most_steps=25)
        score = (-len(mine.view), fit.cost)
        if best is None or score < best[0]:
            best = score, fit.scene, m, v
    if best is None:
        raise InputError(f"fewer than {MIN_MARKERS} markers are seen together: nothing tells where they lie")
    return table, best[1], best[2], best[3]


def _renumbered(table, markers, views):
    """Return the Sightings of some markers and photographs, numbered by their place in these lists."""
    mine = table.select(np.isin(table.marker, markers) & np.isin(table.view, views))
    place = {k: i for i, k in enumerate(markers)}
    shown = {k: i for i, k in enumerate(views)}
    return Sightings(
        table.sizes, table.camera[list(views)], np.array([shown[v] for v in mine.view], int),
        np.array([place[m] for m in mine.marker], int), mine.quads,
    )  # fmt: skip


def _reference(table):
    """Return the marker that is seen most, the first of several."""
    return int(np.argmax(np.bincount(table.marker)))


def _settled(table, side_m, scene, keys, flat):
    """Return (keys, [(marker, why it is left out)], Adjusted, Sightings) once all that is left fits.

    The marker that lies elsewhere in the most of its photographs goes first: it may have pulled others off.
    """
    out = []
    while True:
        fixed = _reference(table)
        fit = adjust(table, side_m, scene, fixed, flat)
        scene = fit.scene
        off_px = np.sqrt((fit.errors_px**2).sum(axis=-1).mean(axis=-1))
        far = off_px > max(FAR_SIGMA * fit.sigma_px, FAR_PX)
        if not far.any():
            return keys, out, fit, table
        by_marker, by_view = (_shares(far, of) for of in (table.marker, table.view))
        total = np.bincount(table.marker, weights=np.where(far, off_px, 0))
        marker = int(np.lexsort((total, by_marker))[-1])
        times = int(far[table.marker == marker].sum())
        if by_view.max() > max(OFF_SHARE, by_marker.max()):
            keep = table.view != int(np.argmax(by_view))
        elif by_marker[marker] >= MOVED_SHARE and times > 1:
            keep = table.marker != marker
            off_mm = 1000 * side_m * np.median((off_px / _sides_px(table))[(table.marker == marker) & far])
            out.append((
                keys[marker],
                f"lies some {off_mm:.1f} mm from where the others have it in {times} of {int((~keep).sum())} photographs: "
                "moved between them, bent, or printed at another size",
            ))  # fmt: skip
        else:
            keep = ~far
        table, scene, keys, more = _without(table.select(keep), scene, keys)
        out += more
        if len(keys) < MIN_MARKERS or len(np.unique(table.view)) < MIN_VIEWS:
            raise InputError(
                "markers do not stay where they are from one photograph to the next: "
                + "; ".join(f"{named(key)} {why}" for key, why in out[:3])
            )


def _sides_px(table):
    return np.linalg.norm(np.roll(table.quads, -1, axis=1) - table.quads, axis=-1).mean(axis=1)


def _shares(far, of):
    return np.bincount(of, weights=far) / np.maximum(np.bincount(of), 1)


def _without(table, scene, keys):
    """Return (Sightings, Scene, keys, [(marker, why)]) without markers that are left in fewer than two photographs."""
    counts = np.bincount(table.marker, minlength=len(keys))
    good = [m for m in range(len(keys)) if counts[m] > 1]
    views = list(range(len(scene.T_cam_world)))
    table = _renumbered(table, good, views)
    scene = Scene(scene.cameras, scene.T_cam_world, scene.T_world_marker[good])
    more = [(keys[m], "fits in one photograph only") for m in range(len(keys)) if counts[m] == 1]
    return table, scene, [keys[m] for m in good], more


def flattened(scene, fixed):
    """Return the scene with its markers in the plane z = 0, the fixed one's centre at the origin, unturned."""
    T = scene.T_world_marker
    centres, up = T[:, :3, 3], T[:, :3, 2].mean(axis=0)
    normal = np.linalg.svd(centres - centres.mean(axis=0))[2][2]
    spread = np.linalg.svd(centres - centres.mean(axis=0), compute_uv=False)
    if spread[1] < 0.05 * spread[0]:  # a row of markers tells no plane
        normal = up / np.linalg.norm(up)
    normal = normal * np.sign(normal @ up)
    x = T[fixed, :3, 0] - normal * (T[fixed, :3, 0] @ normal)
    x /= np.linalg.norm(x)
    world = np.eye(4)  # T_old_new
    world[:3, :3] = np.stack([x, np.cross(normal, x), normal], axis=1)
    world[:3, 3] = T[fixed, :3, 3]
    moved = np.linalg.inv(world) @ T
    angle = np.arctan2(moved[:, 1, 0], moved[:, 0, 0])
    flat = np.tile(np.eye(4), (len(T), 1, 1))
    flat[:, :3, :3] = Rotation.from_rotvec(np.outer(angle, [0, 0, 1])).as_matrix()
    flat[:, :2, 3] = moved[:, :2, 3]
    return Scene(scene.cameras, scene.T_cam_world @ world, flat)


def _table(table, fit, keys, side_m):
    """Return the markers' table with standard errors, in the frame of the reference, the others by dictionary and id."""
    fixed = _reference(table)
    T = np.linalg.inv(fit.scene.T_world_marker[fixed]) @ fit.scene.T_world_marker
    R = fit.scene.T_world_marker[fixed, :3, :3].T
    largest = {name: max(k for n, k in keys if n == name) for name, _ in keys}
    rows = []
    for m, (name, number) in enumerate(keys):
        # errors belong to the axes of the scene's world; on the way to the reference's they turn along
        se = [np.sqrt((R**2) @ (part**2)) for part in (fit.se[m, 3:], fit.se[m, :3])]
        pose = [*T[m, :3, 3], *Rotation.from_matrix(T[m, :3, :3]).as_rotvec()]
        rows.append([smallest_dictionary(name, largest[name] + 1), number, side_m, np.nan, *pose, *np.concatenate(se)])
    made = pd.DataFrame(rows, columns=[*COLUMNS, *SE])
    made[[*COLUMNS[4:], *SE]] = made[[*COLUMNS[4:], *SE]].round(7) + 0.0
    order = sorted(range(len(made)), key=lambda m: (m != fixed, keys[m]))
    return made.iloc[order].reset_index(drop=True)


def named(key):
    """Return a marker's name, such as DICT_4X4_50/7."""
    return f"{key[0]}/{key[1]}"
