"""Where results come from: code, versions, data hashes, configuration, seed. No clocks: reruns compare."""

import hashlib
import json
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ruamel.yaml import YAML, YAMLError

import job
from rig.errors import InputError

PACKAGES = [
    "opencv-contrib-python-headless",
    "numpy",
    "scipy",
    "pandas",
    "numba",
    "snakemake",
    "dvc",
    "papermill",
]
SEED = "every random number is seeded by the names of what it is for (job.seed_of), never by order or time"


def git_state(root):
    """Return ``{"commit", "changed_files"}`` of the repository at ``root``; both None where there is none."""

    def git(*arguments):
        return subprocess.run(["git", "-C", root, *arguments], capture_output=True, text=True, check=True).stdout

    try:
        commit = git("rev-parse", "HEAD").strip()
        changed = git("status", "--porcelain", "--untracked-files=no").splitlines()
    except (OSError, subprocess.CalledProcessError):
        return {"commit": None, "changed_files": None}
    return {"commit": commit, "changed_files": sorted(line[3:] for line in changed)}


def installed_versions(packages):
    """Return ``{package: version or None}`` of the running environment."""
    found = {}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found


def dvc_hashes(dvc_files):
    """Return ``{path: md5}`` of the data that ``.dvc`` files track; InputError for a file that is not one."""
    hashes = {}
    for path in dvc_files:
        try:
            content = YAML(typ="safe").load(Path(path).read_text())
            hashes |= {f"{Path(path).parent.name}/{out['path']}": out["md5"] for out in content["outs"]}
        except (YAMLError, KeyError, TypeError) as error:
            raise InputError(f"{path}: not a .dvc file: {error}") from None
    return hashes


def sha256_of(path):
    """Return the hexadecimal sha256 of a file."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def render_facts(manifests):
    """Return ``{camera: facts}``: what the render manifests say of Blender, device and samples."""
    facts = {}
    for path in manifests:
        manifest = json.loads(Path(path).read_text())
        facts[Path(path).stem] = {k: v for k, v in sorted(manifest.items()) if not isinstance(v, list | dict)}
    return facts


def write_provenance(manifests, lock_file, dvc_files, twin_files, config, provenance_file, run_config_file):
    """Write ``provenance.json`` and ``run_config.yaml`` (the merged configuration); run in the repository's root.

    manifests   render manifests, one a camera
    lock_file   the environment's lock
    twin_files  the twins' effect files that were used; none for ideal twins
    """
    provenance = {
        "git": git_state("."),
        "python": platform.python_version(),
        "packages": installed_versions(PACKAGES),
        "lock_sha256": sha256_of(lock_file),
        "render": render_facts(manifests),
        "data_md5": dvc_hashes(dvc_files),
        "twins_sha256": {f"{Path(p).parent.name}/{Path(p).stem}": sha256_of(p) for p in sorted(twin_files)},
        "seed": SEED,
    }
    with job.write_atomically(provenance_file) as file:
        json.dump(provenance, file, indent=1, sort_keys=True)
        file.write("\n")
    yaml = YAML()
    yaml.default_flow_style = False
    with job.write_atomically(run_config_file) as file:
        # Through JSON: plain types alone, whatever wrappers Snakemake put round the configuration.
        yaml.dump(json.loads(json.dumps(config, sort_keys=True, default=str)), file)


if __name__ == "__main__":
    job.run(
        write_provenance,
        snakemake,
        manifests=snakemake.input.manifests,
        lock_file=snakemake.input.lock,
        dvc_files=snakemake.input.get("dvc", []),
        twin_files=snakemake.input.get("twins", []),
        config=dict(snakemake.params.configuration),
        provenance_file=snakemake.output.provenance,
        run_config_file=snakemake.output.run_config,
    )
