"""Moving: cameras on trajectories before a rig, detectors on them as on video. A target of its own: `snakemake moving`.

Needs: config/moving/NAME.yaml and its rig. Makes: results/moving/NAME/: truth.csv, frames/TRAJECTORY/, detect/DETECTOR.csv,
tables/moving.csv, clips/DETECTOR.webm, notebooks/, report/moving.html. Another experiment is another file:
`snakemake results/moving/NAME/report/moving.html`.
"""


rule moving:
    input:
        "results/moving/default/report/moving.html",
        "results/moving/default/tables/moving.csv",
    message:
        "Moving cameras are in results/moving/default/report/moving.html"


rule trace_moving:
    input:
        experiment="config/moving/{moving}.yaml",
        rig=moving_rig,
        code=imports_of("trace_moving.py"),
    output:
        truth=f"{MOVING}/truth.csv",
        markers=f"{MOVING}/markers.csv",
    log:
        f"{MOVING}/logs/trace_moving.log",
    benchmark:
        f"{MOVING}/benchmarks/trace_moving.tsv"
    conda:
        "../envs/twingap.yaml"
    params:
        pins=locked("numpy", "scipy", "opencv-contrib-python-headless"),
    message:
        "Tracing where markers are seen, row by row"
    script:
        "../scripts/trace_moving.py"


rule render_moving:
    input:
        experiment="config/moving/{moving}.yaml",
        rig=moving_rig,
        code=imports_of("render_moving.py"),
    output:
        frames=directory(f"{MOVING}/frames/{{trajectory}}"),
        timing=f"{MOVING}/render/{{trajectory}}_timing.csv",
    log:
        f"{MOVING}/logs/render_moving/{{trajectory}}.log",
    benchmark:
        f"{MOVING}/benchmarks/render_moving/{{trajectory}}.tsv"
    conda:
        "../envs/twingap.yaml"
    threads: moving_threads
    params:
        store=moving_store,
        pins=locked("bpy", "numpy", "numba"),
    message:
        "Rendering the camera's motion {wildcards.trajectory}"
    script:
        "../scripts/render_moving.py"


rule detect_moving:
    input:
        experiment="config/moving/{moving}.yaml",
        rig=moving_rig,
        frames=moving_frames,
        code=imports_of("detect_moving.py"),
        detector_code=detector_code,
    output:
        detections=f"{MOVING}/detect/{{detector}}.csv",
        timing=f"{MOVING}/detect/{{detector}}_timing.csv",
    log:
        f"{MOVING}/logs/detect_moving/{{detector}}.log",
    benchmark:
        f"{MOVING}/benchmarks/detect_moving/{{detector}}.tsv"
    wildcard_constraints:
        detector="[a-z0-9_]+(?<!_timing)",
    conda:
        "../envs/twingap.yaml"
    params:
        trajectories=moving_trajectories,
        packages=detector_packages,
        pins=locked("opencv-contrib-python-headless", "numpy", "numba", "pandas"),
    message:
        "Following markers with {wildcards.detector}"
    script:
        "../scripts/detect_moving.py"


rule measure_moving:
    input:
        experiment="config/moving/{moving}.yaml",
        rig=moving_rig,
        truth=f"{MOVING}/truth.csv",
        detections=moving_detections,
        timings=moving_timings,
        code=imports_of("measure_moving.py"),
    output:
        measures=f"{MOVING}/tables/moving.csv",
        cells=f"{MOVING}/tables/moving_cells.csv",
        timing=f"{MOVING}/tables/moving_timing.csv",
    log:
        f"{MOVING}/logs/measure_moving.log",
    benchmark:
        f"{MOVING}/benchmarks/measure_moving.tsv"
    conda:
        "../envs/twingap.yaml"
    params:
        detectors=moving_detectors,
        pins=locked("numpy", "scipy", "pandas"),
    message:
        "Measuring what moved cameras lose"
    script:
        "../scripts/measure_moving.py"


rule draw_moving:
    input:
        experiment="config/moving/{moving}.yaml",
        rig=moving_rig,
        truth=f"{MOVING}/truth.csv",
        frames=moving_frames,
        detections=f"{MOVING}/detect/{{detector}}.csv",
        code=imports_of("draw_moving.py"),
    output:
        f"{MOVING}/clips/{{detector}}.webm",
    log:
        f"{MOVING}/logs/draw_moving/{{detector}}.log",
    benchmark:
        f"{MOVING}/benchmarks/draw_moving/{{detector}}.tsv"
    conda:
        "../envs/twingap.yaml"
    params:
        trajectories=moving_trajectories,
        pins=locked("opencv-contrib-python-headless"),
    message:
        "Drawing what {wildcards.detector} reports as a clip"
    script:
        "../scripts/draw_moving.py"


rule run_moving:
    input:
        experiment="config/moving/{moving}.yaml",
        rig=moving_rig,
        tables=expand(
            f"{MOVING}/tables/{{table}}.csv",
            table=["moving", "moving_cells", "moving_timing"],
            allow_missing=True,
        ),
        truth=f"{MOVING}/truth.csv",
        detections=moving_detections,
        frames=moving_frames,
        clips=moving_clips,
        notebook="notebooks/moving.ipynb",
        template="scripts/reporting/moving_template.html.j2",
        frame="scripts/reporting/page_template.html.j2",
        code=imports_of("run_notebook.py", "notebooks/moving.ipynb"),
    output:
        notebook=f"{MOVING}/notebooks/moving.ipynb",
        page=f"{MOVING}/report/moving.html",
    log:
        f"{MOVING}/logs/run_moving.log",
    benchmark:
        f"{MOVING}/benchmarks/run_moving.tsv"
    conda:
        "../envs/twingap.yaml"
    params:
        paths=moving_paths,
        pins=locked("papermill", "nbconvert", "matplotlib"),
    message:
        "Drawing tracks of moving cameras"
    script:
        "../scripts/run_notebook.py"
