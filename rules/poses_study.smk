"""Study of poses: one marker in all six degrees of freedom before a camera: found or not, errors, flips, scatter, in maps.

    snakemake --cores 2 poses_study --config "poses_study={families: [DICT_4X4_50], trackers: {aruco3: {}}}"

Needs: the configuration. Makes: results/poses_study/ (poses.csv, detectors.csv, maps/, report.html) and, in sightings/, the
corners that each detector gave of each image. No Blender: the fit's own drawing, which tests hold to Blender's renders.
"""


rule poses_study:
    input:
        f"{POSES_FOLDER}/report.html",
    message:
        f"The maps are in {POSES_FOLDER}/report.html"


rule study_poses:
    input:
        code=imports_of("study_poses.py"),
        detector_code=pose_tracker_code,
    output:
        f"{POSES_FOLDER}/sightings/{{family}}/{{batch}}.csv",
    log:
        f"{POSES_FOLDER}/logs/{{family}}_{{batch}}.log",
    benchmark:
        f"{POSES_FOLDER}/benchmarks/{{family}}_{{batch}}.tsv"
    wildcard_constraints:
        family="[A-Za-z0-9_]+",
        batch="[0-9]+",
    conda:
        "../envs/twingap.yaml"
    params:
        part=part_of_poses,
        families=POSES["families"],
        number=POSES["id"],
        detectors=POSE_TRACKERS,
        draws=POSES["draws"],
        ranges=POSE_RANGES,
        seed=config["seed"],
        pins=locked(
            "opencv-contrib-python-headless", "numpy", "scipy", "numba", "pandas"
        ),
    message:
        "Looking at {wildcards.family} in many poses, part {wildcards.batch}"
    script:
        "../scripts/study_poses.py"


rule map_poses:
    input:
        sightings=pose_sightings,
        template="scripts/reporting/poses_template.html.j2",
        base="scripts/reporting/page_template.html.j2",
        code=imports_of("map_poses.py"),
    output:
        page=f"{POSES_FOLDER}/report.html",
        tables=expand(f"{POSES_FOLDER}/{{table}}.csv", table=("poses", "detectors")),
        maps=directory(f"{POSES_FOLDER}/maps"),
    log:
        f"{POSES_FOLDER}/logs/map_poses.log",
    conda:
        "../envs/twingap.yaml"
    params:
        families=POSES["families"],
        draws=POSES["draws"],
        poses=POSES["poses"],
        ranges=POSE_RANGES,
        seed=config["seed"],
        pins=locked(
            "opencv-contrib-python-headless",
            "numpy",
            "scipy",
            "pandas",
            "matplotlib",
            "jinja2",
        ),
    message:
        "Mapping poses"
    script:
        "../scripts/map_poses.py"
