"""Detect: every detector on the real captures and the twin images of every camera, one job for each pair.

Needs: expand tables, register/CAMERA.json, twin images, the campaign's captures. Makes: detect/CAMERA/DETECTOR.csv and
its timing. The code of one detector is an input of that detector's jobs alone.
"""


rule detect_captures:
    input:
        captures=f"{RESULTS}/expand/{{camera}}/captures.csv",
        markers=f"{RESULTS}/expand/{{camera}}/markers.csv",
        register=f"{RESULTS}/register/{{camera}}.json",
        twin=f"{RESULTS}/twin/{{camera}}",
        images=captures_of,
        code=imports_of("detect_captures.py"),
        detector_code=detector_code,
    output:
        detections=f"{RESULTS}/detect/{{camera}}/{{detector}}.csv",
        timing=f"{RESULTS}/detect/{{camera}}/{{detector}}_timing.csv",
    log:
        f"{RESULTS}/logs/detect_captures/{{camera}}_{{detector}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/detect_captures/{{camera}}_{{detector}}.tsv"
    wildcard_constraints:
        camera=one_of(UNDIVIDED),
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
        packages=detector_packages,
        pins=locked("opencv-contrib-python-headless", "numpy", "numba", "pandas"),
    message:
        "Detecting markers of {wildcards.camera} with {wildcards.detector}"
    script:
        "../scripts/detect_captures.py"
