"""Diagnose: which effect the twin of each camera lacks, and how its error falls as effects are added.

Needs: expand/, register/CAMERA.json, captures, the twin as configured. Makes: diagnosis/CAMERA.json (the verdict),
diagnosis/CAMERA/ (observations, one file a candidate, tables for pictures), tables/ladder.csv. No Blender in the loop:
the fit draws the known plates itself (scripts/gap/synthesis.py, held to Blender's renders by a test).
"""


wildcard_constraints:
    effect="|".join(sorted(available_effects())),


rule observe_captures:
    input:
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
        register_csv=f"{RESULTS}/register/{{camera}}.csv",
        register_json=f"{RESULTS}/register/{{camera}}.json",
        images=captures_of,
        code=imports_of("observe_captures.py"),
        effect_code=diagnosis_effect_code,
    output:
        observations=f"{RESULTS}/diagnosis/{{camera}}/observations.npz",
        base=f"{RESULTS}/diagnosis/{{camera}}/base.json",
    log:
        f"{RESULTS}/logs/observe_captures/{{camera}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/observe_captures/{{camera}}.tsv"
    # the diagnosis is the longest way: it goes first
    priority: 50
    conda:
        "../envs/twingap.yaml"
    params:
        campaign=CAMPAIGN,
        effects=configured_effects,
        free=free_parameters,
        candidates=CANDIDATES,
        pins=locked("numpy", "scipy", "numba", "opencv-contrib-python-headless"),
    message:
        "Measuring the plates of {wildcards.camera} by their known codes"
    script:
        "../scripts/observe_captures.py"


rule try_effect:
    input:
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
        register_json=f"{RESULTS}/register/{{camera}}.json",
        observations=f"{RESULTS}/diagnosis/{{camera}}/observations.npz",
        base=f"{RESULTS}/diagnosis/{{camera}}/base.json",
        code=imports_of("try_effect.py"),
        effect_code=candidate_code,
    output:
        f"{RESULTS}/diagnosis/{{camera}}/candidates/{{effect}}.json",
    log:
        f"{RESULTS}/logs/try_effect/{{camera}}_{{effect}}.log",
    # the diagnosis is the longest way: it goes first
    priority: 20
    conda:
        "../envs/twingap.yaml"
    message:
        "Is it {wildcards.effect} that the twin of {wildcards.camera} lacks?"
    script:
        "../scripts/try_effect.py"


rule diagnose_camera:
    input:
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
        register_json=f"{RESULTS}/register/{{camera}}.json",
        observations=f"{RESULTS}/diagnosis/{{camera}}/observations.npz",
        base=f"{RESULTS}/diagnosis/{{camera}}/base.json",
        candidates=expand(
            f"{RESULTS}/diagnosis/{{{{camera}}}}/candidates/{{effect}}.json",
            effect=CANDIDATES,
        ),
        code=imports_of("diagnose_camera.py"),
        effect_code=diagnosis_effect_code,
    output:
        verdict=f"{RESULTS}/diagnosis/{{camera}}.json",
        ladder=f"{RESULTS}/diagnosis/{{camera}}/ladder.csv",
        plates=f"{RESULTS}/diagnosis/{{camera}}/plates.parquet",
        fields=f"{RESULTS}/diagnosis/{{camera}}/fields.parquet",
        noise=f"{RESULTS}/diagnosis/{{camera}}/noise.parquet",
        example=expand(
            f"{RESULTS}/diagnosis/{{{{camera}}}}/example_{{image}}.png",
            image=["real", "configured", "explained"],
        ),
    log:
        f"{RESULTS}/logs/diagnose_camera/{{camera}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/diagnose_camera/{{camera}}.tsv"
    # the diagnosis is the longest way: it goes first
    priority: 40
    conda:
        "../envs/twingap.yaml"
    params:
        campaign=CAMPAIGN,
        most_steps=config["diagnose"]["most_steps"],
    message:
        "What does the twin of {wildcards.camera} lack?"
    script:
        "../scripts/diagnose_camera.py"


if not HAS_MARKERS:

    # Hand-held photographs of one board: points are all that is known, so only what moves points can be named.
    ruleorder: diagnose_board > diagnose_camera

    rule diagnose_board:
        input:
            scene=f"{RESULTS}/expand/{{camera}}/scene.json",
            tables=expand(
                f"{RESULTS}/expand/{{{{camera}}}}/{{table}}.csv",
                table=["cameras", "captures"],
            ),
            register_json=f"{RESULTS}/register/{{camera}}.json",
            images=captures_of,
            code=imports_of("diagnose_board.py"),
            effect_code=code_of_effects(available_effects()),
        output:
            verdict=f"{RESULTS}/diagnosis/{{camera}}.json",
            ladder=f"{RESULTS}/diagnosis/{{camera}}/ladder.csv",
        log:
            f"{RESULTS}/logs/diagnose_board/{{camera}}.log",
        conda:
            "../envs/twingap.yaml"
        params:
            campaign=campaign_folder,
            most_steps=config["diagnose"]["most_steps"],
            pins=locked("numpy", "opencv-contrib-python-headless"),
        message:
            "What does the twin of {wildcards.camera} lack, as its board tells?"
        script:
            "../scripts/diagnose_board.py"


rule make_ladder:
    input:
        parts=expand(f"{RESULTS}/diagnosis/{{camera}}/ladder.csv", camera=CAMERAS),
        code=imports_of("make_ladder.py"),
    output:
        f"{RESULTS}/tables/ladder.csv",
    log:
        f"{RESULTS}/logs/make_ladder.log",
    conda:
        "../envs/twingap.yaml"
    message:
        "Joining the ladders"
    script:
        "../scripts/make_ladder.py"
