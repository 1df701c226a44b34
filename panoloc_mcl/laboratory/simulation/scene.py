"""Scenes as data: what stands where, what it is made of, what shines on it. Read from YAML."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.settings.validation import StrictModel, parse_yaml, read_yaml, validate

Positive = Annotated[float, Field(gt=0.0, le=1000.0)]
Coordinate = Annotated[float, Field(ge=-1e4, le=1e4)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Point = tuple[Coordinate, Coordinate, Coordinate]
Place = tuple[Coordinate, Coordinate, Coordinate, float]
Rectangle = tuple[Coordinate, Coordinate, Coordinate, Coordinate]
Size = tuple[Positive, Positive, Positive]
Pattern = Literal["plain", "speckle", "tiles", "bricks", "boards", "stripes", "poster", "books", "text", "field"]
MESH_ENDINGS = (".glb", ".gltf", ".obj", ".ply", ".stl")


class Material(StrictModel):
    """A matt surface: the share of the light it reflects, and a pattern drawn in it."""

    albedo: Annotated[float, Field(ge=0.0, le=0.95)] = 0.5
    pattern: Pattern = "plain"
    contrast: Share = 0.5
    scale_m: Positive = 0.3


class Opening(StrictModel):
    """A window or door in a wall; ``at_m`` is the distance of its left edge from where the wall begins."""

    at_m: Annotated[float, Field(ge=0.0)]
    width_m: Positive
    bottom_m: Annotated[float, Field(ge=0.0)] = 0.0
    height_m: Positive
    bars: Annotated[int, Field(ge=0, le=20)] = 0


class Thing(StrictModel):
    """What all things have in common. ``places`` lists ``[x, y, z, yaw_deg]``; z is that of the underside."""

    material: str = "white"
    places: Annotated[tuple[Place, ...], Field(min_length=1)] = ((0.0, 0.0, 0.0, 0.0),)
    movable: bool = False


class Wall(StrictModel):
    """An upright wall from one point on the floor to another."""

    kind: Literal["wall"]
    start: tuple[Coordinate, Coordinate]
    end: tuple[Coordinate, Coordinate]
    height_m: Positive
    thickness_m: Positive = 0.1
    material: str = "white"
    openings: tuple[Opening, ...] = ()
    coarse: bool = False


class Ground(StrictModel):
    """A level rectangle that is seen from above: a floor, or from below: a ceiling."""

    kind: Literal["floor", "ceiling"]
    area: Rectangle
    z: Coordinate = 0.0
    material: str = "white"
    coarse: bool = False
    field: Rectangle | None = None


class Box(Thing):
    """A box; also a panel, a cupboard, a beam."""

    kind: Literal["box"]
    size_m: Size
    coarse: bool = False


class Cylinder(Thing):
    """An upright cylinder, such as a post; rings of another material if wanted."""

    kind: Literal["cylinder"]
    radius_m: Positive
    height_m: Positive
    rings: tuple[str, ...] = ()


class Table(Thing):
    """A top on four legs."""

    kind: Literal["table"]
    size_m: Size = (1.4, 0.7, 0.74)


class Chair(Thing):
    """Seat, back and four legs."""

    kind: Literal["chair"]


class Shelf(Thing):
    """Boards with things between them."""

    kind: Literal["shelf"]
    size_m: Size = (0.9, 0.32, 1.9)
    boards: Annotated[int, Field(ge=2, le=12)] = 5


class Stairs(Thing):
    """Steps that climb along x."""

    kind: Literal["stairs"]
    steps: Annotated[int, Field(ge=2, le=60)] = 14
    step_m: Size = (0.28, 1.0, 0.18)


class Goal(Thing):
    """A goal as of 2004: two side walls, a back and a roof; open towards +x of its place."""

    kind: Literal["goal"]
    size_m: Size = (0.5, 2.0, 1.0)
    inside: str = "dark"


class Clutter(StrictModel):
    """Boxes of all sizes strewn over a rectangle, the same for the same seed."""

    kind: Literal["clutter"]
    area: Rectangle
    z: Coordinate = 0.0
    count: Annotated[int, Field(ge=1, le=2000)]
    seed: Annotated[int, Field(ge=0)] = 0
    size_m: tuple[Positive, Positive] = (0.15, 0.6)
    materials: Annotated[tuple[str, ...], Field(min_length=1)]
    movable: bool = False


class Pane(StrictModel):
    """A pane of milky glass in the roof: light that falls on it from outside leaves it inside to all sides."""

    kind: Literal["pane"]
    corner: Point
    along: Point
    across: Point
    transmittance: Share = 0.05


class Lamp(StrictModel):
    """Lamps that shine downwards from their undersides."""

    kind: Literal["lamp"]
    places: Annotated[tuple[Place, ...], Field(min_length=1)]
    size_m: tuple[Positive, Positive] = (1.2, 0.3)
    lumen: Annotated[float, Field(gt=0.0, le=1e6)] = 4000.0


class Mesh(StrictModel):
    """A mesh of the user's, from a glTF, OBJ, PLY or STL file; a relative path starts from the scene's file."""

    kind: Literal["mesh"]
    file: Path
    scale: Positive = 1.0
    place: Place = (0.0, 0.0, 0.0, 0.0)
    y_up: bool = False
    albedo: Annotated[float, Field(ge=0.0, le=0.95)] | None = None


_KINDS = (
    "wall",
    "floor",
    "ceiling",
    "box",
    "cylinder",
    "table",
    "chair",
    "shelf",
    "stairs",
    "goal",
    "clutter",
    "pane",
    "lamp",
    "mesh",
)


def _kind_tag(value: Any) -> str | None:
    kind = value.get("kind") if isinstance(value, Mapping) else getattr(value, "kind", None)
    return ("Ground" if kind in ("floor", "ceiling") else str(kind).capitalize()) if kind in _KINDS else None


Object = Annotated[
    Annotated[Wall, Tag("Wall")]
    | Annotated[Ground, Tag("Ground")]
    | Annotated[Box, Tag("Box")]
    | Annotated[Cylinder, Tag("Cylinder")]
    | Annotated[Table, Tag("Table")]
    | Annotated[Chair, Tag("Chair")]
    | Annotated[Shelf, Tag("Shelf")]
    | Annotated[Stairs, Tag("Stairs")]
    | Annotated[Goal, Tag("Goal")]
    | Annotated[Clutter, Tag("Clutter")]
    | Annotated[Pane, Tag("Pane")]
    | Annotated[Lamp, Tag("Lamp")]
    | Annotated[Mesh, Tag("Mesh")],
    Discriminator(_kind_tag, custom_error_type="object_kind", custom_error_message=f"kind must be one of {', '.join(_KINDS)}"),
]


class Light(StrictModel):
    """What shines: the sun and the sky of a time of day, and lamps.

    ``time_h`` is true solar time (12 = the sun stands highest). ``sun`` and ``sky`` dim a clear sky's; a sun behind clouds
    is 0. ``lamps`` is the share of their full power.
    """

    time_h: Annotated[float, Field(ge=0.0, lt=24.0)] = 12.0
    sun: Annotated[float, Field(ge=0.0, le=2.0)] = 1.0
    sky: Annotated[float, Field(ge=0.0, le=5.0)] = 1.0
    turbidity: Annotated[float, Field(ge=1.0, le=10.0)] = 3.0
    lamps: Share = 0.0


class Site(StrictModel):
    """Where on Earth, which day, and which way is north."""

    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 47.07
    day_of_year: Annotated[int, Field(ge=1, le=366)] = 170
    north_deg: float = Field(90.0, description="Direction of north in the map, counter-clockwise from x.")
    ground_albedo: Share = 0.2


class Places(StrictModel):
    """Where references are taken: a grid over rectangles; what is too near to something is left out."""

    areas: Annotated[tuple[Rectangle, ...], Field(min_length=1)]
    step_m: Positive = 1.0
    heading_deg: float = 0.0


class Scene(StrictModel):
    """A world."""

    name: Annotated[str, Field(min_length=1)]
    description: str = ""
    site: Site = Site()
    window_transmittance: Share = 0.3
    lights: Annotated[dict[str, Light], Field(min_length=1)]
    materials: Annotated[dict[str, Material], Field(default_factory=dict)]
    places: Places
    drive: Annotated[tuple[Rectangle, ...], Field(min_length=1)]
    clearance_m: Positive = 0.25
    objects: Annotated[tuple[Object, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _materials_are_known(self) -> Scene:
        for index, thing in enumerate(self.objects):
            for name in _materials_of(thing):
                if name not in self.materials:
                    known = ", ".join(sorted(self.materials))
                    raise ValueError(f"objects.{index} ({thing.kind}): unknown material '{name}'; known: {known}")
        return self


def _materials_of(thing: Any) -> list[str]:
    names = [getattr(thing, name) for name in ("material", "inside") if hasattr(thing, name)]
    return [*names, *getattr(thing, "rings", ()), *getattr(thing, "materials", ())]


SHIPPED = ("hall", "office", "closet")


def load_scene(name_or_path: str | Path, relative_to: Path | None = None) -> tuple[Scene, Path]:
    """A scene that comes with the package, by its name, or one of the user's: a YAML file, or a mesh as it is.

    Parameters
    ----------
    name_or_path : str or Path
        ``hall``, ``office``, or a path.
    relative_to : Path, optional
        Folder that relative paths start from if they do not from the working directory.

    Returns
    -------
    (Scene, Path)
        And the folder that paths of meshes in it start from.

    Raises
    ------
    ConfigError
        No such scene; or one line for each fault in it.
    """
    if str(name_or_path) in SHIPPED:
        source = files("panoloc_mcl.laboratory.simulation") / "scenes" / f"{name_or_path}.yaml"
        text = source.read_text(encoding="utf-8")
        return validate(Scene, parse_yaml(text, f"scene {name_or_path}"), f"scene {name_or_path}"), Path()
    path = Path(name_or_path).expanduser()
    if not path.exists() and relative_to is not None:
        path = relative_to / path
    if not path.is_file():
        raise ConfigError(f"scene = '{name_or_path}': no such scene; known: {', '.join(SHIPPED)}, or the path of a YAML file")
    if path.suffix.lower() in MESH_ENDINGS:
        raise ConfigError(
            f"scene = '{name_or_path}': is a mesh; write a scene of a few lines around it (lights, places, and an object of kind mesh)"
        )
    return validate(Scene, read_yaml(path), str(path)), path.parent
