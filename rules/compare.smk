"""Compare: Tables 1 and 2 and Figures 3 and 4 before and after: with the ideal twin, and with all that the verdict names.

Needs: the verdicts, registered poses, detections of the real captures. Makes: compare/CAMERA.csv and .parquet,
tables/before_after.csv. Twins are drawn as the fit draws them, so no Blender job runs.
"""


rule compare_twins:
    input:
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
        markers=f"{RESULTS}/expand/markers.csv",
        cameras=f"{RESULTS}/expand/cameras.csv",
        stations=f"{RESULTS}/expand/stations.csv",
        captures=f"{RESULTS}/expand/captures.csv",
        register=f"{RESULTS}/register/{{camera}}.csv",
        register_json=f"{RESULTS}/register/{{camera}}.json",
        verdict=OWN_VERDICT,
        # A detector's code reruns this through its detections.
        detections=expand(
            f"{RESULTS}/detect/{{{{camera}}}}/{{detector}}.csv", detector=DETECTORS
        ),
        code=imports_of("compare_twins.py"),
        finder_code=finder_code,
    output:
        table=f"{RESULTS}/compare/{{camera}}.csv",
        cells=f"{RESULTS}/compare/{{camera}}.parquet",
    log:
        f"{RESULTS}/logs/compare_twins/{{camera}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/compare_twins/{{camera}}.tsv"
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("compare_twins"),
        runtime=runtime_of("compare_twins"),
    params:
        parameters={name: config["detectors"][name] for name in DETECTORS},
        seed=config["seed"],
        pins=locked("opencv-contrib-python-headless", "numpy", "numba", "pandas"),
    message:
        "Detecting in the twin of {wildcards.camera} before and after"
    script:
        "../scripts/compare_twins.py"


rule join_comparisons:
    input:
        parts=expand(f"{RESULTS}/compare/{{camera}}.csv", camera=CAMERAS),
        code=imports_of("join_comparisons.py"),
    output:
        f"{RESULTS}/tables/before_after.csv",
    log:
        f"{RESULTS}/logs/join_comparisons.log",
    benchmark:
        f"{RESULTS}/benchmarks/join_comparisons.tsv"
    conda:
        "../envs/twingap.yaml"
    message:
        "Joining Table 2 before and after"
    script:
        "../scripts/join_comparisons.py"
