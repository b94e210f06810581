"""Register: check every capture, calibrate from boards, find the pose of each capture.

Needs: expand/, the captures (checked against their .dvc file, where there is one). Makes: register/CAMERA.csv, .json,
register/CAMERA/files.csv (what the files say of themselves); of a board diagnosis/CAMERA/observations.npz, its points.
"""

CALIBRATION = {
    camera: sorted(map(str, Path(f"{CAMPAIGN}/calibration/{camera}").glob("*")))
    for camera in CAMERAS
}


rule register_captures:
    input:
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
        tables=expand(
            f"{RESULTS}/expand/{{{{camera}}}}/{{table}}.csv",
            table=["cameras", "captures", "markers", "stations"],
        ),
        images=captures_of,
        calibration=lookup(dpath="{camera}", within=CALIBRATION),
        code=imports_of("register_captures.py"),
        effect_code=lens_code,
        finder_code=finder_code,
    output:
        table=f"{RESULTS}/register/{{camera}}.csv",
        intrinsics=f"{RESULTS}/register/{{camera}}.json",
        observations=f"{RESULTS}/diagnosis/{{camera}}/observations.npz" if BOARD else [],
    log:
        f"{RESULTS}/logs/register_captures/{{camera}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/register_captures/{{camera}}.tsv"
    # the diagnosis is the longest way: it goes first
    priority: 60
    conda:
        "../envs/twingap.yaml"
    threads: 2 if BOARD and len(CAMERAS) == 1 else 1
    resources:
        mem_mb=mem_mb_of("register_captures"),
        runtime=runtime_of("register_captures"),
    params:
        facts=camera_facts,
        campaign=CAMPAIGN,
        effects=lens_effects,
        pins=locked("numpy", "scipy", "opencv-contrib-python-headless"),
    message:
        "Checking and registering the captures of {wildcards.camera}"
    script:
        "../scripts/register_captures.py"


rule describe_files:
    input:
        captures=f"{RESULTS}/expand/{{camera}}/captures.csv",
        images=captures_of,
        code=imports_of("describe_files.py"),
    output:
        table=f"{RESULTS}/register/{{camera}}/files.csv",
    log:
        f"{RESULTS}/logs/describe_files/{{camera}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/describe_files/{{camera}}.tsv"
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("describe_files"),
        runtime=runtime_of("describe_files"),
    params:
        facts=camera_facts,
        campaign=CAMPAIGN,
        pins=locked("pillow", "pillow-heif"),
    message:
        "Reading what the files of {wildcards.camera} say of themselves"
    script:
        "../scripts/describe_files.py"
