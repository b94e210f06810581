"""What all stages share: the checked configuration and campaign, names, and the helper functions of rules.

Needs: the configuration. Makes: nothing. A wrong configuration or campaign ends here with one message, before any job.
"""

import functools
import hashlib
import json
import math
import re
import shlex
import sys
from pathlib import Path

sys.path[:0] = ["scripts"]

import pandas as pd

from detectors import contract
from expand_tables import facts_of
from imports import imports_of
from inputs.baseline import check_baseline
from inputs.campaign import load_campaign
from inputs.config import check_choice, check_config
from rig.errors import InputError
from inputs.experiment import load_experiment
from markers import contract as marker_types
from inputs.images import check_captures
from run_guard import stamp
from trials.trial_names import names_of
from verify_data import tracked_listing, tracked_md5

LOCK = "envs/twingap.lock.txt"
PYTHON = sys.executable
DVC_STORES = [".dvc/cache", "data/dvc-remote"]


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


def format_code():
    """Return the code of calibrations' formats, found by being there, where a camera's intrinsics are a file's."""
    cameras = SOURCE.file.cameras.values()
    if not any(getattr(camera, "intrinsics", None) for camera in cameras):
        return []
    return with_imports(map(str, Path("scripts/calibrations").glob("*.py")))


def campaign_folder(wildcards):
    """Return the campaign's folder, None for a designed experiment."""
    return CAMPAIGN


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


def one_of(names):
    """Return the regular expression of some names, of nothing where there are none."""
    return "|".join(map(re.escape, names)) or "(?!)"


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


def rendered_effects(wildcards):
    """Return the twin's effects that change the scene: all others work on the render."""
    return twin_effects(wildcards.camera, "scene")


def scene_effect_code(wildcards):
    """Return the code of the scene effects that a camera's twin uses."""
    return code_of_effects(name for name, _ in rendered_effects(wildcards))


def exposed_effects(wildcards):
    """Return the effects that act after the render."""
    return twin_effects(wildcards.camera, "lens", "shutter", "sensor", "processing")


def exposed_code(wildcards):
    """Return the code of the effects that act after the render."""
    return code_of_effects(name for name, _ in exposed_effects(wildcards))


def lens_effects(wildcards):
    """Return the twin's effects that move points: photographs of a board are registered behind them, a rig's poses are told."""
    effects = twin_effects(wildcards.camera) if BOARD else []
    return [e for e in effects if hasattr(available_effects()[e[0]], "map_points")]


def lens_code(wildcards):
    """Return the code of the effects through which a camera's photographs are registered."""
    return code_of_effects(name for name, _ in lens_effects(wildcards))


def designed_effects():
    """Return {camera: [[effect, parameters], ...]} of an experiment's twins: its truth is where their lenses put markers."""
    if CAMPAIGN:
        return {}
    return {
        camera: twin_effects(camera, "lens", "shutter", "processing")
        for camera in CAMERAS
    }


def designed_effect_code(wildcards):
    """Return the code of the effects of an experiment's twins."""
    used = {name for effects in designed_effects().values() for name, _ in effects}
    return code_of_effects(sorted(used))


def effect_code(wildcards):
    """Return the code of the effects that a camera's twin uses, or that files of photographs may say."""
    used = {name for name, _ in twin_effects(wildcards.camera)}
    found = available_effects() if BOARD else {}
    said = {name for name, module in found.items() if hasattr(module, "declared_by")}
    return code_of_effects(sorted(used | said))


def code_of_effects(names):
    """Return the files of effects and of what they import: they are found by being there, so no import names them."""
    return with_imports(f"scripts/effects/{name}.py" for name in names)


def effects_that_look():
    """Return the names of effects that read starts off captures, found without importing any."""
    files = sorted(Path("scripts/effects").glob("*.py"))
    return [f.stem for f in files if "\ndef starts_from(" in f.read_text("utf-8")]


def with_imports(files):
    """Return Python files and all that they import, sorted."""
    files = list(files)
    return sorted({*files, *imports_of(*files)})


