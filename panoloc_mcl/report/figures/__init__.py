"""Still and moving pictures, drawn without a display; needs the extra ``plot``."""

from panoloc_mcl.report.figures.runs import _INK, can_draw, draw_errors, draw_trajectory, errors_svg, trajectory_svg

__all__ = ["_INK", "can_draw", "draw_errors", "draw_trajectory", "errors_svg", "trajectory_svg"]
