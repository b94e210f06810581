"""Aggregate: cells of every camera, detector, capture and marker; Tables 1 and 2 from them.

Needs: the expand tables, registered poses (none without photographs), detections. Makes: aggregate/, tables/table1, table2.
"""


rule aggregate_detections:
    input:
        markers=f"{RESULTS}/expand/markers.csv",
        cameras=f"{RESULTS}/expand/cameras.csv",
        stations=f"{RESULTS}/expand/stations.csv",
        captures=f"{RESULTS}/expand/captures.csv",
        register=expand(f"{RESULTS}/register/{{camera}}.csv", camera=CAMERAS),
        register_json=expand(f"{RESULTS}/register/{{camera}}.json", camera=CAMERAS),
        detections=expand(
            f"{RESULTS}/detect/{{camera}}/{{detector}}.csv",
            camera=CAMERAS,
            detector=DETECTORS,
        ),
        code=imports_of("aggregate_detections.py"),
        effect_code=designed_effect_code,
    output:
        cells=f"{RESULTS}/aggregate/cells.parquet",
        false_ids=f"{RESULTS}/aggregate/false_ids.parquet",
    log:
        f"{RESULTS}/logs/aggregate_detections.log",
    benchmark:
        f"{RESULTS}/benchmarks/aggregate_detections.tsv"
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("aggregate_detections"),
        runtime=runtime_of("aggregate_detections"),
    params:
        effects=designed_effects(),
        pins=locked("numpy", "scipy", "pandas", "pandera", "pyarrow"),
    message:
        "Counting what was found of what was there"
    script:
        "../scripts/aggregate_detections.py"


rule make_tables:
    input:
        cells=f"{RESULTS}/aggregate/cells.parquet",
        false_ids=f"{RESULTS}/aggregate/false_ids.parquet",
        scene=f"{RESULTS}/expand/scene.json",
        code=imports_of("make_tables.py"),
    output:
        expand(
            f"{RESULTS}/tables/{{table}}.{{suffix}}",
            table=["table1", "table2"],
            suffix=["csv", "md", "tex"],
        ),
        f"{RESULTS}/tables/table1_by_type.csv",
        f"{RESULTS}/tables/table2_by_type.csv",
        f"{RESULTS}/tables/headlines.json",
    log:
        f"{RESULTS}/logs/make_tables.log",
    benchmark:
        f"{RESULTS}/benchmarks/make_tables.tsv"
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("make_tables"),
        runtime=runtime_of("make_tables"),
    params:
        reference=config["aggregate"]["reference_detector"],
        read=families_read(),
        pins=locked("numpy", "scipy", "pandas"),
    message:
        "Writing Tables 1 and 2"
    script:
        "../scripts/make_tables.py"
