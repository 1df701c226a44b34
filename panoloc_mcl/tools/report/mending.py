"""What mending did to a map: a table, ``poses_mended.csv``, and a picture of the graph of keyframes."""

from __future__ import annotations

import io
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.map.keyframes import KINDS, LOOP, Keyframes
from panoloc_mcl.robot.map.panorama_map import PanoramaMap

_SHOWN = 8
# A relative pose with less than this weight is contradicted by the others.
_BORNE_OUT = 0.5
#: Kinds of lines that a picture of the graph has, in the order of `line_kinds`.
LINES = ("relative pose", "met again", "contradicted")


def is_mended(keyframes: Keyframes) -> bool:
    """Whether anything was moved, placed anew or left out."""
    return bool(np.any(keyframes.moved_m > 0.0) or np.any(keyframes.turned != 0.0) or keyframes.left_out)


def lines_of(panorama_map: PanoramaMap) -> Iterator[str]:
    """A table of the keyframes of a survey that were moved farthest."""
    keyframes = panorama_map.keyframes
    if not is_mended(keyframes) or any(keyframes.drives):
        return
    moved, sds = keyframes.moved_m, keyframes.sds
    yield f"{'reference':24} {'moved cm':>9} {'turned deg':>11} {'sd cm':>6} {'sd deg':>7}"
    for index in np.argsort(-moved, kind="stable")[:_SHOWN]:
        yield (
            f"{keyframes.names[index]:24} {100 * moved[index]:9.1f} {np.degrees(keyframes.turned[index]):11.2f} "
            f"{100 * sds[index, 0]:6.1f} {np.degrees(sds[index, 1]):7.2f}"
        )
    if len(keyframes) > _SHOWN:
        yield f"and {len(keyframes) - _SHOWN} more, moved less"


def graph_values(keyframes: Keyframes) -> dict[str, object]:
    """Figures of the graph, for machines."""
    edges, sds = keyframes.edges, keyframes.sds
    kinds = {kind: int(np.sum(edges.kinds == number)) for number, kind in enumerate(KINDS)}
    return {
        "keyframes": len(keyframes),
        "edges": kinds,
        "edges_borne_out": int(np.sum(edges.weights >= _BORNE_OUT)),
        "sd_xy_m_median": float(np.median(sds[:, 0])),
        "sd_theta_deg_median": float(np.degrees(np.median(sds[:, 1]))),
        "moved_m_median": float(np.median(keyframes.moved_m)),
        "turned_deg_median": float(np.degrees(np.median(np.abs(keyframes.turned)))),
        "placed_anew": list(keyframes.placed_anew),
        "left_out": dict(keyframes.left_out),
        "drives": sorted({drive for drive in keyframes.drives if drive}),
    }


def line_kinds(keyframes: Keyframes) -> NDArray[np.int64]:
    """What each relative pose is drawn as: its index in `LINES`."""
    edges = keyframes.edges
    return np.where(edges.weights < _BORNE_OUT, 2, np.where(edges.kinds == LOOP, 1, 0))


def drawn_graph(keyframes: Keyframes) -> dict[str, object] | None:
    """The graph for a page: pairs of keyframes by kind of line, and where those that were moved were given; None without any."""
    edges = keyframes.edges
    if not len(edges):
        return None
    pairs, kinds = np.column_stack([edges.first, edges.second]), line_kinds(keyframes)
    moved = np.flatnonzero(keyframes.moved_m > 0.0) if not any(keyframes.drives) else np.zeros(0, dtype=np.int64)
    return {
        "lines": {name: pairs[kinds == kind].tolist() for kind, name in enumerate(LINES)},
        "moved": [[int(index), *np.round(keyframes.given[index, :2], 4).tolist()] for index in moved],
    }


def graph_lines(keyframes: Keyframes) -> list[tuple[str, str]]:
    """Label and text of the graph, for people."""
    edges, sds = keyframes.edges, keyframes.sds
    drives = sorted({drive for drive in keyframes.drives if drive})
    counted = ", ".join(
        f"{int(np.sum(edges.kinds == number))} {kind}" for number, kind in enumerate(KINDS) if np.any(edges.kinds == number)
    )
    lines = [("keyframes", f"{len(keyframes)}" + (f", from {', '.join(drives)}" if drives else ", surveyed"))]
    if len(edges):
        share = 100.0 * float(np.mean(edges.weights >= _BORNE_OUT))
        lines.append(("relative poses", f"{counted}; {share:.0f} % borne out by the others"))
    spread = f"{100 * np.median(sds[:, 0]):.2f} cm, {np.degrees(np.median(sds[:, 1])):.3f} degrees (median)"
    lines.append(("standard deviations", spread if sds.any() else "none: most poses stay as they were given"))
    if is_mended(keyframes) and not drives:
        moved, turned = keyframes.moved_m, np.degrees(np.abs(keyframes.turned))
        lines.append(
            (
                "mended",
                f"moved {100 * np.median(moved):.1f} cm and turned {np.median(turned):.2f} degrees in the median, "
                f"{100 * moved.max():.1f} cm and {turned.max():.2f} degrees at the most",
            )
        )
    if keyframes.placed_anew:
        lines.append(("placed anew", ", ".join(keyframes.placed_anew)))
    lines += [("left out", f"{name}: {why}") for name, why in keyframes.left_out.items()]
    return lines


def poses_table(keyframes: Keyframes) -> str:
    """The text of ``poses_mended.csv``: standpoints of the camera, which are poses of the base where it has no mount."""
    text = io.StringIO()
    text.write("file,x,y,theta,sd_xy,sd_theta\n")
    for name, pose, sd in zip(keyframes.names, keyframes.poses, keyframes.sds, strict=True):
        deviations = [f"{value:.6f}" if value > 0.0 else "" for value in sd]
        text.write(",".join([name, *(f"{value:.6f}" for value in pose), *deviations]) + "\n")
    return text.getvalue()


def write_mending(panorama_map: PanoramaMap, map_file: str | Path) -> Path | None:
    """Write ``poses_mended.csv`` and, with Matplotlib, ``graph.png`` into a folder beside the map, if there is anything to tell.

    Returns
    -------
    Path or None
        The folder.

    Raises
    ------
    OutputError
        A file cannot be written.
    """
    keyframes = panorama_map.keyframes
    if not is_mended(keyframes):
        return None
    map_file = Path(map_file)
    folder = map_file.with_name(f"{map_file.stem}_mending")
    write_atomically(folder / "poses_mended.csv", poses_table(keyframes))
    if find_spec("matplotlib") is not None:
        from panoloc_mcl.tools.report.figures import style, write_figure
        from panoloc_mcl.tools.report.figures.graph import draw_graph

        with style("mending"):
            write_figure(draw_graph(keyframes), folder / "graph.png")
    return folder
