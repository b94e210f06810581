"""Report: notebooks run by papermill and shown as pages, provenance, and the page that joins all of it.

Needs: expand and register tables, cells, Tables 1 and 2, twin images, photographs, render manifests.
Makes: notebooks/*.ipynb, report/*.html, provenance.json, run_config.yaml.

Every notebook is a rule of its own with the files that it reads, so that editing one reruns that one and the report.
Another notebook: a rule like those below, and its name in PAGES.
"""

PAGES = (
    ["overview"]
    + (["photographs"] if CAMPAIGN and SOURCE.file.origin == "camera" else [])
    + (["tables", "figure3", "figure4"] if HAS_MARKERS else [])
    + (["diagnosis"] if DIAGNOSIS else [])
    + (["before_after"] if HAS_MARKERS and CAMPAIGN and not BOARD else [])
)


# What a diagnosis of photographs of a board does not draw itself.
BOARD_EXAMPLES = (
    expand(
        f"{RESULTS}/diagnosis/{{camera}}/example_{{image}}.png",
        camera=CAMERAS,
        image=["real", "configured", "explained"],
    )
    if BOARD
    else []
)


if BOARD:

    ruleorder: draw_board_example > diagnose_camera

    rule draw_board_example:
        input:
            scene=f"{RESULTS}/expand/{{camera}}/scene.json",
            register=f"{RESULTS}/register/{{camera}}.csv",
            register_json=f"{RESULTS}/register/{{camera}}.json",
            manifest=f"{RESULTS}/render/{{camera}}.json",
            verdict=OWN_VERDICT,
            images=captures_of,
            code=imports_of("draw_board_example.py"),
            effect_code=code_of_effects(available_effects()),
        output:
            example=expand(
                f"{RESULTS}/diagnosis/{{{{camera}}}}/example_{{image}}.png",
                image=["real", "configured", "explained"],
            ),
        log:
            f"{RESULTS}/logs/draw_board_example/{{camera}}.log",
        conda:
            "../envs/twingap.yaml"
        params:
            campaign=campaign_folder,
            pins=locked("numpy", "scipy", "opencv-contrib-python-headless"),
        message:
            "Drawing a photograph of {wildcards.camera} beside its twins"
        script:
            "../scripts/draw_board_example.py"


rule run_overview:
    input:
        expand(
            f"{RESULTS}/expand/{{table}}.csv",
            table=["markers", "cameras", "stations", "captures"],
        ),
        expand(
            f"{RESULTS}/register/{{camera}}.{{suffix}}",
            camera=CAMERAS,
            suffix=["csv", "json"],
        ),
        expand(f"{RESULTS}/twin/{{camera}}", camera=CAMERAS),
        scene=f"{RESULTS}/expand/scene.json",
        cells=f"{RESULTS}/aggregate/cells.parquet",
        table1=f"{RESULTS}/tables/table1.csv",
        notebook="notebooks/overview.ipynb",
        template="scripts/reporting/page_template.html.j2",
        code=imports_of("run_notebook.py", "notebooks/overview.ipynb"),
    output:
        notebook=f"{RESULTS}/notebooks/overview.ipynb",
        page=f"{RESULTS}/report/overview.html",
    log:
        f"{RESULTS}/logs/run_overview.log",
    benchmark:
        f"{RESULTS}/benchmarks/run_overview.tsv"
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("run_notebook"),
        runtime=runtime_of("run_notebook"),
    params:
        paths={"results": RESULTS, "project": ".", "campaign": CAMPAIGN},
        pins=locked("papermill", "nbconvert", "matplotlib"),
    message:
        "Drawing real and twin side by side"
    script:
        "../scripts/run_notebook.py"


use rule run_overview as run_figure3 with:
    input:
        expand(
            f"{RESULTS}/expand/{{table}}.csv",
            table=["markers", "cameras", "stations", "captures"],
        ),
        scene=f"{RESULTS}/expand/scene.json",
        cells=f"{RESULTS}/aggregate/cells.parquet",
        table1=f"{RESULTS}/tables/table1.csv",
        notebook="notebooks/figure3.ipynb",
        template="scripts/reporting/page_template.html.j2",
        code=imports_of("run_notebook.py", "notebooks/figure3.ipynb"),
    output:
        notebook=f"{RESULTS}/notebooks/figure3.ipynb",
        page=f"{RESULTS}/report/figure3.html",
    log:
        f"{RESULTS}/logs/run_figure3.log",
    benchmark:
        f"{RESULTS}/benchmarks/run_figure3.tsv"
    message:
        "Drawing where markers are found (Figure 3)"


use rule run_figure3 as run_photographs with:
    input:
        expand(
            f"{RESULTS}/expand/{{table}}.csv",
            table=["markers", "cameras", "stations", "captures"],
        ),
        expand(
            f"{RESULTS}/register/{{camera}}{{suffix}}",
            camera=CAMERAS,
            suffix=[".csv", ".json"],
        ),
        expand(f"{RESULTS}/register/{{camera}}/files.csv", camera=CAMERAS),
        scene=f"{RESULTS}/expand/scene.json",
        cells=f"{RESULTS}/aggregate/cells.parquet",
        table1=f"{RESULTS}/tables/table1.csv",
        notebook="notebooks/photographs.ipynb",
        template="scripts/reporting/page_template.html.j2",
        code=imports_of("run_notebook.py", "notebooks/photographs.ipynb"),
    output:
        notebook=f"{RESULTS}/notebooks/photographs.ipynb",
        page=f"{RESULTS}/report/photographs.html",
    log:
        f"{RESULTS}/logs/run_photographs.log",
    benchmark:
        f"{RESULTS}/benchmarks/run_photographs.tsv"
    message:
        "Telling what the photographs were taken with"


