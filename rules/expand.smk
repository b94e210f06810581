"""Expand: configuration or campaign to tables of markers, cameras, stations and captures, the same for both.

Needs: campaign.yaml and its tables, or an experiment's files. Makes: expand/.
"""


rule expand_tables:
    input:
        description=campaign_files(),
        code=modules(
            "job.py",
            "rig/campaign.py",
            "rig/experiment.py",
            "rig/geometry.py",
            "rig/plates.py",
            "rig/safe_yaml.py",
            "rig/tables.py",
        ),
    output:
        markers=f"{RESULTS}/expand/markers.csv",
        cameras=f"{RESULTS}/expand/cameras.csv",
        stations=f"{RESULTS}/expand/stations.csv",
        captures=f"{RESULTS}/expand/captures.csv",
        scene=f"{RESULTS}/expand/scene.json",
    log:
        f"{RESULTS}/logs/expand_tables.log",
    conda:
        "../envs/twingap.yaml"
    params:
        campaign=campaign_folder,
        experiment=config["experiment"],
    message:
        "Laying out markers, cameras, stations and captures"
    script:
        "../scripts/expand_tables.py"
