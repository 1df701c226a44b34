"""A run in the Rerun viewer, live or as a file; needs the extra ``rerun``.

On the timelines ``image`` (all images of the run, one sequence after the other) and ``stamp`` (their time stamps):

========================  ==============================================================================
``map/references``        where the references were taken
``map/graph/...``         relative poses between keyframes: of neighbours, of places met again, and contradicted by the others
``map/moved``             from where references were given to where they are
``map/votes``             the places, coloured by the votes of their best heading
``robot/particles``       a few thousand of them at most
``robot/estimate``        pose as an arrow; ``robot/truth`` likewise
``camera/panorama``       what the robot sees; ``camera/best_reference`` likewise
``votes/field``           the vote field, headings by places
``scalars/...``           N_eff, particles, spread, votes, errors, milliseconds
``status``                what the localizer thinks of itself, as text
========================  ==============================================================================
"""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import OutputError
from panoloc_mcl.robot.geometry import FloatArray, angle_difference
from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.tools.evaluation import SequenceRecord
from panoloc_mcl.tools.report.mending import LINES, line_kinds
from panoloc_mcl.tools.report.results.recording import thinned
from panoloc_mcl.tools.report.sinks import Departure, Frame, Scene

if TYPE_CHECKING:
    import rerun

_MOST_PARTICLES = 3000
_BLUE, _ORANGE, _RED, _GREY, _INK = (0, 114, 178), (230, 159, 0), (213, 94, 0), (136, 136, 136), (240, 240, 240)
_GREEN = (0, 158, 115)


class RerunSink:
    """Streams a run to a viewer, or into a file.

    Parameters
    ----------
    path : Path, optional
        An ``.rrd`` file; without one a viewer is started.

    Raises
    ------
    OutputError
        Rerun is not installed, the file cannot be written, or there is no display for a viewer.
    """

    def __init__(self, path: Path | None = None) -> None:
        if importlib.util.find_spec("rerun") is None:
            raise OutputError('--rerun: rerun is not installed; pip install "panoloc-mcl[rerun]"')
        import rerun

        self._rr = rerun
        self._stream = _stream_to(rerun, path)
        self._images: tuple[int, ...] = ()
        self._begun = -1

    def open(self, scene: Scene) -> None:
        """Show the map."""
        self._images = scene.images
        self._positions = _flat(scene.references.positions)
        self._places = _flat(scene.places.positions)
        self._size = scene.places.spacing
        self._references = scene.references.pixels
        points = self._rr.Points3D(
            self._positions, colors=_GREY, radii=0.04, labels=list(scene.references.names), show_labels=False
        )
        self._stream.log("map/references", points, static=True)
        if scene.keyframes is not None:
            self._log_graph(scene.keyframes)

    def begin(self, departure: Departure) -> None:
        """Show the belief before the first image."""
        self._begun += 1
        self._sequence = departure.name
        self._at(0)
        self._log_particles(departure.particles, departure.weights)
        self._stream.log("status", self._rr.TextLog(f"{departure.name}, run {departure.run}: begins"))

    def take(self, frame: Frame) -> None:
        """Show one image and what became of it."""
        rr, estimate, state = self._rr, frame.estimate, frame.estimate.state
        self._at(frame.index + 1)
        self._stream.set_time("stamp", timestamp=estimate.timestamp)
        self._log_particles(frame.particles, frame.weights)
        self._stream.log("robot/estimate", self._arrow(estimate.pose, _RED))
        if frame.panorama is not None:
            self._stream.log("camera/panorama", rr.Image(frame.panorama).compress())
        if 0 <= estimate.best_place < len(self._references):
            self._stream.log("camera/best_reference", rr.Image(self._references[estimate.best_place]).compress())
        votes = estimate.vote_field
        if votes is not None:
            best = votes.best_of_places
            self._stream.log("map/votes", rr.Points3D(self._places, colors=_shades(best), radii=0.4 * self._size))
            in_bytes = np.rint(255.0 * votes.votes / max(float(best.max()), 1e-12)).astype(np.uint8)
            self._stream.log("votes/field", rr.Tensor(in_bytes, dim_names=("heading", "place")))
        self._log_scalars(
            {
                "n_eff": state.effective_count,
                "particles": state.particle_count,
                "spread_m": estimate.clusters[0].spread_m,
                "best_place_votes": state.best_place_votes,
                "step_ms": sum(estimate.stage_ms.values()),
            }
        )
        if frame.truth is not None:
            self._stream.log("robot/truth", self._arrow(frame.truth, _INK))
            heading = abs(float(np.degrees(angle_difference(estimate.pose[2], frame.truth[2]))))
            position = float(np.hypot(*(estimate.pose[:2] - frame.truth[:2])))
            self._log_scalars({"position_error_m": position, "heading_error_deg": heading})
        text = f"{self._sequence}: {estimate.status.value}" + (f" ({estimate.message})" if estimate.message else "")
        self._stream.log("status", rr.TextLog(text))

    def end(self, record: SequenceRecord) -> None:
        """Nothing: the next sequence follows on the same timeline."""

    def close(self) -> None:
        """Hand over all that is still on its way."""
        self._stream.flush()
        self._stream.disconnect()

    def _log_graph(self, keyframes: Keyframes) -> None:
        """Relative poses as lines by kind, and how far references were moved."""
        at, edges, kinds = _flat(keyframes.poses[:, :2]), keyframes.edges, line_kinds(keyframes)
        for kind, (name, color) in enumerate(zip(LINES, (_GREY, _GREEN, _RED), strict=True)):
            lines = np.stack([at[edges.first], at[edges.second]], axis=1)[kinds == kind]
            if len(lines):
                strips = self._rr.LineStrips3D(lines, colors=color, radii=0.004)
                self._stream.log(f"map/graph/{name.replace(' ', '_')}", strips, static=True)
        moved = keyframes.moved_m > 0.0
        if moved.any() and not any(keyframes.drives):
            given = _flat(keyframes.given[:, :2])
            arrows = self._rr.Arrows3D(origins=given[moved], vectors=(at - given)[moved], colors=_ORANGE, radii=0.008)
            self._stream.log("map/moved", arrows, static=True)

    def _at(self, image: int) -> None:
        self._stream.set_time("image", sequence=sum(self._images[: self._begun]) + self._begun + image)

    def _log_particles(self, particles: FloatArray, weights: FloatArray) -> None:
        shown = thinned(particles, weights, min(len(particles), _MOST_PARTICLES))
        self._stream.log("robot/particles", self._rr.Points3D(_flat(shown[:, :2]), colors=_ORANGE, radii=0.02))

    def _log_scalars(self, values: dict[str, float]) -> None:
        for name, value in values.items():
            if np.isfinite(value):
                self._stream.log(f"scalars/{name}", self._rr.Scalars(float(value)))

    def _arrow(self, pose: FloatArray, color: tuple[int, int, int]) -> Any:
        tip = [0.5 * np.cos(pose[2]), 0.5 * np.sin(pose[2]), 0.0]
        return self._rr.Arrows3D(origins=[[pose[0], pose[1], 0.02]], vectors=[tip], colors=color, radii=0.03)


