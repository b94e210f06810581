"""Id study: all ids of some families through the same views: which are read, which are taken for others, the worst.

    snakemake --cores 2 id_study --config "id_study={families: [DICT_4X4_1000]}"

Needs: the configuration. Makes: results/id_study/ (ids.csv, families.csv, confusions.csv, distances.csv, report.html) and, in
readings/, what each detector said of each view. No Blender: the fit's own drawing, which tests hold to Blender's renders.
"""


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
