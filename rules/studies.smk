"""Studies: what the targets of their own are told: blind trials, the studies of ids, of poses and of twins, moving cameras.

Needs: the names of rules/common.smk, rules/code.smk and rules/twins.smk, config/moving/ and config/studies/. Makes: nothing. A
wrong study ends here with one message, and not before it is asked for.
"""

import functools
import shlex

from markers import contract as marker_types
from trials.trial_names import names_of


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
