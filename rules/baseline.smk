"""Baseline: what has changed since an earlier campaign of the same cameras.

    snakemake --cores 2 diagnose --config campaign=FOLDER baseline=EARLIER

Needs: of both campaigns expand/, register/CAMERA.json, the observations and the verdict on each alone; those of the earlier
one are made here where they are missing, by the same rules. Makes: diagnosis/CAMERA.json, whose steps are the changes.
"""

if BASELINE:

    module earlier:
        snakefile:
            "../Snakefile"
        config:
            {**config, "campaign": BASELINE, "baseline": None}

    use rule * from earlier exclude blind_trials, generate_trial, observe_trial, diagnose_trial, fit_true_twin, summarise_trials, moving as before_*

    rule find_changes:
        input:
            before=[
                f"{BEFORE}/expand/{{camera}}/scene.json",
                f"{BEFORE}/register/{{camera}}.json",
                f"{BEFORE}/diagnosis/{{camera}}/observations.npz",
                f"{BEFORE}/diagnosis/{{camera}}.json",
            ],
            after=[
                f"{RESULTS}/expand/{{camera}}/scene.json",
                f"{RESULTS}/register/{{camera}}.json",
                f"{RESULTS}/diagnosis/{{camera}}/observations.npz",
                OWN_VERDICT,
            ],
            tables=expand("{of}/expand/{{camera}}/captures.csv", of=[BEFORE, RESULTS]),
            images=captures_of,
            earlier_images=earlier_images,
            code=imports_of("find_changes.py"),
            finder_code=finder_code,
            effect_code=code_of_effects(available_effects()),
        output:
            verdict=VERDICT,
            pictures=expand(
                f"{RESULTS}/diagnosis/{{{{camera}}}}/change_{{when}}.png",
                when=["before", "after"],
            ),
        log:
            f"{RESULTS}/logs/find_changes/{{camera}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/find_changes/{{camera}}.tsv"
        conda:
            "../envs/twingap.yaml"
        threads: 2
        resources:
            mem_mb=mem_mb_of("diagnose_camera"),
            runtime=runtime_of("diagnose_camera"),
        params:
            campaigns=[BASELINE, CAMPAIGN],
            candidates=CANDIDATES,
            pins=locked("numpy", "scipy", "numba", "opencv-contrib-python-headless"),
        message:
            "What has changed in {wildcards.camera}?"
        script:
            "../scripts/find_changes.py"
