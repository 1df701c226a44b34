"""A run as a moving picture."""

from __future__ import annotations

import io
from pathlib import Path

from panoloc_mcl.robot.errors import OutputError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.tools.report.figures.scene import Shot
from panoloc_mcl.tools.report.figures.stage import Stage
from panoloc_mcl.tools.report.figures.style import ORANGE, RED, STATUS_COLORS, VOTE_COLORS, style

_FIRST_MS, _FRAME_MS, _LAST_MS = 1500, 450, 2500
#: A moving picture of more frames is large and nobody watches it to the end.
MOST_FRAMES = 80


def animation(shot: Shot, path: Path, progress: Progress = no_progress, dpi: int = 90) -> None:
    """Write a GIF of the recorded frames, from before the first image on.

    Parameters
    ----------
    shot : Shot
    path : Path
        Ends in ``.gif``.
    progress : callable (done, total, what)
    dpi : int
        Dots an inch, of 9.6 inches.

    Raises
    ------
    OutputError
        Another ending, or a file that cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    if path.suffix.lower() != ".gif":
        raise OutputError(f"{path}: moving pictures end in .gif; name one of these")
    every = -(-len(shot.recording) // MOST_FRAMES)
    shown = [*([-1] if len(shot.recording.prior) else []), *range(0, len(shot.recording), every)]
    palette = Image.new("P", (1, 1))
    palette.putpalette(_palette())
    pictures = []
    with style():
        stage = Stage(shot)
        stage.figure.set_dpi(dpi)
        canvas = FigureCanvasAgg(stage.figure)
        for done, frame in enumerate(shown, start=1):
            stage.show(frame)
            canvas.draw()
            picture = Image.frombuffer("RGBA", canvas.get_width_height(), canvas.buffer_rgba().tobytes()).convert("RGB")
            pictures.append(picture.quantize(palette=palette, dither=Image.Dither.NONE))
            progress(done, len(shown), "pictures")
    out = io.BytesIO()
    durations = [_FIRST_MS, *([_FRAME_MS] * (len(pictures) - 2)), _LAST_MS][: len(pictures)]
    pictures[0].save(out, format="GIF", save_all=True, append_images=pictures[1:], duration=durations, loop=0, optimize=True)
    write_atomically(path, out.getvalue())


def _palette() -> list[int]:
    """The same 256 colours for all frames: images, votes, statuses, what is drawn in colour with its edges."""
    from matplotlib.colors import LinearSegmentedColormap, to_rgba

    def shades(name: str, colors: list[str], count: int) -> list[tuple[float, ...]]:
        ramp = LinearSegmentedColormap.from_list(name, colors)
        return [ramp(i / (count - 1)) for i in range(count)]

    colors = [*shades("greys", ["black", "white"], 128), *(to_rgba(color) for color in STATUS_COLORS.values())]
    for drawn in (ORANGE, RED):
        colors += shades("edges", [drawn, VOTE_COLORS[1], "white"], 24)
    colors += shades("votes", list(VOTE_COLORS), 256 - len(colors))
    return [round(255 * part) for color in colors for part in color[:3]]
