"""How all pictures look, and how they become files.

Lines and text take the colour of the text around them, so that pictures within a page suit a light and a dark one. Colours are those of
Okabe & Ito, which colour-blind readers tell apart.
"""

from __future__ import annotations

import html
import importlib.util
import io
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from panoloc_mcl.robot.errors import OutputError
from panoloc_mcl.robot.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH_IN = 4.5
BLUE, ORANGE, GREEN, RED = "#0072b2", "#e69f00", "#009e73", "#d55e00"
PINK, SKY, YELLOW = "#cc79a7", "#56b4e9", "#f0e442"
# The four of them that are farthest apart for readers without red or green cones, and nearly black.
STATUS_COLORS = {"searching": SKY, "converged": BLUE, "ambiguous": YELLOW, "lost": RED, "stale": "#222222"}
# Of text on them.
STATUS_INK = {"searching": "#000000", "converged": "#ffffff", "ambiguous": "#000000", "lost": "#ffffff", "stale": "#ffffff"}
#: From no votes to the most.
VOTE_COLORS = ("#f4f8fb", "#cfe2ef", "#7fb3d5", BLUE)
#: Endings of the files that figures can be written to.
FORMATS = (".pdf", ".png", ".svg")
CONVERGED = "#2a87c8"
SEARCHING = "#d55e00"
PLACES = "#888888"
# Stands for the colour of the page's text until the SVG is written.
INK = "#010203"

STYLE = {
    "font.size": 9.0,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "grid.color": INK,
    "grid.alpha": 0.15,
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "svg.fonttype": "none",
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}


def can_draw() -> bool:
    """Whether the plotting library is there."""
    return importlib.util.find_spec("matplotlib") is not None


def need_matplotlib() -> None:
    """Make sure that there is something to draw with.

    Raises
    ------
    OutputError
        Matplotlib is not installed.
    """
    if not can_draw():
        raise OutputError('pictures need matplotlib, which is not installed; pip install "panoloc-mcl[plot]"')


def style(salt: str = "") -> Any:
    """A context in which pictures are drawn; the salt names the parts within an SVG."""
    import matplotlib

    # The salt makes the names within each picture its own, and the same on every run.
    return matplotlib.rc_context({**STYLE, "svg.hashsalt": salt})


def svg_text(figure: Figure, description: str) -> str:
    """A figure as an ``<svg>`` element that takes the page's width and its colour of text."""
    out = io.StringIO()
    figure.savefig(out, format="svg", dpi=150, metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = out.getvalue().replace(INK, "currentColor")
    head, _, body = text[text.index("<svg") :].partition(">")
    # The page decides the width; the view box keeps the proportions.
    head = " ".join(part for part in head.split() if not part.startswith(("width=", "height=")))
    # Names of groups are the same in every picture, and nothing refers to them.
    body = re.sub(r'<g id="[^"]*"', "<g", body)
    return f'{head} role="img" aria-label="{html.escape(description)}">{body.strip()}'


def write_figure(figure: Figure, path: Path, dpi: int = 200) -> None:
    """Write a figure as its file's ending says.

    Raises
    ------
    OutputError
        An ending that is none of ``FORMATS``, or a file that cannot be written.
    """
    if path.suffix.lower() not in FORMATS:
        raise OutputError(f"{path}: pictures end in {', '.join(FORMATS)}; name one of these")
    out = io.BytesIO()
    # Without dates, so that the same figure is the same file.
    stamps = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}.get(path.suffix.lower())
    figure.savefig(out, format=path.suffix[1:].lower(), dpi=dpi, facecolor="white", metadata=stamps)
    write_atomically(path, out.getvalue())
