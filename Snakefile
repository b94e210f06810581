"""twingap: from a rig's description and photographs to the paper's tables and figures, and to what the twin lacks.

    snakemake --cores 2                              everything, ending with results/NAME/report/index.html
    snakemake --cores 2 diagnose                     to the verdicts
    snakemake --cores 2 --config campaign=FOLDER     for a campaign of your own
    snakemake --cores 2 diagnose --config campaign=FOLDER baseline=EARLIER     what has changed since an earlier one

The way of the data is drawn in docs/architecture.md; each stage is a file in rules/.
"""

from snakemake.utils import min_version

min_version("9.27")


configfile: "config/config.default.yaml"


include: "rules/common.smk"
include: "rules/captures.smk"
include: "rules/twins.smk"
include: "rules/code.smk"
include: "rules/resources.smk"
include: "rules/studies.smk"


rule all:
    default_target: True
    input:
        f"{RESULTS}/report/index.html",
        f"{RESULTS}/tables/table1.csv",
        f"{RESULTS}/tables/table2.csv",
        DIAGNOSIS,
        EXPLORER,
        verified_data(),
    message:
        f"The report is {RESULTS}/report/index.html"


rule diagnose:
    input:
        DIAGNOSIS,
        verified_data(),
    message:
        f"The verdicts are in {RESULTS}/diagnosis"


# In the order in which they run.
for stage in (
    "guard",
    "data",
    "expand",
    "register",
    "render",
    "expose",
    "detect",
    "aggregate",
    "diagnose",
    "batches",
    "baseline",
    "compare",
    "explore",
    "report",
    "moving",
    "blind_trials",
    "id_study",
    "poses_study",
    "twin_study",
):
    if Path(f"rules/{stage}.smk").is_file():

        include: f"rules/{stage}.smk"
