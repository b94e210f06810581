"""Data: the raw captures of a campaign are tracked by DVC; their files are checked against the .dvc file.

Needs: the campaign's folder and its .dvc file, where it has one. Makes: verified.json. Nothing is fetched here:
`dvc pull` is the user's (and `make`'s).
"""


rule verify_data:
    input:
        dvc=dvc_files(),
        code=imports_of("verify_data.py"),
    output:
        f"{RESULTS}/verified.json",
    log:
        f"{RESULTS}/logs/verify_data.log",
    benchmark:
        f"{RESULTS}/benchmarks/verify_data.tsv"
    # before the long jobs: bad data should cost nothing
    priority: 100
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("verify_data"),
        runtime=runtime_of("verify_data"),
    params:
        campaign=campaign_folder,
        stores=DVC_STORES,
        seen=files_seen,
    message:
        "Checking the captures against their .dvc file"
    script:
        "../scripts/verify_data.py"
