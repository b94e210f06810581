"""Rules take what their scripts import as inputs: every file of it, and no file of what they do not use."""

import re

import pytest

import imports
from job_inputs import imported, jobs_of, scripts_of_rules
from tiny_campaign import board, write_campaign
from workflow_runs import copy_project, edited, planned, pretend

EVERYTHING = ("all", "moving", "blind_trials", "id_study", "poses_study")
TRIALS = ("blind_trials={single: 1, pair: 0, none: 0, outside: 0, power: 0, whole: 1}",)
BATCHED = ("detect_batch", "join_detections", "observe_batch", "join_observations")
CELLS = "diagnose={cells: true}"  # as the rule that looks at them is there then alone


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """Return a project in which a campaign of markers, one of a board, moving cameras, a blind trial and a study are done."""
    folder = tmp_path_factory.mktemp("imports")
    project = copy_project(folder / "project")
    write_campaign(project / "markers")
    write_campaign(project / "board", describe=board)
    pretend(project, *EVERYTHING, "--config", "campaign=markers", *TRIALS)
    pretend(project, "all", "--config", "campaign=board", CELLS)
    pretend(project, "twin_study", "--config", "experiment=config/experiments/paper.yaml")
    return project


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return an empty working folder in which nothing was read yet."""
    monkeypatch.chdir(tmp_path)
    for cached in (imports._closure, imports._names_imported, imports._files_of):
        cached.cache_clear()
        monkeypatch.setattr(imports, cached.__name__, imports.functools.cache(cached.__wrapped__))
    return tmp_path


def write(folder, **files):
    """Write files whose names have __ for / and no ending."""
    for name, text in files.items():
        path = folder / f"{name.replace('__', '/')}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def test_imports_are_followed_wherever_they_stand(folder):
    """Fails if an import inside a function, over several lines, with dots or of a package's __init__ is overlooked."""
    write(folder, scripts__go="import numpy\ndef f():\n    from room import (\n        a,  # one\n        b,\n    )\n")
    write(folder, scripts__room__a="from . import c\nfrom .d import x\n", scripts__room__b="import go, lone as other\n")
    write(folder, scripts__room__c="from room \\\n    import e\n", scripts__room__d="", scripts__room__e="")
    write(folder, scripts__lone="if True:\n    import tests_of\n", tests__bench__tests_of="", scripts__unused="")
    (folder / "scripts/room/__init__.py").touch()
    found = ["go", "lone", "room/__init__", "room/a", "room/b", "room/c", "room/d", "room/e"]
    assert imports.imports_of("go.py") == [*(f"scripts/{name}.py" for name in found), "tests/bench/tests_of.py"]


def test_a_scripts_own_folder_comes_first(folder):
    """Fails if a script that Python starts in its own folder loses what lies beside it."""
    write(folder, scripts__trials__go="import names\nimport job\n", scripts__trials__names="", scripts__job="")
    write(folder, scripts__names="")
    assert imports.imports_of("scripts/trials/go.py") == ["scripts/job.py", "scripts/trials/names.py"]
    assert imports.imports_of("trials/go.py") == imports.imports_of("scripts/trials/go.py")


def test_prose_imports_nothing_and_a_missing_file_is_named(folder):
    """Fails if words that are no statement stop it, or if a misspelt script passes for one without imports."""
    write(folder, scripts__go='"""\nfrom here import what you like\nimport duties\n"""\n', scripts__here="")
    assert imports.imports_of("go.py") == []
    with pytest.raises(FileNotFoundError, match="gone.py"):
        imports.imports_of("gone.py")


def test_a_jobs_inputs_hold_all_that_its_script_imports(project):
    """Fails if any rule lacks a file of its script's or notebook's imports: it could be edited, and old results stay."""
    scripts, missing = scripts_of_rules(project), {}
    jobs = jobs_of(project).values()
    # batches are joined by jobs that tests/test_batches.py runs, changes found where there is a baseline
    assert {rule for rule, _ in jobs} == set(scripts) - {*BATCHED, "find_changes"}
    lists_imports = 'code=imports_of("find_changes.py")' in (project / "rules/baseline.smk").read_text()
    assert lists_imports and scripts["find_changes"] == "scripts/find_changes.py"
    for rule, inputs in jobs:
        sources = [scripts[rule], *(path for path in inputs if re.fullmatch(r"notebooks/.+\.ipynb", path))]
        needed = {module for source in sources for module in imported(source, project)}
        unlisted = needed - set(inputs)
        if unlisted:
            missing[rule] = sorted(unlisted)
    assert missing == {}


