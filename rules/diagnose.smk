"""Diagnose: which effect the twin of each camera lacks, and how its error falls as effects are added.

Needs: expand/, register/CAMERA.json, captures, the twin as configured. Makes: diagnosis/CAMERA.json (the verdict),
diagnosis/CAMERA/ (observations, tables for pictures), tables/ladder.csv. Photographs of a board go the same way, by their
points and, unless ``diagnose.cells`` says no, by their cells. Of several cameras each takes one core, so that none waits for two that
are free at once. No Blender in the loop: the fit draws the known plates itself (scripts/gap/predict/, held to
Blender's renders by a test).
"""

if not BOARD:

    rule observe_captures:
        input:
            scene=f"{RESULTS}/expand/{{camera}}/scene.json",
            register_json=f"{RESULTS}/register/{{camera}}.json",
            images=captures_of,
            code=imports_of("observe_captures.py"),
            finder_code=finder_code,
            effect_code=code_of_effects(effects_that_look()),
        output:
            observations=f"{RESULTS}/diagnosis/{{camera}}/observations.npz",
        log:
            f"{RESULTS}/logs/observe_captures/{{camera}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/observe_captures/{{camera}}.tsv"
        wildcard_constraints:
            camera=one_of(UNDIVIDED),
        # before any diagnosis: the longest of these, of the largest observations, then begins first
        priority: 80
        conda:
            "../envs/twingap.yaml"
        resources:
            mem_mb=mem_mb_of("observe_captures"),
            runtime=runtime_of("observe_captures"),
        params:
            campaign=CAMPAIGN,
            pins=locked("numpy", "scipy", "numba", "opencv-contrib-python-headless"),
        message:
            "Measuring what {wildcards.camera} shows of its plates"
        script:
            "../scripts/observe_captures.py"


if CELLS:

    rule observe_patches:
        input:
            scene=f"{RESULTS}/expand/{{camera}}/scene.json",
            register_json=f"{RESULTS}/register/{{camera}}.json",
            observations=f"{RESULTS}/diagnosis/{{camera}}/observations.npz",
            images=captures_of,
            code=imports_of("observe_patches.py"),
        output:
            patches=f"{RESULTS}/diagnosis/{{camera}}/patches.npz",
        log:
            f"{RESULTS}/logs/observe_patches/{{camera}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/observe_patches/{{camera}}.tsv"
        priority: 80
        conda:
            "../envs/twingap.yaml"
        resources:
            mem_mb=mem_mb_of("observe_captures"),
            runtime=runtime_of("observe_captures"),
        params:
            campaign=CAMPAIGN,
            pins=locked("numpy", "scipy", "numba", "opencv-contrib-python-headless"),
        message:
            "Measuring the board's cells in the photographs of {wildcards.camera}"
        script:
            "../scripts/observe_patches.py"


rule diagnose_camera:
    input:
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
        register_json=f"{RESULTS}/register/{{camera}}.json",
        observations=f"{RESULTS}/diagnosis/{{camera}}/observations.npz",
        patches=f"{RESULTS}/diagnosis/{{camera}}/patches.npz" if CELLS else [],
        files=f"{RESULTS}/register/{{camera}}/files.csv" if CELLS else [],
        code=imports_of("diagnose_camera.py"),
        finder_code=finder_code,
        effect_code=code_of_effects(available_effects()),
    output:
        verdict=OWN_VERDICT,
        ladder=f"{RESULTS}/diagnosis/{{camera}}/ladder.csv",
        plates=f"{RESULTS}/diagnosis/{{camera}}/plates.parquet",
        fields=f"{RESULTS}/diagnosis/{{camera}}/fields.parquet",
        noise=f"{RESULTS}/diagnosis/{{camera}}/noise.parquet",
        # of a board's photographs points are all that is known
        example=expand(
            f"{RESULTS}/diagnosis/{{{{camera}}}}/example_{{image}}.png",
            image=[] if BOARD else ["real", "configured", "explained"],
        ),
    log:
        f"{RESULTS}/logs/diagnose_camera/{{camera}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/diagnose_camera/{{camera}}.tsv"
    # the longest way, and what one waits for: it goes first
    priority: 70
    conda:
        "../envs/twingap.yaml"
    threads: 2 if len(CAMERAS) == 1 else 1
    resources:
        mem_mb=mem_mb_of("diagnose_camera"),
        runtime=runtime_of("diagnose_camera"),
    params:
        campaign=CAMPAIGN,
        effects=configured_effects,
        free=free_parameters,
        candidates=CANDIDATES,
        budget=config["diagnose"]["budget"],
        kept=f"{RESULTS}/kept/{{camera}}",
        pins=locked("numpy", "scipy", "numba", "opencv-contrib-python-headless"),
    message:
        "What does the twin of {wildcards.camera} lack?"
    script:
        "../scripts/diagnose_camera.py"


rule make_ladder:
    input:
        parts=expand(f"{RESULTS}/diagnosis/{{camera}}/ladder.csv", camera=CAMERAS),
        code=imports_of("make_ladder.py"),
    output:
        f"{RESULTS}/tables/ladder.csv",
    log:
        f"{RESULTS}/logs/make_ladder.log",
    benchmark:
        f"{RESULTS}/benchmarks/make_ladder.tsv"
    conda:
        "../envs/twingap.yaml"
    message:
        "Joining the ladders"
    script:
        "../scripts/make_ladder.py"
