"""Captures: the campaign's files as inputs of rules, and what tells that they have changed.

Needs: the names of rules/common.smk. Makes: nothing. Here are a camera's images, all or those of a batch, the tables that
describe them, and the hashes by which a changed capture reruns its own camera.
"""

import hashlib
import json

from expand_tables import facts_of
from run_guard import stamp
from verify_data import tracked_listing, tracked_md5

DVC_STORES = [".dvc/cache", "data/dvc-remote"]


def campaign_folder(wildcards):
    """Return the campaign's folder, None for a designed experiment."""
    return CAMPAIGN


def campaign_files():
    """Return the campaign's description and tables, or the experiment's files."""
    if CAMPAIGN is None:
        return [
            config["experiment"],
            *(
                str(path)
                for kind in ("cameras", "experiments", "rigs")
                for path in sorted(Path(f"config/{kind}").glob("*.yaml"))
            ),
        ]
    names = ["campaign.yaml", SOURCE.file.captures]
    if SOURCE.file.markers:
        names.append(SOURCE.file.markers)
    given = [camera.intrinsics for camera in SOURCE.file.cameras.values()]
    names += [file.partition("#")[0] for file in given if file]
    return [f"{CAMPAIGN}/{name}" for name in names]


def images(*cameras):
    """Return the images of some cameras, of all where none is named."""
    if CAMPAIGN is None:
        return []
    rows = SOURCE.captures
    wanted = rows[rows.camera.isin(cameras or CAMERAS)]
    return [f"{CAMPAIGN}/{image}" for image in wanted.image]


def earlier_images(wildcards):
    """Return the baseline's images of wildcards.camera."""
    rows = EARLIER.captures[EARLIER.captures.camera == wildcards.camera]
    return ancient([f"{BASELINE}/{image}" for image in rows.image])


def captures_of(wildcards):
    """Return the images of wildcards.camera.

    Where DVC tracks the campaign, its hashes tell what changed (see camera_facts) and times do not count: DVC
    does not keep them. Elsewhere nothing but the files themselves can tell.
    """
    paths = images(wildcards.camera)
    return ancient(paths) if dvc_files() else paths


def part_of_batch(wildcards):
    """Return [first, after the last] of a batch's captures, counted in the order of their names."""
    first = int(wildcards.batch) * config["batch"]
    return [first, first + config["batch"]]


def captures_of_batch(wildcards):
    """Return the images of a batch of wildcards.camera; see captures_of for what counts as a change."""
    rows = SOURCE.captures[SOURCE.captures.camera == wildcards.camera]
    rows = rows.sort_values("capture").iloc[slice(*part_of_batch(wildcards))]
    paths = [f"{CAMPAIGN}/{image}" for image in rows.image]
    return ancient(paths) if dvc_files() else paths


def batches_of(name):
    """Return a function of wildcards: the files of a name, with wildcards, of all batches of wildcards.camera."""

    def files(wildcards):
        count = -(-CAPTURE_COUNTS[wildcards.camera] // config["batch"])
        folder = f"{RESULTS}/batches/{wildcards.camera}"
        return [f"{folder}/{k}/{name.format(**wildcards)}" for k in range(count)]

    return files


def wildcard_camera(wildcards):
    """Return the camera of a job."""
    return wildcards.camera


def camera_facts(wildcards):
    """Return a hash of all that the tables say of wildcards.camera: scene, markers, captures, their DVC hashes.

    Where nothing tracks them, sizes and times tell what changed, also while the camera's job ran.
    As a parameter it reruns one camera where the tables of all cameras, as inputs, would rerun every camera.
    """
    rows = SOURCE.captures[SOURCE.captures.camera == wildcards.camera]
    parts = [
        json.dumps(facts_of(SOURCE.file), sort_keys=True),
        repr(SOURCE.file.cameras[wildcards.camera]),
        SOURCE.markers.to_csv(index=False),
        rows.to_csv(index=False),
    ]
    if not dvc_files():
        parts += [str(stamp(f"{CAMPAIGN}/{image}")) for image in rows.image]
    for dvc_file in dvc_files():
        tracked = tracked_md5(dvc_file)
        listing = tracked_listing(tracked, DVC_STORES) or {}
        parts += [listing.get(image, tracked) for image in rows.image]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def dvc_files():
    """Return the campaign's .dvc file, where it is tracked."""
    path = Path(f"{CAMPAIGN}.dvc")
    return [str(path)] if CAMPAIGN and path.is_file() else []


def verified_data():
    """Return what says that the captures are those that DVC tracks: a target of its own, as it changes no number."""
    return [f"{RESULTS}/verified.json"] if CAMPAIGN else []


def files_seen(wildcards):
    """Return a hash of names, sizes, times, first and last bytes of the campaign's files: what changed is verified anew."""
    digest = hashlib.sha256()
    for path in sorted(p for p in Path(CAMPAIGN).rglob("*") if p.is_file()):
        digest.update(f"{path} {stamp(path)} ".encode())
        with open(path, "rb") as file:
            digest.update(file.read(4096))
            file.seek(max(path.stat().st_size - 4096, 0))
            digest.update(file.read(4096))
    return digest.hexdigest()
