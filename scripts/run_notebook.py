"""Run a notebook by papermill, and make a page without its code: self-contained HTML for phone and desk.

The notebook runs in the folder where its executed copy will lie, and is told paths relative to it, so that
the copy can be opened and run again in Jupyter.
"""

import os
import sys
import tempfile
from pathlib import Path

import job
from reporting.pages import page_of


def use_this_environment(scratch):
    """Make ``python3`` mean the Python that runs this script, whatever kernels the user's home has."""
    share = Path(sys.prefix) / "share/jupyter"
    os.environ["JUPYTER_PREFER_ENV_PATH"] = "1"
    os.environ["JUPYTER_PATH"] = os.pathsep.join(filter(None, [str(share), os.environ.get("JUPYTER_PATH")]))
    os.environ["JUPYTER_RUNTIME_DIR"] = str(scratch)
    os.environ["JUPYTER_PLATFORM_DIRS"] = "1"
    os.environ["IPYTHONDIR"] = str(scratch)
    os.environ["PYDEVD_DISABLE_FILE_VALIDATION"] = "1"


def without_clocks(notebook):
    """Drop what differs between two runs of the same numbers: times and random cell ids."""
    notebook.metadata.pop("papermill", None)
    notebook.metadata.pop("language_info", None)
    for k, cell in enumerate(notebook.cells):
        cell.metadata.pop("papermill", None)
        cell.metadata.pop("execution", None)
        cell.id = f"cell-{k}"
    return notebook


def run_notebook(source, parameters, template, executed, page):
    """Execute ``source`` with ``parameters``, all of them paths; write the executed notebook and its page.

    Raises papermill's PapermillExecutionError, with the cell's traceback, where a cell fails; nothing is then
    written.
    """
    executed = Path(executed).absolute()
    executed.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        use_this_environment(scratch)
        # Imported late: Jupyter reads its paths from the environment at import.
        import nbformat
        import papermill

        relative = {
            name: os.path.relpath(Path(path).absolute(), executed.parent) if path else ""
            for name, path in parameters.items()
        }
        notebook = papermill.execute_notebook(
            str(source),
            f"{scratch}/executed.ipynb",
            parameters=relative,
            kernel_name="python3",
            language="python",
            cwd=str(executed.parent),
            progress_bar=False,
            log_output=False,
            extra_arguments=["--log-level=CRITICAL"],  # the kernel tells of its transport at every start
        )
    notebook = without_clocks(notebook)
    html = page_of(notebook, template)
    with job.write_atomically(executed) as file:
        nbformat.write(notebook, file)
    with job.write_atomically(page) as file:
        file.write(html)


if __name__ == "__main__":
    job.run(
        run_notebook,
        snakemake,
        source=snakemake.input.notebook,
        parameters=dict(snakemake.params.paths),
        template=snakemake.input.template,
        executed=snakemake.output.notebook,
        page=snakemake.output.page,
    )
