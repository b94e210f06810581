"""Id study: all ids of some families through the same views: which are read, which are taken for others, the worst.

    snakemake --cores 2 id_study --config "id_study={families: [DICT_4X4_1000]}"

Needs: the configuration. Makes: results/id_study/ (ids.csv, families.csv, confusions.csv, distances.csv, report.html) and, in
readings/, what each detector said of each view. No Blender: the fit's own drawing, which tests hold to Blender's renders.
"""

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
    return sorted(
        {path for name in config["detectors"] for path in code_of_detector(name)}
    )


rule id_study:
    input:
        f"{STUDY_FOLDER}/report.html",
    message:
        f"The ids are in {STUDY_FOLDER}/report.html"


rule study_ids:
    input:
        code=imports_of("study_ids.py"),
        detector_code=study_detector_code,
    output:
        f"{STUDY_FOLDER}/readings/{{family}}/{{batch}}.csv",
    log:
        f"{STUDY_FOLDER}/logs/{{family}}_{{batch}}.log",
    benchmark:
        f"{STUDY_FOLDER}/benchmarks/{{family}}_{{batch}}.tsv"
    wildcard_constraints:
        family="[A-Za-z0-9_]+",
        batch="[0-9]+",
    conda:
        "../envs/twingap.yaml"
    params:
        ids=study_batch,
        families=STUDY["families"],
        detectors=config["detectors"],
        views=STUDY["views"],
        seed=config["seed"],
        pins=locked("opencv-contrib-python-headless", "numpy", "numba", "pandas"),
    message:
        "Looking at ids of {wildcards.family}, part {wildcards.batch}"
    script:
        "../scripts/study_ids.py"


rule rank_ids:
    input:
        readings=study_readings,
        template="scripts/reporting/ids_template.html.j2",
        base="scripts/reporting/page_template.html.j2",
        code=imports_of("rank_ids.py"),
    output:
        page=f"{STUDY_FOLDER}/report.html",
        tables=expand(
            f"{STUDY_FOLDER}/{{table}}.csv",
            table=("ids", "families", "confusions", "distances"),
        ),
    log:
        f"{STUDY_FOLDER}/logs/rank_ids.log",
    conda:
        "../envs/twingap.yaml"
    params:
        families=STUDY["families"],
        views=STUDY["views"],
        seed=config["seed"],
        pins=locked("opencv-contrib-python-headless", "numpy", "pandas", "jinja2"),
    message:
        "Ranking ids"
    script:
        "../scripts/rank_ids.py"
