"""Blind trials: campaigns with something hidden are generated, measured, diagnosed without the truth, and counted against it.

    snakemake --cores 2 blind_trials --config "blind_trials={single: 58, none: 20}"

Makes: results/blind_trials/ (trials.csv, summary.csv and .md, confusion.csv and .png, parameters.csv, power.csv), and
in observations/ what was measured: an edited rule of the diagnosis is replayed from there, without images. The
generator (tests/bench/generator) shares no image formation with the effects; see docs/blind-trials.md.
"""

TRIALS_FOLDER = "results/blind_trials"
TRIALS_SEED = config["blind_trials"]["seed"]
TRIALS_SIZE = config["blind_trials"]["size"]
TRIALS_PHOTOGRAPHS = config["blind_trials"]["photographs"]
TRIALS = names_of(config["blind_trials"], TRIALS_SEED, TRIALS_SIZE)


rule blind_trials:
    input:
        f"{TRIALS_FOLDER}/summary.csv",
    message:
        f"The outcome is in {TRIALS_FOLDER}"


rule generate_trial:
    input:
        script="scripts/trials/generate_trials.py",
        code=imports_of("trials/generate_trials.py"),
    output:
        campaign=temp(directory(f"{TRIALS_FOLDER}/campaigns/{{trial}}")),
        truth=f"{TRIALS_FOLDER}/truths/{{trial}}/truth.json",
    log:
        f"{TRIALS_FOLDER}/logs/generate/{{trial}}.log",
    conda:
        "../envs/twingap.yaml"
    params:
        kind=trial_kind,
        index=trial_index,
        seed=TRIALS_SEED,
        size=TRIALS_SIZE,
        photographs=trial_photographs,
        python=PYTHON,
    message:
        "Generating {wildcards.trial}"
    shell:
        "{params.python} scripts/trials/generate_trials.py --out $(dirname {output.campaign}) --truths $(dirname $(dirname {output.truth}))"
        " --kind {params.kind} --first {params.index} --seed {params.seed:q} --size {params.size}{params.photographs} > {log} 2>&1"


rule observe_trial:
    input:
        campaign=f"{TRIALS_FOLDER}/campaigns/{{trial}}",
        script="scripts/trials/observe_trial.py",
        code=imports_of("trials/observe_trial.py"),
        finder_code=every_finder_code,
        effect_code=code_of_effects(effects_that_look()),
    output:
        directory(f"{TRIALS_FOLDER}/observations/{{trial}}"),
    log:
        f"{TRIALS_FOLDER}/logs/observe/{{trial}}.log",
    conda:
        "../envs/twingap.yaml"
    params:
        python=PYTHON,
    message:
        "Measuring {wildcards.trial}"
    shell:
        "{params.python} scripts/trials/observe_trial.py {input.campaign} --out {output} > {log} 2>&1"


rule diagnose_trial:
    input:
        observations=f"{TRIALS_FOLDER}/observations/{{trial}}",
        script="scripts/trials/diagnose_trial.py",
        code=imports_of("trials/diagnose_trial.py"),
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
        "{params.python} scripts/trials/diagnose_trial.py --replay {input.observations} --out {output} > {log} 2>&1"


rule fit_true_twin:
    input:
        observations=f"{TRIALS_FOLDER}/observations/{{trial}}",
        truth=f"{TRIALS_FOLDER}/truths/{{trial}}/truth.json",
        script="scripts/trials/true_twin.py",
        code=imports_of("trials/true_twin.py"),
        effect_code=code_of_effects(available_effects()),
    output:
        f"{TRIALS_FOLDER}/true_twins/{{trial}}.json",
    log:
        f"{TRIALS_FOLDER}/logs/true_twin/{{trial}}.log",
    conda:
        "../envs/twingap.yaml"
    params:
        python=PYTHON,
    message:
        "Fitting the true effects of {wildcards.trial}"
    shell:
        "{params.python} scripts/trials/true_twin.py {input.observations} --truth {input.truth} --out {output} > {log} 2>&1"


rule summarise_trials:
    input:
        verdicts=expand(f"{TRIALS_FOLDER}/verdicts/{{trial}}.json", trial=TRIALS),
        truths=expand(f"{TRIALS_FOLDER}/truths/{{trial}}/truth.json", trial=TRIALS),
        true_twins=expand(
            f"{TRIALS_FOLDER}/true_twins/{{trial}}.json",
            trial=[name for name, (kind, _) in TRIALS.items() if kind == "whole"],
        ),
        script="scripts/trials/summarise_trials.py",
        code=imports_of("trials/summarise_trials.py"),
    output:
        expand(
            f"{TRIALS_FOLDER}/{{table}}.csv",
            table=["trials", "parameters", "confusion", "power"],
        ),
        f"{TRIALS_FOLDER}/summary.md",
        f"{TRIALS_FOLDER}/confusion.png",
        summary=f"{TRIALS_FOLDER}/summary.csv",
    log:
        f"{TRIALS_FOLDER}/logs/summarise_trials.log",
    conda:
        "../envs/twingap.yaml"
    params:
        python=PYTHON,
    message:
        "Counting the verdicts against the truth"
    shell:
        "{params.python} scripts/trials/summarise_trials.py --out $(dirname {output.summary})"
        " --verdicts $(dirname {output.summary})/verdicts --truths $(dirname {output.summary})/truths"
        " --true-twins $(dirname {output.summary})/true_twins > {log} 2>&1"