def twin_of(wildcards):
    """Return the twin's file of wildcards.camera, where the user adopted effects."""
    path = Path(f"config/twins/{NAME}/{wildcards.camera}.yaml")
    return [str(path)] if path.is_file() else []


def twin(camera):
    """Return the inputs.twins.Twin of a camera."""
    from inputs.twins import load_twin

    try:
        return load_twin(f"config/twins/{NAME}/{camera}.yaml")
    except InputError as error:
        end_with(error)


def twin_effects(camera, *stages):
    """Return [[effect, parameters], ...] of a camera's twin, of some stages (all where none is named)."""
    effects = twin(camera).effects
    return [
        [n, p]
        for n, p in effects
        if not stages or available_effects()[n].STAGE in stages
    ]


def twin_starts(camera):
    """Return [[effect, parameters], ...] of a camera's twin from which a fit starts."""
    return [list(effect) for effect in twin(camera).starts]


def twin_free(camera):
    """Return [[effect, parameter], ...] that a camera's twin leaves to be fitted."""
    return [list(f) for f in twin(camera).free]


def configured_effects(wildcards):
    """Return the effects of the camera's twin as configured, all stages; what is to be fitted at its start."""
    return twin_starts(wildcards.camera)


def free_parameters(wildcards):
    """Return the parameters that the camera's twin leaves to be fitted."""
    return twin_free(wildcards.camera)


def twin_files():
    """Return the twins' files of all cameras."""
    paths = [Path(f"config/twins/{NAME}/{camera}.yaml") for camera in CAMERAS]
    return [str(path) for path in paths if path.is_file()]


def detector_code(wildcards):
    """Return the files of the job's detector and of what they import."""
    return code_of_detector(wildcards.detector)


def code_of_detector(name):
    """Return the files of one detector, a module or all of a package, and of what they import."""
    path = Path(f"scripts/detectors/{name}")
    single = path.with_suffix(".py")
    return with_imports(
        [str(single)] if single.is_file() else map(str, path.rglob("*.py"))
    )


def detector_parameters(wildcards):
    """Return the configured parameters of one detector."""
    return config["detectors"][wildcards.detector]


def code_of_detectors(names):
    """Return the files of some detectors and of what they import."""
    return sorted({path for name in set(names) for path in code_of_detector(name)})


def finder_code(wildcards):
    """Return the code of the detectors that find the rig's markers where OpenCV can't, whatever is configured."""
    return code_of_detectors(FINDERS.values())


def checked_finders(markers):
    """Return {family: detector} of contract.finders_of; end with one message where there is none."""
    try:
        return contract.finders_of(markers.dictionary)
    except InputError as error:
        end_with(error)


def families_read():
    """Return {detector: families of the rig's markers that it reads}."""
    families = sorted(set(SOURCE.markers.dictionary))
    return {n: [f for f in families if contract.reads(n, f)] for n in DETECTORS}


def detector_packages(wildcards):
    """Return {package: version} that one detector needs besides the others' environment."""
    return locked(*contract.needs_of(wildcards.detector).values())


def mem_mb_of(rule):
    """Return a function of a job: the memory that it asks for, MB; more where images are larger than the measured ones."""

    def mem_mb(wildcards, attempt):
        more = MEGAPIXEL_MB * max(megapixels(wildcards) - MEASURED_MEGAPIXELS, 0)
        return attempt * math.ceil(SPARE_MEMORY * measured(rule).mem_mb + more)

    return mem_mb


def runtime_of(rule):
    """Return a function of a job: the minutes that it asks for, by how many captures of which size it has."""

    def runtime(wildcards, attempt):
        size = max(megapixels(wildcards) / MEASURED_MEGAPIXELS, 1)
        seconds = measured(rule).capture_s * captures_in(wildcards) * size
        return attempt * math.ceil(SPARE_MINUTES + SPARE_TIME * seconds / 60)

    return runtime


def measured(rule):
    """Return the row of a rule in what was measured; that of ``other`` where it has none."""
    return MEASURED.loc[rule if rule in MEASURED.index else "other"]


def megapixels(wildcards):
    """Return the size of a job's images, of the largest where it has all cameras'."""
    camera = getattr(wildcards, "camera", None)
    cameras = SOURCE.file.cameras
    chosen = [cameras[camera]] if camera else list(cameras.values())
    return max(c.width * c.height for c in chosen) / 1e6


