import numpy as np
import pytest

from panoloc_mcl.robot.errors import OutputError, ResultsError
from panoloc_mcl.tools.report import figures
from panoloc_mcl.tools.report.figures import FORMATS
from panoloc_mcl.tools.report.figures.series import SERIES

pytestmark = pytest.mark.skipif(not figures.can_draw(), reason="matplotlib is not installed")


@pytest.fixture
def numbers():
    def make(record):
        return {
            name: np.linspace(1.0, 9.0, len(record)) for name in ("particles", "n_eff", "ms_observe", "ms_update", "ms_total")
        }

    return make


def boxes(figure):
    """Legends and axes as they are drawn, in pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    return [legend.get_window_extent(renderer) for legend in legends], [
        axes.get_window_extent(renderer) for axes in figure.axes
    ]


@pytest.mark.parametrize("with_truth", [True, False])
@pytest.mark.parametrize("name", [*SERIES, "trajectory", "errors", "overview"])
def test_axes_have_units_and_legends_cover_nothing(make_record, places, numbers, name, with_truth):
    record = make_record(with_truth=with_truth, kidnapped_at=12)
    if name == "errors" and not with_truth:
        with pytest.raises(ResultsError, match="no ground truth"):
            figures.draw_errors(record)
        return
    with figures.style(name):
        if name == "trajectory":
            figure = figures.draw_trajectory(record, places)
        elif name == "errors":
            figure = figures.draw_errors(record)
        elif name == "overview":
            figure = figures.draw_overview([record], places)
        else:
            figure = figures.draw_series(name, record, numbers(record))
        legends, drawn = boxes(figure)
    labels = [label for axes in figure.axes for label in (axes.get_xlabel(), axes.get_ylabel()) if label]
    assert labels
    assert all("[" in label or label == "particles" for label in labels)
    width, height = figure.get_size_inches() * figure.dpi
    for legend in legends:
        assert legend.x0 >= -1, "the legend is cut off"
        assert legend.x1 <= width + 1, "the legend is cut off"
        assert legend.y1 <= height + 1, "the legend is cut off"
        for axes in drawn:
            overlap = min(legend.x1, axes.x1) - max(legend.x0, axes.x0), min(legend.y1, axes.y1) - max(legend.y0, axes.y0)
            assert min(overlap) < 2.0, "the legend covers data"


def test_the_legend_of_the_status_has_the_colors_of_the_bars(make_record, numbers):
    from matplotlib.colors import to_hex

    from panoloc_mcl.tools.report.figures.style import STATUS_COLORS

    record = make_record()
    with figures.style():
        (legend,) = figures.draw_series("status", record, numbers(record)).legends
    shown = {
        text.get_text(): to_hex(patch.get_facecolor()) for text, patch in zip(legend.texts, legend.get_patches(), strict=True)
    }
    assert shown == {status: STATUS_COLORS[status] for status in set(record.status)}


def test_a_slow_first_image_does_not_flatten_the_others(make_record, numbers):
    record = make_record()
    steps = numbers(record)
    steps["ms_observe"][0] = 1385.0
    with figures.style():
        axes = figures.draw_series("stages", record, steps).axes[0]
    rest = (steps["ms_observe"] + steps["ms_update"])[1:]
    assert rest.max() < axes.get_ylim()[1] < 2.0 * rest.max()
    assert [text.get_text() for text in axes.texts] == ["↑ 1386 ms"]


@pytest.mark.parametrize("ending", FORMATS)
def test_a_single_frame_can_be_drawn(make_record, numbers, tmp_path, ending):
    record = make_record(n=2)
    with figures.style():
        for name in SERIES:
            figures.write_figure(figures.draw_series(name, record, numbers(record)), tmp_path / f"{name}{ending}")
            assert (tmp_path / f"{name}{ending}").stat().st_size > 1000


def test_other_endings_are_refused(make_record, places, tmp_path):
    with figures.style(), pytest.raises(OutputError, match=r"a\.bmp: pictures end in \.pdf"):
        figures.write_figure(figures.draw_trajectory(make_record(), places), tmp_path / "a.bmp")


def test_colors_of_the_statuses_differ_without_red_or_green():
    """As readers see them who lack the cones for red, or those for green."""
    from panoloc_mcl.tools.report.figures.style import STATUS_COLORS

    rgb = {name: np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255 for name, color in STATUS_COLORS.items()}
    # Viénot, Brettel & Mollon (1999), protanopes and deuteranopes, on linear RGB.
    for matrix in (
        np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]]),
        np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]),
    ):
        seen = {name: np.clip(matrix @ color**2.2, 0, 1) ** (1 / 2.2) for name, color in rgb.items()}
        names = list(seen)
        for i, one in enumerate(names):
            for other in names[i + 1 :]:
                assert np.linalg.norm(seen[one] - seen[other]) > 0.3, (one, other)
