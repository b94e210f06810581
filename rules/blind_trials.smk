"""Blind trials: campaigns with something hidden are laid down, diagnosed without the truth, and their envelopes opened.

    snakemake --cores 2 blind_trials --config "blind_trials={single: 58, none: 20}"

Makes: results/blind_trials/ (trials.csv, summary.csv and .md, confusion.csv and .png, parameters.csv, power.csv). The
generator (tests/bench/generator) shares no image formation with the effects; see docs/blind-trials.md.
"""

TRIALS_FOLDER = "results/blind_trials"
TRIALS_SEED = config["blind_trials"]["seed"]
TRIALS_SIZE = config["blind_trials"]["size"]
TRIALS = names_of(config["blind_trials"], TRIALS_SEED, TRIALS_SIZE)


rule blind_trials:
    input:
        f"{TRIALS_FOLDER}/summary.csv",
    message:
        f"The outcome is in {TRIALS_FOLDER}"


rule lay_down_trial:
    input:
        script="tests/bench/lay_down_trials.py",
        code=imports_of("tests/bench/lay_down_trials.py"),
    output:
        campaign=temp(directory(f"{TRIALS_FOLDER}/campaigns/{{trial}}")),
        envelope=f"{TRIALS_FOLDER}/envelopes/{{trial}}/truth.json",
    log:
        f"{TRIALS_FOLDER}/logs/lay_down/{{trial}}.log",
    conda:
        "../envs/twingap.yaml"
    params:
        kind=trial_kind,
        index=trial_index,
        seed=TRIALS_SEED,
        size=TRIALS_SIZE,
        python=PYTHON,
    message:
        "Laying down {wildcards.trial}"
    shell:
        "{params.python} tests/bench/lay_down_trials.py --out $(dirname {output.campaign}) --envelopes $(dirname $(dirname {output.envelope}))"
        " --kind {params.kind} --first {params.index} --seed {params.seed:q} --size {params.size} > {log} 2>&1"


rule diagnose_trial:
    input:
        campaign=f"{TRIALS_FOLDER}/campaigns/{{trial}}",
        script="tests/bench/diagnose_trial.py",
        code=imports_of("tests/bench/diagnose_trial.py"),
        effect_code=code_of_effects(available_effects()),
    output:
        f"{TRIALS_FOLDER}/verdicts/{{trial}}.json",
    log:
        f"{TRIALS_FOLDER}/logs/diagnose/{{trial}}.log",
    conda:
        "../envs/twingap.yaml"
    params:
        python=PYTHON,
    message:
        "What is hidden in {wildcards.trial}?"
    shell:
        "{params.python} tests/bench/diagnose_trial.py {input.campaign} --out {output} > {log} 2>&1"


rule open_envelopes:
    input:
        verdicts=expand(f"{TRIALS_FOLDER}/verdicts/{{trial}}.json", trial=TRIALS),
        envelopes=expand(
            f"{TRIALS_FOLDER}/envelopes/{{trial}}/truth.json", trial=TRIALS
        ),
        script="tests/bench/open_envelopes.py",
        code=imports_of("tests/bench/open_envelopes.py"),
    output:
        expand(
            f"{TRIALS_FOLDER}/{{table}}.csv",
            table=["trials", "parameters", "confusion", "power"],
        ),
        f"{TRIALS_FOLDER}/summary.md",
        f"{TRIALS_FOLDER}/confusion.png",
        summary=f"{TRIALS_FOLDER}/summary.csv",
    log:
        f"{TRIALS_FOLDER}/logs/open_envelopes.log",
    conda:
        "../envs/twingap.yaml"
    params:
        python=PYTHON,
    message:
        "Opening the envelopes"
    shell:
        "{params.python} tests/bench/open_envelopes.py --out $(dirname {output.summary})"
        " --verdicts $(dirname {output.summary})/verdicts --envelopes $(dirname {output.summary})/envelopes"
        " > {log} 2>&1"
