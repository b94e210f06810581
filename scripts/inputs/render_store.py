"""Renders on disk: one npz a station, trusted only where its key agrees, so that a killed run goes on where it was."""

import hashlib
import io
import zipfile
from pathlib import Path

import numpy as np

from job import write_atomically
from kernels import SCRIPTS, digest_of_imports
from rig.errors import InputError


def code_sha256(module):
    """Return the hash of a module that renders, a path below scripts/, and of all of the project that it imports."""
    file = SCRIPTS / module
    return hashlib.sha256(file.read_bytes() + digest_of_imports(file).encode()).hexdigest()


def station_file(folder, station):
    """Return the file of a station's render."""
    return Path(folder) / f"{station}.npz"


def pixels_sha256(radiance):
    """Return the hash of pixels and shape: files may differ, pixels must not."""
    return hashlib.sha256(str(radiance.shape).encode() + np.ascontiguousarray(radiance).tobytes()).hexdigest()


def write_station(folder, station, radiance, margin, key):
    """Write a station's linear radiance (H + 2m, W + 2m) float32 atomically; fast, deterministic compression."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, value in (("radiance", radiance), ("margin", np.int64(margin)), ("key", np.str_(key))):
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asanyarray(value), allow_pickle=False)
            archive.writestr(
                zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0)), member.getvalue(), zipfile.ZIP_DEFLATED, 1
            )
    with write_atomically(station_file(folder, station), "wb") as file:
        file.write(buffer.getvalue())


def stored_key(folder, station):
    """Return the key of a station's render, or None where there is none that can be read."""
    try:
        with np.load(station_file(folder, station)) as stored:
            return str(stored["key"])
    except Exception:  # of numpy's, zipfile's and zlib's many, on bytes that can be anything
        return None


def read_station(folder, entry):
    """Return (radiance, margin) of a station's entry in the manifest; raises InputError where its file is gone or other."""
    path = Path(folder) / entry["file"]
    try:
        with np.load(path) as stored:
            if str(stored["key"]) == entry["key"]:
                return stored["radiance"], int(stored["margin"])
    except Exception:  # of numpy's, zipfile's and zlib's many, on bytes that can be anything
        pass
    raise InputError(
        f"{path}: the render is gone or not the one in the manifest; run `snakemake --forcerun render_stations`"
    )