use rule run_figure3 as run_figure4 with:
    input:
        expand(
            f"{RESULTS}/expand/{{table}}.csv",
            table=["markers", "cameras", "stations", "captures"],
        ),
        scene=f"{RESULTS}/expand/scene.json",
        cells=f"{RESULTS}/aggregate/cells.parquet",
        table1=f"{RESULTS}/tables/table1.csv",
        notebook="notebooks/figure4.ipynb",
        template="scripts/reporting/page_template.html.j2",
        code=imports_of("run_notebook.py", "notebooks/figure4.ipynb"),
    output:
        notebook=f"{RESULTS}/notebooks/figure4.ipynb",
        page=f"{RESULTS}/report/figure4.html",
    log:
        f"{RESULTS}/logs/run_figure4.log",
    benchmark:
        f"{RESULTS}/benchmarks/run_figure4.tsv"
    message:
        "Drawing how poses differ (Figure 4)"


use rule run_figure3 as run_tables with:
    input:
        expand(
            f"{RESULTS}/tables/{{table}}.{{suffix}}",
            table=["table1", "table2"],
            suffix=["csv", "md"],
        ),
        headlines=f"{RESULTS}/tables/headlines.json",
        notebook="notebooks/tables.ipynb",
        template="scripts/reporting/page_template.html.j2",
        code=imports_of("run_notebook.py", "notebooks/tables.ipynb"),
    output:
        notebook=f"{RESULTS}/notebooks/tables.ipynb",
        page=f"{RESULTS}/report/tables.html",
    log:
        f"{RESULTS}/logs/run_tables.log",
    benchmark:
        f"{RESULTS}/benchmarks/run_tables.tsv"
    message:
        "Setting Tables 1 and 2 in words"


use rule run_figure3 as run_diagnosis with:
    input:
        DIAGNOSIS,
        BOARD_EXAMPLES,
        notebook="notebooks/diagnosis.ipynb",
        template="scripts/reporting/page_template.html.j2",
        code=imports_of("run_notebook.py", "notebooks/diagnosis.ipynb"),
    output:
        notebook=f"{RESULTS}/notebooks/diagnosis.ipynb",
        page=f"{RESULTS}/report/diagnosis.html",
    log:
        f"{RESULTS}/logs/run_diagnosis.log",
    benchmark:
        f"{RESULTS}/benchmarks/run_diagnosis.tsv"
    message:
        "Telling what the twins lack"


use rule run_figure3 as run_before_after with:
    input:
        expand(f"{RESULTS}/compare/{{camera}}.parquet", camera=CAMERAS),
        expand(f"{RESULTS}/diagnosis/{{camera}}.json", camera=CAMERAS),
        expand(f"{RESULTS}/tables/{{table}}.csv", table=["before_after", "table1"]),
        notebook="notebooks/before_after.ipynb",
        template="scripts/reporting/page_template.html.j2",
        code=imports_of("run_notebook.py", "notebooks/before_after.ipynb"),
    output:
        notebook=f"{RESULTS}/notebooks/before_after.ipynb",
        page=f"{RESULTS}/report/before_after.html",
    log:
        f"{RESULTS}/logs/run_before_after.log",
    benchmark:
        f"{RESULTS}/benchmarks/run_before_after.tsv"
    message:
        "Drawing tables and figures before and after"


rule write_provenance:
    input:
        # The tables are no content of it, but results are from the commit at which their numbers were made.
        expand(f"{RESULTS}/tables/{{table}}.csv", table=["table1", "table2"]),
        manifests=expand(f"{RESULTS}/render/{{camera}}.json", camera=CAMERAS),
        lock="envs/twingap.lock.txt",
        dvc=dvc_files(),
        twins=twin_files(),
        code=imports_of("write_provenance.py"),
    output:
        provenance=f"{RESULTS}/provenance.json",
        run_config=f"{RESULTS}/run_config.yaml",
    log:
        f"{RESULTS}/logs/write_provenance.log",
    benchmark:
        f"{RESULTS}/benchmarks/write_provenance.tsv"
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("write_provenance"),
        runtime=runtime_of("write_provenance"),
    params:
        configuration=config,
    message:
        "Noting where the results come from"
    script:
        "../scripts/write_provenance.py"


rule build_report:
    input:
        markers=f"{RESULTS}/expand/markers.csv",
        cameras=f"{RESULTS}/expand/cameras.csv",
        stations=f"{RESULTS}/expand/stations.csv",
        captures=f"{RESULTS}/expand/captures.csv",
        scene=f"{RESULTS}/expand/scene.json",
        headlines=f"{RESULTS}/tables/headlines.json",
        notebooks=expand(f"{RESULTS}/notebooks/{{page}}.ipynb", page=PAGES),
        pages=expand(f"{RESULTS}/report/{{page}}.html", page=PAGES),
        provenance=f"{RESULTS}/provenance.json",
        # Empty where nothing is diagnosed, as in an experiment without photographs.
        diagnoses=[path for path in DIAGNOSIS if path.endswith(".json")],
        ladder=[path for path in DIAGNOSIS if path.endswith("ladder.csv")],
        template="scripts/reporting/report_template.html.j2",
        frame="scripts/reporting/page_template.html.j2",
        code=imports_of("build_report.py"),
    output:
        page=f"{RESULTS}/report/index.html",
    log:
        f"{RESULTS}/logs/build_report.log",
    benchmark:
        f"{RESULTS}/benchmarks/build_report.tsv"
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("build_report"),
        runtime=runtime_of("build_report"),
    params:
        explorer=[Path(path).name for path in EXPLORER],
        pins=locked("jinja2", "pandas"),
    message:
        "Joining the report"
    script:
        "../scripts/build_report.py"
