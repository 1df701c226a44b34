"""Still and moving pictures, drawn without a display; needs the extra ``plot``."""

from panoloc_mcl.tools.report.figures.animation import animation
from panoloc_mcl.tools.report.figures.overview import draw_overview
from panoloc_mcl.tools.report.figures.runs import draw_errors, draw_trajectory, errors_svg, trajectory_svg
from panoloc_mcl.tools.report.figures.scene import Shot
from panoloc_mcl.tools.report.figures.series import draw_series
from panoloc_mcl.tools.report.figures.stage import draw_frame
from panoloc_mcl.tools.report.figures.style import FORMATS, can_draw, need_matplotlib, style, write_figure

__all__ = [
    "FORMATS",
    "Shot",
    "animation",
    "can_draw",
    "draw_errors",
    "draw_frame",
    "draw_overview",
    "draw_series",
    "draw_trajectory",
    "errors_svg",
    "need_matplotlib",
    "style",
    "trajectory_svg",
    "write_figure",
]
