"""The graph of keyframes in the report."""

import json

import numpy as np
import pytest

from panoloc_mcl.robot.map.keyframes import IMAGES, LOOP, Edges, Keyframes
from panoloc_mcl.tools.report.mending import LINES, drawn_graph, graph_lines, line_kinds
from panoloc_mcl.tools.report.pages import plotly_script
from panoloc_mcl.tools.report.results.renewal import rewrite_figures
from panoloc_mcl.tools.report.results.results_reader import read_results


def keyframes(moved: float = 0.0) -> Keyframes:
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    surveyed = Keyframes.surveyed(("a.png", "b.png", "c.png"), poses)
    edges = Edges(
        np.array([0, 1, 0]),
        np.array([1, 2, 2]),
        np.zeros((3, 3)),
        np.tile(np.eye(3), (3, 1, 1)),
        np.array([IMAGES, LOOP, LOOP]),
        np.array([1.0, 0.9, 0.2]),
    )
    given = poses.copy()
    given[2, 0] += moved
    return surveyed.__class__(**{**vars(surveyed), "edges": edges, "given": given})


def test_relative_poses_are_drawn_by_what_became_of_them() -> None:
    assert [LINES[kind] for kind in line_kinds(keyframes())] == ["relative pose", "met again", "contradicted"]
    assert drawn_graph(keyframes()) == {
        "lines": {"relative pose": [[0, 1]], "met again": [[1, 2]], "contradicted": [[0, 2]]},
        "moved": [],
    }
    graph = drawn_graph(keyframes(moved=0.2))
    assert graph is not None
    assert graph["moved"] == [[2, 1.2, 1.0]]
    assert drawn_graph(Keyframes.surveyed(("a.png",), np.zeros((1, 3)))) is None


@pytest.mark.skipif(not plotly_script.can_plot(), reason="plotly is not installed")
def test_the_report_of_a_folder_draws_them_again(finished) -> None:
    folder, metrics = finished
    path = folder / "run.json"
    info = json.loads(path.read_text())
    path.write_text(json.dumps({**info, "map": dict(graph_lines(keyframes())), "graph": drawn_graph(keyframes())}))
    rewrite_figures(read_results(folder), metrics)
    page = (folder / "report.html").read_text()
    assert '"met again":[[1,2]]' in page
    assert "3, surveyed" in page
