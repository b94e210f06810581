"""Write what is generated from the models: config/config.default.yaml, the schema.json of every folder, the table in
config/README.md.
"""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from pydantic import BaseModel

from inputs.config import Config
from inputs.experiment import CameraSheet, Experiment, RigFile
from inputs.twin_study import TwinStudy
from job import write_atomically
from moving.config import MovingExperiment

CONFIG = Path(__file__).resolve().parents[1] / "config"
MODELS = {
    "": Config,
    "experiments": Experiment,
    "cameras": CameraSheet,
    "rigs": RigFile,
    "moving": MovingExperiment,
    "studies": TwinStudy,
}
START, END = "<!-- generated: keys -->", "<!-- end of generated -->"


def default_yaml():
    """Return the commented default configuration."""
    lines = [
        "# yaml-language-server: $schema=./schema.json",
        "# Generated from scripts/inputs/config.py by `python scripts/generate_config.py`; your own values go into a file of",
        "# yours (`snakemake --configfile mine.yaml`) or after --config.",
    ]

    def write(model, indent):
        for name, field in type(model).model_fields.items():
            value = getattr(model, name)
            lines.append("")
            lines.append(f"{indent}# {field.description}")
            if isinstance(value, BaseModel):
                lines.append(f"{indent}{name}:")
                write(value, indent + "  ")
            elif isinstance(value, dict) and value:
                lines.append(f"{indent}{name}:")
                lines.extend(f"{indent}  {k}: {json.dumps(v)}" for k, v in value.items())
            else:
                lines.append(f"{indent}{name}: {json.dumps(value)}")

    write(Config(), "")
    return "\n".join(lines) + "\n"


def schema_json(model):
    """Return a model's JSON schema, which editors complete and check with."""
    return json.dumps(model.model_json_schema(), indent=1, sort_keys=True) + "\n"


def _limits(field):
    names = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
    parts = [f"{words} {getattr(m, k):g}" for m in field.metadata for k, words in names.items() if hasattr(m, k)]
    return ", ".join(parts)


def reference_table():
    """Return the Markdown table of all keys."""
    rows = ["| key | default | what it is |", "|---|---|---|"]

    def write(model, prefix):
        for name, field in type(model).model_fields.items():
            value = getattr(model, name)
            if isinstance(value, BaseModel):
                write(value, f"{prefix}{name}.")
            else:
                limits = _limits(field)
                note = f" ({limits})" if limits else ""
                rows.append(f"| `{prefix}{name}` | `{json.dumps(value)}` | {field.description}{note} |")

    write(Config(), "")
    return "\n".join(rows)


def readme(old):
    """Return config/README.md with its generated part renewed."""
    head, _, rest = old.partition(START)
    _, _, tail = rest.partition(END)
    return f"{head}{START}\n{reference_table()}\n{END}{tail}"


def generated(config=CONFIG):
    """Return {path: content} of all generated files."""
    return {
        config / "config.default.yaml": default_yaml(),
        **{config / folder / "schema.json": schema_json(model) for folder, model in MODELS.items()},
        config / "README.md": readme((config / "README.md").read_text()),
    }


if __name__ == "__main__":
    for path, content in generated().items():
        with write_atomically(path) as file:
            file.write(content)
