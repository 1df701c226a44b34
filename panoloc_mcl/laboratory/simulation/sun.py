"""Where the sun stands."""

from __future__ import annotations

import math

from panoloc_mcl.laboratory.simulation.scene import Light, Scene, Site
from panoloc_mcl.robot.errors import ConfigError


def sun_direction(site: Site, time_h: float) -> tuple[float, float, float]:
    """Unit vector towards the sun, map frame, from latitude, day and true solar time (Cooper 1969 for the declination)."""
    declination = math.radians(23.45) * math.sin(2.0 * math.pi * (284 + site.day_of_year) / 365.0)
    latitude, hour = math.radians(site.latitude_deg), math.radians(15.0 * (time_h - 12.0))
    east = -math.cos(declination) * math.sin(hour)
    north = math.cos(latitude) * math.sin(declination) - math.sin(latitude) * math.cos(declination) * math.cos(hour)
    up = math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(hour)
    turn = math.radians(site.north_deg - 90.0)
    return (
        east * math.cos(turn) - north * math.sin(turn),
        east * math.sin(turn) + north * math.cos(turn),
        up,
    )


def elevation_deg(site: Site, time_h: float) -> float:
    """Elevation of the sun above the horizon, degrees."""
    return math.degrees(math.asin(max(-1.0, min(1.0, sun_direction(site, time_h)[2]))))


def light_of(scene: Scene, name: str, key: str = "light") -> Light:
    """A light of a scene; ``key`` says in a message who asks for it.

    Raises
    ------
    ConfigError
        No such light; the sun below the horizon where its light or the sky's is asked for; nothing that shines.
    """
    if name not in scene.lights:
        raise ConfigError(f"{key} = '{name}': scene '{scene.name}' has no such light; known: {', '.join(scene.lights)}")
    light = scene.lights[name]
    height = elevation_deg(scene.site, light.time_h)
    if (light.sun > 0.0 or light.sky > 0.0) and height <= 0.0:
        raise ConfigError(
            f"lights.{name}.time_h = {light.time_h:g}: the sun is {-height:.1f} degrees below the horizon; "
            "choose another time, or set sun and sky to 0 and lamps above 0"
        )
    lamps = any(thing.kind == "lamp" for thing in scene.objects)
    if light.sun == 0.0 and light.sky == 0.0 and not (lamps and light.lamps > 0.0):
        raise ConfigError(f"lights.{name}: nothing shines; raise sky or sun, or lamps in a scene that has some")
    return light
