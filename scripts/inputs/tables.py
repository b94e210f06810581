"""The tables that stages hand each other: their columns (pandera), how they are read and written."""

import pandas as pd
import pandera.pandas as pa

from job import write_atomically
from rig.errors import InputError
from rig.light import LIGHT

TEXT, REAL, WHOLE = str, float, int
MAX_COLUMNS = 1000  # no table has a tenth of it; checking as many takes minutes


def _columns(kind, names, nullable=False):
    return {n: pa.Column(kind, nullable=nullable, coerce=True) for n in names}


POSE = ["rx", "ry", "rz", "tx", "ty", "tz"]
MARKERS = pa.DataFrameSchema(
    _columns(TEXT, ["dictionary"])
    | _columns(WHOLE, ["id"])
    | _columns(REAL, ["code_m", "plate_m", "x", "y", "z", "rx", "ry", "rz"]),
    strict=True,
    unique=["dictionary", "id"],
)
CAMERAS = pa.DataFrameSchema(
    _columns(TEXT, ["camera"])
    | _columns(WHOLE, ["width", "height"])
    | _columns(REAL, ["fx", "fy", "cx", "cy"], nullable=True),
    strict=True,
    unique=["camera"],
)
STATIONS = pa.DataFrameSchema(
    _columns(TEXT, ["camera", "station"]) | _columns(REAL, ["height_m", "tilt_deg", *POSE], nullable=True),
    strict=True,
    unique=["camera", "station"],
)
CAPTURES = pa.DataFrameSchema(
    _columns(TEXT, ["capture", "camera", "station"])
    | _columns(WHOLE, ["trial"])
    | _columns(TEXT, ["image"])
    | _columns(TEXT, ["sequence"], nullable=True)
    | _columns("Int64", ["frame"], nullable=True)
    | _columns(REAL, ["t_s"], nullable=True),
    strict=True,
    unique=["capture"],
)

SE = [f"se_{name}" for name in POSE]
REGISTERED = pa.DataFrameSchema(
    _columns(TEXT, ["capture", "station"])
    | _columns(WHOLE, ["trial"])
    | _columns(TEXT, ["status", "sha256"])
    | _columns(WHOLE, ["n_markers"])
    | _columns(REAL, ["rms_px", *POSE, *SE], nullable=True),
    strict=True,
    unique=["capture"],
)
LIGHTS = pa.DataFrameSchema(
    _columns(TEXT, ["capture"]) | _columns(REAL, LIGHT, nullable=True), strict=True, unique=["capture"]
)
FILES = pa.DataFrameSchema(
    _columns(TEXT, ["capture"])
    | _columns(TEXT, ["format", "make", "model"], nullable=True)
    | _columns("Int64", ["orientation"], nullable=True)
    | _columns(REAL, ["exposure_s", "iso", "f_number", "focal_mm", "focal_35mm"], nullable=True)
    | _columns("Int64", ["jpeg_quality"], nullable=True)
    | _columns(TEXT, ["jpeg_tables", "jpeg_sampling", "jpeg_brightness", "jpeg_colour", "notes"], nullable=True),
    strict=True,
    unique=["capture"],
)
CORNERS = ["x0", "y0", "x1", "y1", "x2", "y2", "x3", "y3"]
ALTERNATIVE = [f"{name}_alt" for name in POSE]
DETECTIONS = pa.DataFrameSchema(
    {"source": pa.Column(TEXT, pa.Check.isin(["real", "twin"]), coerce=True)}
    | _columns(TEXT, ["capture", "dictionary"])
    | _columns(WHOLE, ["id"])
    | _columns(REAL, CORNERS)
    | _columns(REAL, [*POSE, "reproj_px", *ALTERNATIVE, "reproj_alt_px"], nullable=True),
    strict=True,
)
DETECTION_TIMES = pa.DataFrameSchema(_columns(TEXT, ["source", "capture"]) | _columns(REAL, ["ms"]), strict=True)


def read_table(path, schema):
    """Return a table as the schema has it; raises InputError naming file and column where it is not."""
    text = {name: str for name, c in schema.columns.items() if c.dtype and "str" in str(c.dtype)}
    with open(path, "rb") as file:
        columns = file.readline().count(b",") + 1
    if columns > MAX_COLUMNS:
        raise InputError(f"{path}: {columns} columns; there are {len(schema.columns)} in such a table")
    try:
        table = pd.read_csv(path, dtype=text, keep_default_na=True)
    except (ValueError, pd.errors.ParserError) as error:  # also of what is no UTF-8, or empty
        raise InputError(f"{path}: not a CSV table in UTF-8 ({error})") from None
    if not isinstance(table.index, pd.RangeIndex):  # pandas takes what is too much for names of rows
        raise InputError(f"{path}: the first row has more values than there are columns")
    for name in table.columns.intersection(list(text)):
        table[name] = table[name].fillna("")
    return _checked(table, path, schema)


def read_lights(path):
    """Return {capture: LIGHT (11,)} of a table of LIGHTS, without captures of which too little was seen."""
    known = read_table(path, LIGHTS).dropna().set_index("capture")
    return {capture: row.to_numpy(float) for capture, row in known[list(LIGHT)].iterrows()}


def write_table(table, path, schema):
    """Check a table and write it as CSV, atomically, floats at full precision."""
    checked = _checked(table, path, schema)
    with write_atomically(path) as file:
        checked.to_csv(file, index=False, lineterminator="\n")


def _checked(table, path, schema):
    try:
        return schema.validate(table)[list(schema.columns)]
    except (pa.errors.SchemaError, pa.errors.SchemaErrors) as error:
        first = getattr(error, "schema_errors", [error])[0]
        raise InputError(f"{path}: {str(first).partition('DataFrameSchema')[0].splitlines()[0]}") from None
