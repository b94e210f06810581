"""Render: linear radiance of every station with Blender, with an overscan margin that later stages need.

Needs: expand/, register/CAMERA.json (intrinsics; poses where stations are unknown), the twin's scene effects.
Makes: render/CAMERA.json, and beside it render/CAMERA/STATION.npz, kept between runs and trusted by their keys.
"""


rule render_stations:
    input:
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
        tables=expand(
            f"{RESULTS}/expand/{{{{camera}}}}/{{table}}.csv",
            table=["cameras", "markers", "stations"],
        ),
        register_csv=f"{RESULTS}/register/{{camera}}.csv",
        register_json=f"{RESULTS}/register/{{camera}}.json",
        code=imports_of("render_stations.py"),
        effect_code=scene_effect_code,
    output:
        manifest=f"{RESULTS}/render/{{camera}}.json",
        timing=f"{RESULTS}/render/{{camera}}_timing.csv",
    log:
        f"{RESULTS}/logs/render_stations/{{camera}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/render_stations/{{camera}}.tsv"
    conda:
        "../envs/twingap.yaml"
    threads: config["render"]["threads"]
    resources:
        mem_mb=mem_mb_of("render_stations"),
        runtime=runtime_of("render_stations"),
    params:
        effects=rendered_effects,
        settings=config["render"],
        pins=locked("bpy", "numpy"),
    message:
        "Rendering the stations of {wildcards.camera}"
    script:
        "../scripts/render_stations.py"
