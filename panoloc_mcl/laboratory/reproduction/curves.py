"""Figures 6 and 8: recognition against random pixels and against occlusion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from panoloc_mcl.laboratory.comparison.pooling import Group
from panoloc_mcl.laboratory.comparison.study import Study
from panoloc_mcl.laboratory.comparison.summaries.plots import draw_rates as draw_curve
from panoloc_mcl.laboratory.comparison.summaries.plots import save_png
from panoloc_mcl.laboratory.comparison.summaries.summary import rate
from panoloc_mcl.tools.evaluation.tables import percent

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
_GOOD_RATE = 0.9


def rates(title: str, found: Study, kind: str, file: str, out: Path) -> list[str]:
    """Recognition against severity: table and plot."""
    severities = sorted({severity_of(group.axes["corruption"], kind) for group in found.groups})
    methods = list(dict.fromkeys(group.axes["variant"] for group in found.groups))
    of = {(g.axes["variant"], severity_of(g.axes["corruption"], kind)): g for g in found.groups}
    draw_rates(of, methods, severities, kind, out / file)
    lines = [f"## {title}", "", f"![{title}]({file})", ""]
    lines += [f"| recognised % (95 %) of passed | {' | '.join(f'{100 * s:g} %' for s in severities)} |"]
    lines += [f"|---|{'---|' * len(severities)}"]
    for method in methods:
        cells = []
        for severity in severities:
            group = of[method, severity]
            seen = None if group.metrics is None else group.metrics["recognition"]
            cells.append("–" if seen is None or not seen["passed"] else f"{rate(seen)} of {seen['passed']}")
        lines.append(f"| {method} | {' | '.join(cells)} |")
    return [*lines, ""]


def severity_of(corruption: str, kind: str) -> float:
    """The share in a recipe; 0 for clean."""
    return float(corruption.removeprefix(f"{kind}:")) if corruption != "clean" else 0.0


def knee(found: Study, kind: str, said: str) -> list[str]:
    """Up to where each method recognises nine of ten."""
    lines = [said, ""]
    for method in dict.fromkeys(group.axes["variant"] for group in found.groups):
        good = 0.0
        broken = None
        for severity, group in sorted(
            ((severity_of(g.axes["corruption"], kind), g) for g in found.groups if g.axes["variant"] == method),
            key=lambda pair: pair[0],
        ):
            seen = None if group.metrics is None else group.metrics["recognition"]
            if seen is None or not seen["passed"] or seen["rate"] < _GOOD_RATE:
                broken = severity
                break
            good = severity
        until = f"at least {percent(_GOOD_RATE, 0)} % recognised up to {100 * good:g} %"
        if broken == 0.0:
            until = f"below {percent(_GOOD_RATE, 0)} % already without"
        lines.append(
            f"* {method}: {until}{f', less at {100 * broken:g} %' if broken else '' if broken == 0.0 else ', the most tried'}."
        )
    return [*lines, ""]


def draw_rates(
    of: Mapping[tuple[str, float], Group], methods: Sequence[str], severities: Sequence[float], kind: str, path: Path
) -> None:
    """Recognition against severity, one curve a method."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    axes = figure.add_subplot()
    for number, method in enumerate(methods):
        mine = {severity: [of[method, severity]] for severity in severities if (method, severity) in of}
        style = {"color": _COLOURS[number % len(_COLOURS)], "linestyle": ("-", "--", "-.", ":")[number % 4]}
        draw_curve(axes, mine, "recognition", method, style, 0.004 * (number - 1))
    axes.axvline(
        0.25 if kind == "random_pixels" else 0.7,
        color="#666666",
        linewidth=0.9,
        linestyle=(0, (1, 2)),
        label="up to here, says the paper",
    )
    axes.set_ylim(-0.03, 1.03)
    axes.set_xlabel({"random_pixels": "share of random pixels", "bars": "share of columns occluded"}[kind])
    axes.set_ylabel("places recognised")
    axes.grid(True, alpha=0.25, linewidth=0.5)
    axes.legend(fontsize=8, frameon=False, loc="lower left")
    save_png(figure, path)
