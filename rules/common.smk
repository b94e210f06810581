"""What all stages share: the checked configuration, the campaign or experiment, and names.

Needs: the configuration. Makes: nothing. A wrong configuration or campaign ends here with one message, before any job.
The files of helper functions (captures.smk, twins.smk, code.smk, resources.smk, studies.smk) build on it.
"""

import re
import sys
from pathlib import Path

sys.path[:0] = ["scripts"]

from detectors import contract
from imports import imports_of
from inputs.baseline import check_baseline
from inputs.campaign import load_campaign
from inputs.config import check_choice, check_config
from inputs.experiment import load_experiment
from inputs.images import check_captures
from rig.errors import InputError

LOCK = "envs/twingap.lock.txt"
PYTHON = sys.executable


def checked():
    """Return (configuration, campaign or designed experiment); end with one message where either is wrong."""
    try:
        done = check_config(dict(config))
        check_names(done)
        if done["campaign"]:
            campaign = load_campaign(done["campaign"])
            check_captures(campaign)
            if done["baseline"]:
                check_baseline(campaign, done["baseline"])
            return done, campaign
        if done["baseline"]:
            raise InputError(
                "configuration: baseline: a campaign of photographs is compared with it, no experiment"
            )
        return done, load_experiment(done["experiment"])
    except InputError as error:
        end_with(error)
    except OSError as error:
        end_with(f"{error.filename}: {error.strerror}")


def end_with(message):
    """End before any job: one message, exit status 1, and no traceback as from an exception."""
    print(f"error: {message}", file=sys.stderr)
    sys.exit(1)


def check_names(done):
    """Refuse detectors, their parameters and effects that do not exist."""
    for key, chosen in (
        ("detectors", done["detectors"]),
        ("poses_study.trackers", done["poses_study"]["trackers"]),
    ):
        check_choice(key, chosen, contract.available())
        for name, parameters in chosen.items():
            contract.check_parameters(name, parameters, f"configuration: {key}.{name}")
            contract.check_packages(name, f"configuration: {key}.{name}")
    if done["diagnose"]["candidates"]:
        check_choice(
            "diagnose.candidates",
            done["diagnose"]["candidates"],
            sorted(available_effects()),
        )


def reading_detectors(done, markers):
    """Return the sorted names of the detectors that read some of the rig's markers; the reference must be one of them."""
    names, families = sorted(done["detectors"]), sorted(set(markers.dictionary))
    try:
        able = contract.readers(names, families, "configuration: detectors")
    except InputError as error:
        end_with(error)
    reference = done["aggregate"]["reference_detector"]
    if reference not in able:
        end_with(
            f"configuration: aggregate.reference_detector: {reference} reads none of the rig's markers "
            f"({', '.join(families)}); allowed are {', '.join(able)}"
        )
    return able


def checked_finders(markers):
    """Return {family: detector} of contract.finders_of; end with one message where there is none."""
    try:
        return contract.finders_of(markers.dictionary)
    except InputError as error:
        end_with(error)


def available_effects():
    """Return {name: module} of all effects. Imported only here: it costs a second that most starts can spare."""
    from effects import library

    try:
        return library.available_effects()
    except InputError as error:
        end_with(error)


def locked(*packages):
    """Return {package: version} from the lock: a bumped version reruns what names it."""
    return {name: LOCKED[name] for name in packages}


def read_lock(path):
    """Return {package: version} of a requirements file."""
    return dict(
        re.findall(r"^([A-Za-z0-9._-]+)==([^ \\\n]+)", Path(path).read_text(), re.M)
    )


def one_of(names):
    """Return the regular expression of some names, of nothing where there are none."""
    return "|".join(map(re.escape, names)) or "(?!)"


def detector_parameters(wildcards):
    """Return the configured parameters of one detector."""
    return config["detectors"][wildcards.detector]


def detector_packages(wildcards):
    """Return {package: version} that one detector needs besides the others' environment."""
    return locked(*contract.needs_of(wildcards.detector).values())


def families_read():
    """Return {detector: families of the rig's markers that it reads}."""
    families = sorted(set(SOURCE.markers.dictionary))
    return {n: [f for f in families if contract.reads(n, f)] for n in DETECTORS}


LOCKED = read_lock(LOCK)
checked_config, SOURCE = checked()
config.update(checked_config)
CAMPAIGN = str(Path(config["campaign"])) if config["campaign"] else None
NAME = SOURCE.file.name
RESULTS = f"results/{NAME}"
CAMERAS = sorted(set(SOURCE.captures.camera) if CAMPAIGN else SOURCE.file.cameras)
DETECTORS = reading_detectors(config, SOURCE.markers)
FINDERS = checked_finders(SOURCE.markers)
CAPTURE_COUNTS = SOURCE.captures.camera.value_counts().to_dict()
# Whether these are photographs of one calibration board.
BOARD = bool(CAMPAIGN and SOURCE.file.target)
# Cameras whose captures are divided among jobs (batches.smk), and the others.
DIVIDED = [
    c for c in CAMERAS if CAMPAIGN and not BOARD and CAPTURE_COUNTS[c] > config["batch"]
]
UNDIVIDED = [c for c in CAMERAS if c not in DIVIDED]
# Whether a board's cells are looked at besides its points.
CELLS = BOARD and config["diagnose"]["cells"]
# Whether the twin of each photograph is in the photograph's own light, which nobody declared.
OWN_LIGHT = BOARD and bool(SOURCE.file.left_open)
BASELINE = config["baseline"]
EARLIER = load_campaign(BASELINE) if BASELINE else None
BEFORE = f"results/{EARLIER.file.name}" if BASELINE else None
# What a campaign's own captures say; beside a baseline the verdict is on what has changed.
VERDICT = f"{RESULTS}/diagnosis/{{camera}}.json"
ALONE = f"{RESULTS}/diagnosis/{{camera}}/alone.json"
OWN_VERDICT = ALONE if BASELINE else VERDICT
DIAGNOSIS = (
    expand(VERDICT, camera=CAMERAS) + [f"{RESULTS}/tables/ladder.csv"]
    if CAMPAIGN
    else []
)
# What was not photographed has nothing to compare.
EXPLORER = [f"{RESULTS}/report/explore.html"] if CAMPAIGN else []
# A chessboard has no markers that a detector could find.
HAS_MARKERS = len(SOURCE.markers) > 0


wildcard_constraints:
    camera="|".join(CAMERAS),
    batch="[0-9]+",


CANDIDATES = config["diagnose"]["candidates"] or sorted(available_effects())
