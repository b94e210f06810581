"""Blind trials: campaigns with something hidden are laid down, diagnosed without the truth, and their envelopes opened.

    snakemake --cores 2 blind_trials --config "blind_trials={single: 58, none: 20}"

Makes: results/blind_trials/ (trials.csv, summary.csv and .md, confusion.csv and .png, parameters.csv, power.csv). The
generator (tests/bench/generator) shares no image formation with the effects; see docs/blind-trials.md.
"""

import sys

sys.path.insert(0, "tests/bench")

from lay_down_trials import identity

TRIALS_FOLDER = "results/blind_trials"
TRIALS_SEED = config["blind_trials"]["seed"]
TRIALS_SIZE = config["blind_trials"]["size"]
TRIALS = {
    identity(kind, index, TRIALS_SEED, size=TRIALS_SIZE)[0]: (kind, index)
    for kind in ("single", "pair", "none", "outside", "power")
    for index in range(config["blind_trials"][kind])
}


rule blind_trials:
    input:
        f"{TRIALS_FOLDER}/summary.csv",
    message:
        f"The outcome is in {TRIALS_FOLDER}"


rule lay_down_trial:
    output:
        campaign=temp(directory(f"{TRIALS_FOLDER}/campaigns/{{trial}}")),
        envelope=f"{TRIALS_FOLDER}/envelopes/{{trial}}/truth.json",
    log:
        f"{TRIALS_FOLDER}/logs/lay_down/{{trial}}.log",
    conda:
        "../envs/twingap.yaml"
    params:
        kind=lambda w: TRIALS[w.trial][0],
        index=lambda w: TRIALS[w.trial][1],
        seed=TRIALS_SEED,
        size=TRIALS_SIZE,
        folder=TRIALS_FOLDER,
    message:
        "Laying down {wildcards.trial}"
    shell:
        "python tests/bench/lay_down_trials.py --out {params.folder}/campaigns --envelopes {params.folder}/envelopes"
        " --kind {params.kind} --first {params.index} --seed {params.seed:q} --size {params.size} > {log} 2>&1"


rule diagnose_trial:
    input:
        campaign=f"{TRIALS_FOLDER}/campaigns/{{trial}}",
        code=GAP_CODE,
        effect_code=modules(*[f"effects/{name}.py" for name in CANDIDATES]),
    output:
        f"{TRIALS_FOLDER}/verdicts/{{trial}}.json",
    log:
        f"{TRIALS_FOLDER}/logs/diagnose/{{trial}}.log",
    conda:
        "../envs/twingap.yaml"
    message:
        "What is hidden in {wildcards.trial}?"
    shell:
        "python tests/bench/diagnose_trial.py {input.campaign} --out {output} > {log} 2>&1"


rule open_envelopes:
    input:
        verdicts=expand(f"{TRIALS_FOLDER}/verdicts/{{trial}}.json", trial=TRIALS),
        envelopes=expand(
            f"{TRIALS_FOLDER}/envelopes/{{trial}}/truth.json", trial=TRIALS
        ),
    output:
        expand(
            f"{TRIALS_FOLDER}/{{table}}.csv",
            table=["trials", "parameters", "summary", "confusion", "power"],
        ),
        f"{TRIALS_FOLDER}/summary.md",
        f"{TRIALS_FOLDER}/confusion.png",
    log:
        f"{TRIALS_FOLDER}/logs/open_envelopes.log",
    conda:
        "../envs/twingap.yaml"
    params:
        folder=TRIALS_FOLDER,
    message:
        "Opening the envelopes"
    shell:
        "python tests/bench/open_envelopes.py --verdicts {params.folder}/verdicts"
        " --envelopes {params.folder}/envelopes --out {params.folder} > {log} 2>&1"
