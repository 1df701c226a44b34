"""Figure 4: votes against rotation, and how often the right place leads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.comparison.summaries.plots import save_png
from panoloc_mcl.laboratory.reproduction.bench import Bench
from panoloc_mcl.laboratory.studies.single_images import Frame
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.geometry import FloatArray, wrap_angle
from panoloc_mcl.tools.evaluation.definitions import PASS_RADIUS_M

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
# The paper's figure 4 is about its place 20.
_PLACE = 20
_TURNS_DEG = np.arange(-60.0, 60.5, 2.0)
_CLEAR_DEG = 10.0
_SHOWN_PLACES = 5


def figure_4(bench: Bench, light: str, out: Path) -> list[str]:
    """Votes against rotation near place 20, and how often the right place leads."""
    from matplotlib.figure import Figure

    positions = bench.dataset.references.poses[:, :2]
    place = _PLACE if len(positions) > _PLACE else len(positions) // 2
    shown = bench.nearest(light, positions[place])
    distance = float(np.hypot(*(shown.truth[:2] - positions[place])))
    columns = len(bench.models)
    figure = Figure(figsize=(3.4 * columns + 0.4, 6.0), layout="constrained")
    panels = figure.subplots(2, columns, squeeze=False, sharex=True)
    lines = ["## Figure 4: votes against rotation", "", "![Figure 4](figure_4.png)", ""]
    lines += [
        f"Top: votes for an image {100 * distance:.0f} cm from place {place} (`{shown.drive.name}`, image {shown.index}), turned.",
        "",
    ]
    rows = []
    for column, name in enumerate(bench.models):
        votes = reference_votes(bench, name, bench.panorama(shown), float(shown.truth[2]))
        _draw_votes(panels[0][column], votes, place, name)
        rows += [[name, f"{turn:g}", *(repr(float(v)) for v in row)] for turn, row in zip(_TURNS_DEG, votes, strict=True)]
        lines.append(f"* `{name}`: {shape_of(votes, place)}")
    header = ["model", "turn_deg", *(f"place_{k}" for k in range(len(positions)))]
    write_atomically(out / "figure_4.csv", "\n".join(",".join(row) for row in [header, *rows]) + "\n")
    near = [frame for frame in bench.frames[light] if np.hypot(*(positions - frame.truth[:2]).T).min() <= PASS_RADIUS_M]
    chosen = near[:: max(1, len(near) // bench.images)][: bench.images]
    for column, name in enumerate(bench.models):
        if not chosen:
            break
        leads, shares = leading(bench, name, chosen)
        axes = panels[1][column]
        axes.plot(_TURNS_DEG, leads, color=_COLOURS[0], label="below: share of images in which the right place leads")
        axes.plot(_TURNS_DEG, shares, color=_COLOURS[1], label="below: its votes / those unturned, median")
        axes.set_ylim(-0.03, 1.1)
        lines.append(
            f"* `{name}`, {len(chosen)} images within {PASS_RADIUS_M:g} m of a place: the right place leads in "
            f"{100 * leads[len(leads) // 2]:.0f} % of them unturned, in at least 90 % {up_to(leads, 0.9)}, in at least half "
            f"{up_to(leads, 0.5)}; half of the votes at {half_width(shares):.1f}° (median)."
        )
    widths = {name: half_width(leading(bench, name, chosen)[1]) for name in list(bench.models)[:2]} if chosen else {}
    if len(widths) == 2 and "paper" in widths:
        (_, sharp), (name, blurred) = widths.items()
        lines.append(
            f"* The paper has a clear vote below about {_CLEAR_DEG:g}°. How wide the curve is here follows the filters: 3x3 gradients "
            f"lose half of their votes at {sharp:.1f}°, {name.partition(', ')[2]} at {blurred:.1f}°."
        )
    for axes in panels.flat:
        axes.axvspan(-_CLEAR_DEG, _CLEAR_DEG, color="#000000", alpha=0.06, linewidth=0)
        axes.tick_params(labelsize=8)
        axes.grid(True, alpha=0.25, linewidth=0.5)
    for axes in panels[0]:
        axes.legend(fontsize=7, frameon=False, loc="upper right")
    figure.legend(*panels[1][0].get_legend_handles_labels(), loc="outside upper center", ncols=2, fontsize=8, frameon=False)
    figure.supxlabel("turn from the reference heading [°]; shaded: where the paper has a clear vote", fontsize=9)
    save_png(figure, out / "figure_4.png")
    return [*lines, ""]


def reference_votes(bench: Bench, name: str, panorama: Panorama, heading: float) -> FloatArray:
    """Votes of all references for an image as if it were turned: float64 (turns, references).

    Of a model with places between the references, each reference has the most votes of the places that are nearest to it.
    """
    model = bench.models[name]
    asked = wrap_angle(heading + np.radians(_TURNS_DEG))
    field = model.observe(panorama, asked)
    if len(field.votes) == 1:
        field = model.observe(panorama)
    references = bench.map.references.positions
    owner = np.argmin(np.hypot(*(field.places.positions[:, None] - references[None]).transpose(2, 0, 1)), axis=1)
    votes = np.zeros((len(field.votes), len(references)))
    for reference in range(len(references)):
        votes[:, reference] = field.votes[:, owner == reference].max(axis=1, initial=0.0)
    return votes


def half_width(votes: FloatArray) -> float:
    """Turn at which votes (turns,) have fallen to half of those without a turn, the mean of both sides, degrees."""
    centre = int(np.argmin(np.abs(_TURNS_DEG)))
    widths = []
    for side, turns in ((votes[centre:], _TURNS_DEG[centre:]), (votes[centre::-1], -_TURNS_DEG[centre::-1])):
        below = np.flatnonzero(side <= 0.5 * votes[centre])
        if not len(below):
            return float("nan")
        end = below[0]
        widths.append(np.interp(0.5 * votes[centre], side[[end, end - 1]], turns[[end, end - 1]]))
    return float(np.mean(widths))


def up_to(leads: FloatArray, share: float) -> str:
    """Up to which turn, either way, at least such a share of images has the right place in the lead."""
    centre = int(np.argmin(np.abs(_TURNS_DEG)))
    both = np.minimum(leads[centre:], leads[centre::-1])
    if both[0] < share:
        return "nowhere"
    low = np.flatnonzero(both < share)
    return f"up to {_TURNS_DEG[centre + (low[0] - 1 if len(low) else len(both) - 1)]:g}°"


def shape_of(votes: FloatArray, place: int) -> str:
    """In words: where the right place leads, and how its votes fall."""
    centre = int(np.argmin(np.abs(_TURNS_DEG)))
    leads = np.argmax(votes, axis=1) == place
    if not leads[centre]:
        best = int(np.argmax(votes[centre]))
        return f"the right place does not lead at 0° (place {best} has {votes[centre, best]:.3f}, it has {votes[centre, place]:.3f})."
    left, right = centre, centre
    while left > 0 and leads[left - 1]:
        left -= 1
    while right < len(leads) - 1 and leads[right + 1]:
        right += 1
    own = votes[:, place]
    span = np.abs(_TURNS_DEG) <= 20.0
    rises = np.diff(own[span]) * np.sign(_TURNS_DEG[span][:-1] + 1.0) > 0.02 * own.max()
    return (
        f"the right place leads from {_TURNS_DEG[left]:g}° to {_TURNS_DEG[right]:g}°; its votes are half of those unturned at "
        f"{half_width(own):.1f}° and rise again by more than 2 % of it at {int(rises.sum())} of {int(span.sum()) - 1} steps within 20°."
    )


def leading(bench: Bench, name: str, frames: Sequence[Frame]) -> tuple[FloatArray, FloatArray]:
    """Over many images: how often the right place leads at each turn, and its votes relative to those without a turn."""
    positions = bench.map.references.positions
    leads, shares = [], []
    centre = int(np.argmin(np.abs(_TURNS_DEG)))
    for frame in frames:
        votes = reference_votes(bench, name, bench.panorama(frame), float(frame.truth[2]))
        right = int(np.argmin(np.hypot(*(positions - frame.truth[:2]).T)))
        leads.append(np.argmax(votes, axis=1) == right)
        shares.append(votes[:, right] / max(votes[centre, right], 1e-9))
    return np.mean(leads, axis=0), np.median(shares, axis=0)


def _draw_votes(axes: Any, votes: FloatArray, place: int, title: str) -> None:
    others = [k for k in np.argsort(-votes.max(axis=0)) if k != place][:_SHOWN_PLACES]
    rest = [k for k in range(votes.shape[1]) if k != place and k not in others]
    if rest:
        axes.plot(_TURNS_DEG, votes[:, rest], color="#bbbbbb", linewidth=0.5)
    for k in others:
        axes.plot(_TURNS_DEG, votes[:, k], linewidth=0.9, alpha=0.9, linestyle="--", label=f"place {k}")
    axes.plot(_TURNS_DEG, votes[:, place], color=_COLOURS[1], linewidth=2.0, label=f"place {place}")
    axes.set_title(title, fontsize=9)
    axes.set_ylabel("votes", fontsize=8)
