"""Twin study: an experiment's cameras with none of their twins' effects, with each alone, all but each, all, and other choices.

    snakemake --cores 2 twin_study --config experiment=config/experiments/paper.yaml

Needs: config/studies/NAME.yaml, the experiment's renders, cells and twins. Makes: study/ (ablation.csv, choices.csv, heights.csv,
coverage.csv, study.md) and, in readings/, what was found in each image. Images are not kept.
"""


rule twin_study:
    input:
        f"{TWIN_STUDY}/study.md",
    message:
        f"What the twins' effects change is in {TWIN_STUDY}/study.md"


rule study_twin:
    input:
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
        tables=expand(
            f"{RESULTS}/expand/{{{{camera}}}}/{{table}}.csv",
            table=["cameras", "captures", "markers", "stations"],
        ),
        register=f"{RESULTS}/register/{{camera}}.json",
        manifest=f"{RESULTS}/render/{{camera}}.json",
        study=TWIN_STUDY_FILE,
        code=imports_of("study_twin.py"),
        other_code=twin_study_code,
    output:
        f"{TWIN_STUDY}/readings/{{camera}}.csv",
    log:
        f"{RESULTS}/logs/study_twin/{{camera}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/study_twin/{{camera}}.tsv"
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("study_twin"),
        runtime=runtime_of("study_twin"),
    params:
        study=twin_study_values,
        effects=exposed_effects,
        detectors=twin_study_detectors,
        seed=config["seed"],
        pins=locked("numpy", "opencv-contrib-python-headless", "numba", "pandas"),
    message:
        "Looking at twins of {wildcards.camera} with and without each effect"
    script:
        "../scripts/study_twin.py"


rule summarise_study:
    input:
        readings=twin_study_readings,
        cells=f"{RESULTS}/aggregate/cells.parquet",
        table2=f"{RESULTS}/tables/table2.csv",
        code=imports_of("summarise_study.py"),
    output:
        page=f"{TWIN_STUDY}/study.md",
        tables=expand(
            f"{TWIN_STUDY}/{{table}}.csv",
            table=("coverage", "ablation", "choices", "heights"),
        ),
    log:
        f"{RESULTS}/logs/summarise_study.log",
    benchmark:
        f"{RESULTS}/benchmarks/summarise_study.tsv"
    conda:
        "../envs/twingap.yaml"
    params:
        study=twin_study_values,
        pins=locked("numpy", "pandas", "scipy"),
    message:
        "Saying what each effect changes"
    script:
        "../scripts/summarise_study.py"