def captures_in(wildcards):
    """Return how many captures a job has to do with."""
    camera = getattr(wildcards, "camera", None)
    count = CAPTURE_COUNTS[camera] if camera else sum(CAPTURE_COUNTS.values())
    return min(count, config["batch"]) if hasattr(wildcards, "batch") else count


# What jobs were measured to take (`python tests/bench/bench_resources.py RESULTS`), and what they ask for above that.
MEASURED = pd.read_csv("config/resources.csv", index_col="rule")
MEASURED_MEGAPIXELS = 0.5
MEGAPIXEL_MB = 130  # of a render job, from 0.5 to 8.3 megapixels
SPARE_MEMORY, SPARE_TIME, SPARE_MINUTES = 1.5, 4, 5

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


def trial_kind(wildcards):
    """Return what kind of thing a blind trial hides."""
    return TRIALS[wildcards.trial][0]


def trial_photographs(wildcards):
    """Return how a blind trial is told where real photographs lie, nothing for one that needs none."""
    is_real = trial_kind(wildcards) == "real" and TRIALS_PHOTOGRAPHS
    return f" --photographs {shlex.quote(TRIALS_PHOTOGRAPHS)}" if is_real else ""


def trial_index(wildcards):
    """Return the index of a blind trial among those of its kind."""
    return TRIALS[wildcards.trial][1]


STUDY_FOLDER = "results/id_study"
STUDY = config["id_study"]


