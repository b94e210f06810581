"""What photographs' own files say was done to them: effects with known parameters."""

from effects import library
from inputs import tables


def declared_of(table):
    """Return {capture: [(effect, parameters)]} of what photographs' files say of themselves; empty where the table is None."""
    if not table:
        return {}
    known = tables.read_table(table, tables.FILES)
    known = known.astype({"jpeg_quality": float}).fillna({"jpeg_quality": 0.0})
    return {facts["capture"]: library.declared_by(facts) for facts in known.to_dict("records")}
