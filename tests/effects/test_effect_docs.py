"""docs/effects.md lists what there is."""

import re
import sys
from pathlib import Path

import pytest

import effects
from effects import library

DOCS = Path(__file__).parents[2] / "docs/effects.md"


@pytest.mark.parametrize("name", list(library.available_effects()))
def test_the_list_is_complete(name):
    """A reader would miss an effect, or write a parameter or a bound that has changed."""
    line = next(line for line in DOCS.read_text().splitlines() if f"| `{name}` |" in line)
    module = library.available_effects()[name]
    orders = module.ORDER if isinstance(module.ORDER, tuple) else (module.ORDER,)
    assert line.startswith(f"| {module.STAGE} {', '.join(map(str, orders))} |")
    for key, p in module.PARAMETERS.items():
        if name != "local_warp":  # all alike
            assert f"`{key}` {p.unit}, {p.lower:g} to {p.upper:g}, null {p.null:g}" in line


def test_the_page_s_example_is_an_effect(tmp_path, monkeypatch):
    """Fails if what users copy from the page no longer keeps the contract."""
    (example,) = re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.DOTALL)
    (tmp_path / "haze_of_the_page.py").write_text(example)
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    library.available_effects.cache_clear()
    try:
        assert library.starts_of("haze_of_the_page") == [{"light": 0.1}]
    finally:
        library.available_effects.cache_clear()
        sys.modules.pop("effects.haze_of_the_page", None)
