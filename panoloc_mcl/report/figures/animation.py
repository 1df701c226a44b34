"""A run as a moving picture."""

from __future__ import annotations

import io
from pathlib import Path

from panoloc_mcl.errors import OutputError
from panoloc_mcl.files import write_atomically
from panoloc_mcl.report.figures.scene import Shot, Stage
from panoloc_mcl.report.figures.style import style

_FIRST_MS, _FRAME_MS, _LAST_MS = 1500, 450, 2500
_COLORS = 96
#: A moving picture of more frames is large and nobody watches it to the end.
MOST_FRAMES = 80


def animation(shot: Shot, path: Path, dpi: int = 80) -> None:
    """Write a GIF of the recorded frames, from before the first image on.

    Parameters
    ----------
    shot : Shot
    path : Path
        Ends in ``.gif``.
    dpi : int
        Dots an inch, of 6.4 inches.

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
    pictures = []
    with style():
        stage = Stage(shot)
        stage.figure.set_dpi(dpi)
        canvas = FigureCanvasAgg(stage.figure)
        for frame in shown:
            stage.show(frame)
            canvas.draw()
            picture = Image.frombuffer("RGBA", canvas.get_width_height(), canvas.buffer_rgba().tobytes()).convert("RGB")
            pictures.append(picture.quantize(_COLORS, dither=Image.Dither.NONE))
    out = io.BytesIO()
    durations = [_FIRST_MS, *([_FRAME_MS] * (len(pictures) - 2)), _LAST_MS][: len(pictures)]
    pictures[0].save(out, format="GIF", save_all=True, append_images=pictures[1:], duration=durations, loop=0, optimize=True)
    write_atomically(path, out.getvalue())
