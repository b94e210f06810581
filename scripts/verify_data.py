"""Verify: a campaign's files against the hashes in its .dvc file; changed, missing and extra files are named."""

import contextlib
import hashlib
import json
import logging
import re
from pathlib import Path

from tqdm import tqdm

import job
from inputs.safe_yaml import load_yaml
from rig.errors import InputError

log = logging.getLogger("twingap")
MAX_NAMES = 10


def md5_of(path):
    """Return a file's MD5, as DVC names content."""
    digest = hashlib.md5(usedforsecurity=False)
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


def files_of(folder):
    """Return {path relative to the folder: MD5} of all its files."""
    paths = sorted(p for p in Path(folder).rglob("*") if p.is_file())
    return {
        p.relative_to(folder).as_posix(): md5_of(p)
        for p in tqdm(paths, desc="verifying data", unit="file", mininterval=5)
    }


def directory_hash(files):
    """Return DVC's hash of a folder of {relative path: MD5}."""
    listing = [
        {"md5": md5, "relpath": path} for path, md5 in sorted(files.items(), key=lambda f: tuple(f[0].split("/")))
    ]
    return hashlib.md5(json.dumps(listing, sort_keys=True).encode(), usedforsecurity=False).hexdigest() + ".dir"


def tracked_md5(dvc_file):
    """Return the hash of the folder that a .dvc file tracks, such as ``75bd2ff4....dir``."""
    outputs = load_yaml(dvc_file).get("outs")
    one = outputs[0] if isinstance(outputs, list) and len(outputs) == 1 and isinstance(outputs[0], dict) else {}
    md5 = one.get("md5")
    if not re.fullmatch(r"[0-9a-f]{32}\.dir", str(md5)) or one.get("hash") != "md5":
        raise InputError(f"{dvc_file}: outs: expected the md5 of one folder, as `dvc add FOLDER` of DVC 3 writes it")
    return md5


def tracked_listing(hash_, stores):
    """Return {relative path: MD5} of a tracked folder; None where neither DVC's cache nor a local remote has it whole."""
    for store in stores:
        path = Path(store) / "files/md5" / hash_[:2] / hash_[2:]
        with contextlib.suppress(OSError, ValueError, TypeError, KeyError, RecursionError):
            return {str(entry["relpath"]): str(entry["md5"]) for entry in json.loads(path.read_bytes())}
    return None


def differences(tracked, found):
    """Return a sentence that names what is changed, missing and extra."""
    parts = []
    for word, names in (
        ("changed", [n for n in found if n in tracked and found[n] != tracked[n]]),
        ("missing", [n for n in tracked if n not in found]),
        ("extra", [n for n in found if n not in tracked]),
    ):
        if names:
            more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
            parts.append(f"{word}: {', '.join(sorted(names)[:MAX_NAMES])}{more}")
    return "; ".join(parts)


def verify_data(campaign, dvc_file, stores, out):
    """Check a campaign's folder against its .dvc file and note it in ``out``; untracked folders are accepted."""
    found = files_of(campaign)
    if dvc_file is None:
        log.info("%s is not tracked by DVC: taken as it is (%d files)", campaign, len(found))
        wanted = None
    else:
        wanted = tracked_md5(dvc_file)
        if directory_hash(found) != wanted:
            tracked = tracked_listing(wanted, stores)
            what = differences(tracked, found) if tracked else "which files, the cache can't tell (run `dvc pull`)"
            raise InputError(
                f"{campaign} differs from {dvc_file}: {what}. "
                f"`dvc checkout {dvc_file}` brings the tracked files back, `dvc add {campaign}` accepts yours"
            )
    with job.write_atomically(out) as file:
        json.dump({"campaign": str(campaign), "tracked": wanted, "files": len(found)}, file, indent=1)


if __name__ == "__main__":
    job.run(
        verify_data,
        snakemake,
        campaign=snakemake.params.campaign,
        dvc_file=snakemake.input.dvc[0] if snakemake.input.get("dvc") else None,
        stores=snakemake.params.stores,
        out=snakemake.output[0],
    )
