"""Expose: linear renders to the twin's images, through exposure, the camera's effects, noise and encoding.

Needs: render/CAMERA.json, register/CAMERA.json, the twin's file where there is one. Makes: twin/CAMERA/CAPTURE.png.
"""


rule expose_twin:
    input:
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
        tables=expand(
            f"{RESULTS}/expand/{{{{camera}}}}/{{table}}.csv",
            table=["cameras", "captures"],
        ),
        register=f"{RESULTS}/register/{{camera}}.json",
        manifest=f"{RESULTS}/render/{{camera}}.json",
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
