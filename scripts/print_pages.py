"""Pages to print, at true scale: plates as Blender builds them, a ruler to check the printer, and what it is, small.

Lengths are millimetres from the page's lower left corner.
"""

import io
import logging
import textwrap

import matplotlib
import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import Circle, PathPatch
from matplotlib.path import Path as Outline

from rig.errors import InputError

PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}
MM_PER_INCH = 25.4
RIM_MM = 5.0  # that printers leave white
RULER_MM, RULER_BAND_MM = 100.0, 16.0
LETTER_PT, LINE_MM = 5.5, 2.6
GAP_MM = 4.0  # between rows of plates that are cut out, for their names
CUT_GREY = "0.75"
FONT = {"pdf.use14corefonts": True, "font.family": "Helvetica"}  # every reader has it
logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)  # it has Helvetica's weight by another name


def fits(size_mm, paper):
    """Return whether something of a size (width, height) has room on a paper, above the ruler."""
    width, height = room(paper)
    return size_mm[0] <= width + 1e-6 and size_mm[1] <= height + 1e-6


def room(paper):
    """Return the (width, height) of a paper that a board or plates can take."""
    width, height = PAPERS[paper]
    return width - 2 * RIM_MM, height - 2 * RIM_MM - RULER_BAND_MM


def board_pages(plate, inner_mm, description, paper):
    """Return the bytes of a PDF with one board in the middle of a page.

    plate     rig.plates.Plate of the board; inner_mm its size (width, height) without the white round it
    Raises InputError where the paper is too small.
    """
    if not fits(inner_mm, paper):
        width, height = room(paper)
        share = min(width / inner_mm[0], height / inner_mm[1])
        raise InputError(
            f"the board is {inner_mm[0]:g} x {inner_mm[1]:g} mm, and {paper} has room for {width:g} x {height:g}; "
            f"lengths of at most {share:.2f} times as much fit"
        )
    (page_width, _), (_, height) = PAPERS[paper], room(paper)
    middle = np.array([page_width / 2, RIM_MM + RULER_BAND_MM + height / 2])
    centre = 1000 * np.array([plate.x_m[[0, -1]].mean(), plate.y_m[[0, -1]].mean()])
    return _document([[(plate, middle - centre, None)]], description, paper)


def plate_pages(plates, plate_mm, description, paper):
    """Return the bytes of a PDF with plates to cut out, as many a page as have room.

    plates  list of (rig.plates.Plate about its centre, its name)
    """
    width, height = room(paper)
    pitch = plate_mm + GAP_MM
    columns, rows = int((width + 1e-6) // plate_mm), int((height + GAP_MM) // pitch)
    if columns < 1 or rows < 1:
        raise InputError(f"a plate of {plate_mm:g} mm has no room on {paper}, which has {width:g} x {height:g}")
    left = (PAPERS[paper][0] - (columns - 1) * plate_mm) / 2
    top = RIM_MM + RULER_BAND_MM + height - plate_mm / 2
    places = [np.array([left + i * plate_mm, top - j * pitch]) for j in range(rows) for i in range(columns)]
    pages = [
        [(plate, place, name) for (plate, name), place in zip(plates[k : k + len(places)], places, strict=False)]
        for k in range(0, len(plates), len(places))
    ]
    return _document(pages, description, paper)


def _document(pages, description, paper):
    file = io.BytesIO()
    facts = {"Title": description, "Creator": "twingap", "CreationDate": None}
    with matplotlib.rc_context(FONT), PdfPages(file, metadata=facts) as document:
        for number, items in enumerate(pages, start=1):
            of = f" Page {number} of {len(pages)}." if len(pages) > 1 else ""
            document.savefig(_page(items, description + of, paper))
    return file.getvalue()


def _page(items, description, paper):
    """Return a figure of items [(Plate, place of its origin mm, name where it is to be cut out)]."""
    width, height = PAPERS[paper]
    figure = Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.set_axis_off()
    for plate, place, name in items:
        axes.add_patch(_black(plate, place))
        for x, y, radius, white in plate.discs:
            middle, colour = 1000 * np.array([x, y]) + place, "white" if white else "black"
            axes.add_patch(Circle(middle, 1000 * radius, facecolor=colour, linewidth=0, antialiased=True))
        if name:
            _cut_out(axes, plate, place, name)
    _ruler(axes, description, width)
    return figure


def _black(plate, place):
    """Return a plate's black cells as one patch: neighbours that are one outline leave no hairline between them."""
    x, y = 1000 * plate.x_m + place[0], 1000 * plate.y_m + place[1]
    rows, columns = np.nonzero(~plate.white)
    corners = np.stack([
        np.stack([x[columns], y[rows]], 1), np.stack([x[columns + 1], y[rows]], 1),
        np.stack([x[columns + 1], y[rows + 1]], 1), np.stack([x[columns], y[rows + 1]], 1),
        np.stack([x[columns], y[rows]], 1),
    ], axis=1)  # fmt: skip
    codes = [Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY] * len(rows)
    return PathPatch(Outline(corners.reshape(-1, 2), codes), facecolor="black", linewidth=0, antialiased=True)


def _cut_out(axes, plate, place, name):
    """Draw where a plate is cut out, and its name beside it."""
    x, y = 1000 * plate.x_m[[0, -1]] + place[0], 1000 * plate.y_m[[0, -1]] + place[1]
    axes.plot(x[[0, 1, 1, 0, 0]], y[[0, 0, 1, 1, 0]], color=CUT_GREY, linewidth=0.25)
    axes.text(x[0], y[0] - 0.4, name, fontsize=LETTER_PT - 1, va="top", color="0.4", parse_math=False)


def _ruler(axes, description, width):
    """Draw 100 mm with their millimetres, and the description in small letters beside them."""
    left, low = RIM_MM + 2, RIM_MM + 2
    for mm in range(int(RULER_MM) + 1):
        length = 4.0 if mm % 10 == 0 else 2.8 if mm % 5 == 0 else 1.8
        axes.plot([left + mm] * 2, [low, low + length], color="black", linewidth=0.3, solid_capstyle="butt")
        if mm % 10 == 0:
            axes.text(left + mm, low + 4.4, str(mm), fontsize=LETTER_PT, ha="center", va="bottom")
    axes.plot([left, left + RULER_MM], [low, low], color="black", linewidth=0.3)
    check = (
        "Print at 100 %, not fitted to the page. These 100 mm must measure 100 mm; if they do not, measure a square."
    )
    beside = left + RULER_MM + 6
    lines = textwrap.wrap(f"{description} {check}", int((width - RIM_MM - beside) / 0.96))
    for k, line in enumerate(lines):
        axes.text(beside, low + 12.5 - k * LINE_MM, line, fontsize=LETTER_PT, va="top", color="0.25", parse_math=False)