def studied_ids(family):
    """Return the ids of a family that are studied: all, or as many as configured, evenly spread."""
    count = marker_types.count_of(family)
    wanted = min(STUDY["ids"] or count, count)
    return sorted({k * count // wanted for k in range(wanted)})


def study_batch(wildcards):
    """Return the ids of a job."""
    first = int(wildcards.batch) * STUDY["batch"]
    return studied_ids(wildcards.family)[first : first + STUDY["batch"]]


def study_readings(wildcards):
    """Return the readings of all batches; end with one message where a family is unknown or nobody reads it."""
    try:
        contract.readers(
            sorted(config["detectors"]),
            STUDY["families"],
            "configuration: id_study.families",
        )
    except InputError as error:
        end_with(error)
    files = []
    for family in STUDY["families"]:
        batches = -(-len(studied_ids(family)) // STUDY["batch"])
        files += [f"{STUDY_FOLDER}/readings/{family}/{k}.csv" for k in range(batches)]
    return files


def study_detector_code(wildcards):
    """Return the files of all configured detectors and of what they import."""
    return code_of_detectors(config["detectors"])


POSES_FOLDER = "results/poses_study"
POSES = config["poses_study"]
POSE_TRACKERS = config["detectors"] | POSES["trackers"]
POSE_RANGES = {
    name: POSES[name] for name in ("nearest_m", "farthest_m", "steepest_deg")
}


def check_poses():
    """End with one message where a family, the id or a detector of the study of poses can't be."""
    families, where = POSES["families"], "configuration: poses_study"
    try:
        contract.readers(sorted(POSE_TRACKERS), families, f"{where}.families")
        for family in families:
            marker_types.drawing_of(family, POSES["id"])
        for name in POSES["trackers"]:
            contract.make(
                name, families, POSES["trackers"][name], f"{where}.trackers.{name}"
            )
    except InputError as error:
        text = str(error)
        end_with(text if text.startswith(where) else f"{where}.id: {text}")


def part_of_poses(wildcards):
    """Return [first, after the last] of a job's poses."""
    first = int(wildcards.batch) * POSES["batch"]
    return [first, min(first + POSES["batch"], POSES["poses"])]


def pose_sightings(wildcards):
    """Return the sightings of all batches of all families."""
    check_poses()
    batches = range(-(-POSES["poses"] // POSES["batch"]))
    folder = f"{POSES_FOLDER}/sightings"
    return [
        f"{folder}/{family}/{k}.csv" for family in POSES["families"] for k in batches
    ]


def pose_tracker_code(wildcards):
    """Return the files of all detectors of the study of poses and of what they import."""
    return code_of_detectors(POSE_TRACKERS)


TWIN_STUDY = f"{RESULTS}/study"
TWIN_STUDY_FILE = f"config/studies/{NAME}.yaml"


@functools.cache
def twin_study():
    """Return the study of the experiment's twins as a dict; end with one message where there is none or it is wrong."""
    from inputs.twin_study import load_study

    if CAMPAIGN:
        end_with(
            "a study of twins is of an experiment without photographs, such as --config experiment=config/experiments/paper.yaml"
        )
    try:
        return load_study(TWIN_STUDY_FILE, SOURCE, DETECTORS).model_dump()
    except InputError as error:
        end_with(error)


def twin_study_values(wildcards):
    """Return what a job on a camera's twins is told of the study."""
    return twin_study()


def twin_study_detectors(wildcards):
    """Return {detector: parameters} of those that the study looks at."""
    return {name: config["detectors"][name] for name in twin_study()["detectors"]}


def twin_study_code(wildcards):
    """Return the code of the detectors, and of the effects of a camera's twin and of the choices."""
    study = twin_study()
    names = {name for name, _ in exposed_effects(wildcards)}
    names |= {name for choice in study["choices"] for name in choice["effects"]}
    return sorted(
        {*code_of_effects(sorted(names)), *code_of_detectors(study["detectors"])}
    )


def twin_study_readings(wildcards):
    """Return the readings of all cameras; end with one message where there is no study."""
    twin_study()
    return expand(f"{TWIN_STUDY}/readings/{{camera}}.csv", camera=CAMERAS)


MOVING = "results/moving/{moving}"


def moving_experiment(wildcards):
    """Return the moving_config.Moving of a job; end with one message where its file is wrong."""
    from moving.config import load_moving

    path = f"config/moving/{wildcards.moving}.yaml"
    try:
        moving = load_moving(path)
        contract.check_for_sequences(moving.file.detectors, f"{path}: detectors")
        return moving
    except InputError as error:
        end_with(error)


def moving_rig(wildcards):
    """Return the rig's file of a moving experiment."""
    return f"config/rigs/{moving_experiment(wildcards).file.rig}"


def moving_trajectories(wildcards):
    """Return the names of the trajectories."""
    return sorted(moving_experiment(wildcards).file.trajectories)


def moving_detectors(wildcards):
    """Return the names of the detectors that run on the frames."""
    return sorted(moving_experiment(wildcards).file.detectors)


def moving_frames(wildcards):
    """Return the folders of frames of all trajectories."""
    names = moving_trajectories(wildcards)
    return expand(
        f"{MOVING}/frames/{{trajectory}}", trajectory=names, moving=wildcards.moving
    )


def moving_detections(wildcards):
    """Return the reports of all detectors."""
    names = moving_detectors(wildcards)
    return expand(
        f"{MOVING}/detect/{{detector}}.csv", detector=names, moving=wildcards.moving
    )


def moving_timings(wildcards):
    """Return the timings of all detectors."""
    names = moving_detectors(wildcards)
    return expand(
        f"{MOVING}/detect/{{detector}}_timing.csv",
        detector=names,
        moving=wildcards.moving,
    )


def moving_clips(wildcards):
    """Return the clips of all detectors."""
    names = moving_detectors(wildcards)
    return expand(
        f"{MOVING}/clips/{{detector}}.webm", detector=names, moving=wildcards.moving
    )


def moving_threads(wildcards):
    """Return the threads of a render job."""
    return moving_experiment(wildcards).file.threads


def moving_store(wildcards):
    """Return where a trajectory's linear renders are kept between runs."""
    return f"results/moving/{wildcards.moving}/render/{wildcards.trajectory}"


def moving_paths(wildcards):
    """Return what the notebook is told: the run's folder, the repository, the experiment's file."""
    return {
        "results": f"results/moving/{wildcards.moving}",
        "project": ".",
        "experiment": f"config/moving/{wildcards.moving}.yaml",
    }


wildcard_constraints:
    moving="[A-Za-z0-9_-]+",
    trajectory="[A-Za-z0-9_-]+",
