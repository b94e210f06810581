"""Expose: linear renders to the twin's images, through exposure, the camera's effects, noise and encoding.

Needs: render/CAMERA.json, register/CAMERA.json, the twin's file where there is one; of photographs of a board whose light nobody
declared, diagnosis/CAMERA/observations.npz. Makes: twin/CAMERA/CAPTURE.png; light/CAMERA.csv.
"""

if OWN_LIGHT:

    rule light_captures:
        input:
            scene=f"{RESULTS}/expand/{{camera}}/scene.json",
            tables=expand(
                f"{RESULTS}/expand/{{{{camera}}}}/{{table}}.csv",
                table=["cameras", "captures"],
            ),
            images=captures_of,
            register_json=f"{RESULTS}/register/{{camera}}.json",
            manifest=f"{RESULTS}/render/{{camera}}.json",
            observations=f"{RESULTS}/diagnosis/{{camera}}/observations.npz",
            code=imports_of("light_captures.py"),
            effect_code=exposed_code,
        output:
            f"{RESULTS}/light/{{camera}}.csv",
        log:
            f"{RESULTS}/logs/light_captures/{{camera}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/light_captures/{{camera}}.tsv"
        conda:
            "../envs/twingap.yaml"
        resources:
            mem_mb=mem_mb_of("light_captures"),
            runtime=runtime_of("light_captures"),
        params:
            effects=exposed_effects,
            facts=camera_facts,
            campaign=CAMPAIGN,
            pins=locked("numpy", "scipy", "opencv-contrib-python-headless", "numba"),
        message:
            "Finding the light of the captures of {wildcards.camera}"
        script:
            "../scripts/light_captures.py"


rule expose_twin:
    input:
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
        tables=expand(
            f"{RESULTS}/expand/{{{{camera}}}}/{{table}}.csv",
            table=["cameras", "captures"],
        ),
        register=f"{RESULTS}/register/{{camera}}.json",
        manifest=f"{RESULTS}/render/{{camera}}.json",
        light=f"{RESULTS}/light/{{camera}}.csv" if OWN_LIGHT else [],
        files=f"{RESULTS}/register/{{camera}}/files.csv" if BOARD else [],
        code=imports_of("expose_twin.py"),
        effect_code=effect_code,
    output:
        directory(f"{RESULTS}/twin/{{camera}}"),
    log:
        f"{RESULTS}/logs/expose_twin/{{camera}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/expose_twin/{{camera}}.tsv"
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("expose_twin"),
        runtime=runtime_of("expose_twin"),
    params:
        effects=exposed_effects,
        seed=config["seed"],
        pins=locked("numpy", "opencv-contrib-python-headless", "numba"),
    message:
        "Exposing the twin of {wildcards.camera}"
    script:
        "../scripts/expose_twin.py"