def _stream_to(rr: Any, path: Path | None) -> rerun.RecordingStream:
    if path is None and sys.platform.startswith("linux") and not {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ):
        raise OutputError("--rerun: no display for the viewer; name a file to look at elsewhere: --rerun FILE.rrd")
    stream = rr.RecordingStream("panoloc")
    try:
        if path is None:
            stream.spawn(default_blueprint=_blueprint())
            return stream
        if path.suffix != ".rrd":
            raise OutputError(f"--rerun {path}: Rerun's files end in .rrd; name one of these")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("wb").close()
        stream.save(path, default_blueprint=_blueprint())
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error}); choose another file with --rerun") from error
    except RuntimeError as error:
        raise OutputError(f"--rerun: {error}; name a file instead: --rerun FILE.rrd") from error
    return stream


def _blueprint() -> Any:
    import rerun.blueprint as blueprint

    pictures = blueprint.Vertical(
        blueprint.Spatial2DView(origin="camera/panorama", name="panorama"),
        blueprint.Spatial2DView(origin="camera/best_reference", name="best reference"),
        blueprint.TensorView(origin="votes/field", name="votes: headings by places"),
        blueprint.TimeSeriesView(origin="scalars", name="scalars"),
    )
    scene = blueprint.Spatial3DView(origin="/", contents=["map/**", "robot/**"], name="map")
    return blueprint.Blueprint(blueprint.Horizontal(scene, pictures))


def _flat(points: NDArray[Any]) -> NDArray[np.float32]:
    """Points of the plane (n, 2) in space (n, 3)."""
    return np.column_stack([points, np.zeros(len(points))]).astype(np.float32)


def _shades(votes: NDArray[Any]) -> NDArray[np.uint8]:
    """Blue, the brighter the more votes: uint8 (k, 4)."""
    shares = np.asarray(votes, dtype=np.float64) / max(float(votes.max()), 1e-12)
    colors = np.empty((len(votes), 4), dtype=np.uint8)
    colors[:, :3] = _BLUE
    colors[:, 3] = np.rint(20 + 235 * shares**2)
    return colors
