"""Batches: a camera with more captures than config's ``batch`` is detected in and observed by several jobs, then joined.

Needs: what detect_captures and observe_captures need. Makes: the same files as these, byte for byte; parts in batches/.
"""

if DIVIDED:

    rule detect_batch:
        input:
            captures=f"{RESULTS}/expand/{{camera}}/captures.csv",
            markers=f"{RESULTS}/expand/{{camera}}/markers.csv",
            register=f"{RESULTS}/register/{{camera}}.json",
            twin=f"{RESULTS}/twin/{{camera}}",
            images=captures_of_batch,
            code=imports_of("detect_captures.py"),
            detector_code=detector_code,
        output:
            detections=f"{RESULTS}/batches/{{camera}}/{{batch}}/{{detector}}.csv",
            timing=f"{RESULTS}/batches/{{camera}}/{{batch}}/{{detector}}_timing.csv",
        log:
            f"{RESULTS}/logs/detect_batch/{{camera}}_{{detector}}_{{batch}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/detect_batch/{{camera}}_{{detector}}_{{batch}}.tsv"
        wildcard_constraints:
            detector="|".join(DETECTORS),
        conda:
            "../envs/twingap.yaml"
        resources:
            mem_mb=mem_mb_of("detect_captures"),
            runtime=runtime_of("detect_captures"),
        params:
            parameters=detector_parameters,
            dictionaries=[],
            campaign=CAMPAIGN,
            part=part_of_batch,
            packages=detector_packages,
            pins=locked("opencv-contrib-python-headless", "numpy", "numba", "pandas"),
        message:
            "Detecting markers of {wildcards.camera} with {wildcards.detector}, batch {wildcards.batch}"
        script:
            "../scripts/detect_captures.py"

    rule join_detections:
        input:
            parts=batches_of("{detector}.csv"),
            timings=batches_of("{detector}_timing.csv"),
            code=imports_of("join_detections.py"),
        output:
            detections=f"{RESULTS}/detect/{{camera}}/{{detector}}.csv",
            timing=f"{RESULTS}/detect/{{camera}}/{{detector}}_timing.csv",
        log:
            f"{RESULTS}/logs/join_detections/{{camera}}_{{detector}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/join_detections/{{camera}}_{{detector}}.tsv"
        wildcard_constraints:
            camera=one_of(DIVIDED),
            detector="|".join(DETECTORS),
        conda:
            "../envs/twingap.yaml"
        params:
            pins=locked("pandas"),
        message:
            "Joining what {wildcards.detector} found for {wildcards.camera}"
        script:
            "../scripts/join_detections.py"

    rule observe_batch:
        input:
            scene=f"{RESULTS}/expand/{{camera}}/scene.json",
            register_json=f"{RESULTS}/register/{{camera}}.json",
            images=captures_of_batch,
            code=imports_of("observe_captures.py"),
            finder_code=finder_code,
            effect_code=code_of_effects(effects_that_look()),
        output:
            observations=f"{RESULTS}/batches/{{camera}}/{{batch}}/observations.npz",
        log:
            f"{RESULTS}/logs/observe_batch/{{camera}}_{{batch}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/observe_batch/{{camera}}_{{batch}}.tsv"
        # the diagnosis is the longest way: it goes first
        priority: 50
        conda:
            "../envs/twingap.yaml"
        resources:
            mem_mb=mem_mb_of("observe_captures"),
            runtime=runtime_of("observe_captures"),
        params:
            campaign=CAMPAIGN,
            part=part_of_batch,
            pins=locked("numpy", "scipy", "numba", "opencv-contrib-python-headless"),
        message:
            "Measuring the plates of {wildcards.camera} by their known codes, batch {wildcards.batch}"
        script:
            "../scripts/observe_captures.py"

    rule join_observations:
        input:
            parts=batches_of("observations.npz"),
            code=imports_of("join_observations.py"),
        output:
            observations=f"{RESULTS}/diagnosis/{{camera}}/observations.npz",
        log:
            f"{RESULTS}/logs/join_observations/{{camera}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/join_observations/{{camera}}.tsv"
        wildcard_constraints:
            camera=one_of(DIVIDED),
        # the diagnosis is the longest way: it goes first
        priority: 50
        conda:
            "../envs/twingap.yaml"
        params:
            pins=locked("numpy"),
        message:
            "Joining what was measured for {wildcards.camera}"
        script:
            "../scripts/join_observations.py"
