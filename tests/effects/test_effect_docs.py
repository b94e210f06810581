"""docs/effects.md lists what there is."""

from pathlib import Path

import pytest

from effects import pipeline

DOCS = Path(__file__).parents[2] / "docs/effects.md"


@pytest.mark.parametrize("name", list(pipeline.available_effects()))
def test_the_list_is_complete(name):
    """A reader would miss an effect, or write a parameter or a bound that has changed."""
    line = next(line for line in DOCS.read_text().splitlines() if f"| `{name}` |" in line)
    module = pipeline.available_effects()[name]
    assert line.startswith(f"| {module.STAGE} {module.ORDER} |")
    for key, p in module.PARAMETERS.items():
        if name != "local_warp":  # all alike
            assert f"`{key}` {p.unit}, {p.lower:g} to {p.upper:g}, null {p.null:g}" in line