def test_a_script_that_a_shell_runs_is_an_input(project):
    """Fails if a rule's command runs a Python file that it does not name as an input; Snakemake knows ``script`` itself."""
    scripts = scripts_of_rules(project)
    shells = [
        (rule, inputs) for rule, inputs in jobs_of(project).values() if scripts[rule].startswith("scripts/trials/")
    ]
    assert shells and [rule for rule, inputs in shells if scripts[rule] not in inputs] == []


@pytest.mark.parametrize("module", ["radial_distortion", "filters"])
def test_an_effects_edit_reruns_a_boards_verdict(project, module):
    """Fails if the effects, or what they import, are no inputs of the verdict; and if it renders anything."""
    with edited(project / f"scripts/effects/{module}.py", '"""', '"""Edited. '):
        plan = planned(project, "--config", "campaign=board", CELLS)
    assert plan.pop("explore_camera") == 2
    assert plan.pop("build_explorer") == 1
    assert plan.pop("draw_board_example") == 2
    again = {"diagnose_camera": 2, "make_ladder": 1, "run_diagnosis": 1, "build_report": 1}
    if module == "filters":  # an effect that reads a start imports it, and one that photographs' files may declare
        assert plan.items() >= (again | {"expose_twin": 2}).items()
        assert not {"render_stations", "register_captures", "light_captures"} & set(plan)
    else:
        assert plan == again


def test_an_effects_edit_reruns_the_verdict_on_markers_and_no_twin(project):
    """Fails if a lens effect that no twin uses yet renders, exposes or detects, or leaves a verdict standing."""
    with edited(project / "scripts/effects/lens_blur.py", '"""', '"""Edited. '):
        plan = planned(project, *EVERYTHING, "--config", "campaign=markers", *TRIALS)
    assert {"diagnose_camera", "compare_twins", "diagnose_trial"} <= set(plan)
    assert not {"render_stations", "expose_twin", "detect_captures", "make_tables", "trace_moving"} & set(plan)


@pytest.mark.parametrize(
    ("module", "observed"),
    [("effects/jpeg_compression", 2), ("detectors/stag", 2), ("effects/lens_blur", 0), ("detectors/bart/__init__", 0)],
)
def test_an_edit_of_what_looks_at_captures_reruns_trials_observations(project, module, observed):
    """Fails if what trials measured outlives an effect that reads starts off captures, or a finder; if other edits rerun it."""
    with edited(project / f"scripts/{module}.py", '"""', '"""Edited. '):
        plan = planned(project, "blind_trials", "--config", "campaign=markers", *TRIALS)
    assert plan.get("observe_trial", 0) == observed
    assert plan.get("diagnose_trial", 0) == (0 if "bart" in module else 2)


@pytest.mark.parametrize(
    ("module", "jobs"),
    [
        ("inputs/safe_yaml.py", {"trace_moving": 1, "render_moving": 6, "detect_moving": 4}),
        ("inputs/images.py", {"trace_moving": 0, "render_moving": 0, "detect_moving": 4}),
        ("detectors/bart/tracker.py", {"trace_moving": 0, "render_moving": 0, "detect_moving": 1}),
    ],
)
def test_an_edit_reruns_what_it_touches_of_moving_cameras(project, module, jobs):
    """Fails if frames or reports outlive the code that made them, or if a detector's edit renders or runs the others."""
    with edited(project / f"scripts/{module}", '"""', '"""Edited. '):
        plan = planned(project, "moving", "--config", "campaign=markers")
    assert {rule: plan.get(rule, 0) for rule in jobs} == jobs
    assert plan["measure_moving"] == plan["run_moving"] == 1
