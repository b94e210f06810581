"""Expand: configuration or campaign to tables of markers, cameras, stations and captures, the same for both.

Needs: campaign.yaml and its tables, or an experiment's files. Makes: expand/ of all cameras, and expand/CAMERA/ of each,
which is made anew only when something of that camera changed: another camera's new capture reruns nothing of it.
"""


rule expand_tables:
    input:
        description=campaign_files(),
        code=imports_of("expand_tables.py"),
        format_code=format_code(),
    output:
        markers=f"{RESULTS}/expand/markers.csv",
        cameras=f"{RESULTS}/expand/cameras.csv",
        stations=f"{RESULTS}/expand/stations.csv",
        captures=f"{RESULTS}/expand/captures.csv",
        scene=f"{RESULTS}/expand/scene.json",
    log:
        f"{RESULTS}/logs/expand_tables.log",
    benchmark:
        f"{RESULTS}/benchmarks/expand_tables.tsv"
    # the diagnosis is the longest way: it goes first
    priority: 60
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("expand_tables"),
        runtime=runtime_of("expand_tables"),
    params:
        campaign=campaign_folder,
        experiment=config["experiment"],
        camera=None,
    message:
        "Laying out markers, cameras, stations and captures"
    script:
        "../scripts/expand_tables.py"


use rule expand_tables as expand_camera with:
    input:
        description=[ancient(path) for path in campaign_files()],
        code=imports_of("expand_tables.py"),
        format_code=format_code(),
    output:
        markers=f"{RESULTS}/expand/{{camera}}/markers.csv",
        cameras=f"{RESULTS}/expand/{{camera}}/cameras.csv",
        stations=f"{RESULTS}/expand/{{camera}}/stations.csv",
        captures=f"{RESULTS}/expand/{{camera}}/captures.csv",
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
    log:
        f"{RESULTS}/logs/expand_camera/{{camera}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/expand_camera/{{camera}}.tsv"
    params:
        campaign=campaign_folder,
        experiment=config["experiment"],
        camera=wildcard_camera,
        facts=camera_facts,
    message:
        "Laying out stations and captures of {wildcards.camera}"
