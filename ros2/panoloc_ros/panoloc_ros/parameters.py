"""The node's parameters: AMCL's names where they mean the same, with ranges, on top of a configuration file of panoloc_mcl."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.settings.localizer import InitialPose
from panoloc_mcl.robot.settings.validation import read_yaml, validate

# AMCL's alphas are variances a squared metre or radian; those of panoloc_mcl are standard deviations.
_ALPHAS = {
    "alpha1": ("rotation_noise_from_rotation", "heading noise from turns"),
    "alpha2": ("rotation_noise_from_translation", "heading noise from the way driven"),
    "alpha3": ("translation_noise_from_translation", "position noise from the way driven"),
    "alpha4": ("translation_noise_from_rotation", "position noise from turns"),
    "alpha5": ("strafe_noise_from_translation", "sideways noise from the way driven (omnidirectional robots)"),
}
_TEXTS = {
    "map_file": ("", "Map, from: panoloc build-map"),
    "config_file": ("", "YAML with any keys of panoloc_mcl's localizer (observation, localizer, seed)"),
    "camera_file": ("", "camera.yaml of the robot's camera; empty = the camera that the map was made with"),
    "state_file": ("", "Where the state is kept that the next start goes on from; empty = nowhere"),
    "base_frame_id": ("base_link", "Frame of the robot's base"),
    "odom_frame_id": ("odom", "Frame of odometry"),
    "global_frame_id": ("map", "Frame of the map"),
}


class Parameters:
    """Declares the parameters and reads them.

    Parameters
    ----------
    node : Node
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        for name, (default, text) in _TEXTS.items():
            self._declare(name, default, text)
        self._declare("tf_broadcast", True, "Whether to publish the transform from the map to odometry's frame")
        self._declare("odometry_from_tf", False, "Take odometry from the transform odom to base_link instead of a topic")
        self._number("transform_tolerance", 0.1, 0.0, 10.0, "How far into the future the transform is stamped, s")
        self._number("save_pose_rate", 0.5, 0.0, 10.0, "How often the state is saved, 1/s; 0 = only at the end")
        self._number("missing_after", 5.0, 0.1, 3600.0, "After so long without images or odometry that is said, s")
        # Below, -1 (and 0 particles): what the configuration file says.
        self._number("update_min_d", -1.0, -1.0, 1e3, "Way after which an image counts, m; 0 with update_min_a 0 = every image")
        self._number("update_min_a", -1.0, -1.0, 2 * math.pi, "Turn after which an image counts, radians")
        for name, (_, text) in _ALPHAS.items():
            self._number(name, -1.0, -1.0, 100.0, f"Variance: {text}")
        self._declare("robot_model_type", "", "differential or omnidirectional; nav2's names of its models are understood, too")
        self._integer("random_seed", -1, -1, 2**62, "Seed of everything random; -1 = the configuration's")
        self._integer("max_particles", 0, 0, 10**7, "Particles; 0 = the configuration's")
        self._declare("set_initial_pose", False, "Whether initial_pose is where the robot starts")
        for axis in ("x", "y", "yaw"):
            self._number(f"initial_pose.{axis}", 0.0, -1e8, 1e8, "Metres and radians, map frame")

    def __getitem__(self, name: str) -> Any:
        return self._node.get_parameter(name).value

    def path(self, name: str) -> Path | None:
        """A file that a parameter names; None if it is empty."""
        return Path(self[name]).expanduser() if self[name] else None

    def config(self) -> LocalizerConfig:
        """The localizer's configuration.

        Raises
        ------
        ConfigError
            The file cannot be used.
        """
        file = self.path("config_file")
        known = {"observation", "localizer", "seed"}
        # A configuration of `panoloc run` or `live` serves, too.
        data = {} if file is None else {key: value for key, value in read_yaml(file).items() if key in known}
        config = validate(LocalizerConfig, data, str(file) if file is not None else "configuration")
        localizer = config.localizer
        motion = {key: math.sqrt(self[name]) for name, (key, _) in _ALPHAS.items() if self[name] >= 0.0}
        if self["robot_model_type"]:
            motion["model"] = "omnidirectional" if "omni" in self["robot_model_type"].lower() else "differential"
        gate = {}
        if self["update_min_d"] >= 0.0:
            gate["distance_m"] = self["update_min_d"]
        if self["update_min_a"] >= 0.0:
            gate["angle_deg"] = math.degrees(self["update_min_a"])
        changed: dict[str, Any] = {
            "motion": localizer.motion.model_copy(update=motion),
            "gate": localizer.gate.model_copy(update=gate),
        }
        if self["max_particles"]:
            changed["monte_carlo"] = localizer.monte_carlo.model_copy(update={"particles": max(10, self["max_particles"])})
        if self["set_initial_pose"]:
            x, y, yaw = (self[f"initial_pose.{axis}"] for axis in ("x", "y", "yaw"))
            changed["initial"] = InitialPose(x=x, y=y, heading_deg=math.degrees(yaw))
        seed = config.seed if self["random_seed"] < 0 else self["random_seed"]
        return config.model_copy(update={"seed": seed, "localizer": localizer.model_copy(update=changed)})

    def _declare(self, name: str, default: Any, text: str, **limits: Any) -> None:
        self._node.declare_parameter(name, default, ParameterDescriptor(description=text, **limits))

    def _number(self, name: str, default: float, least: float, most: float, text: str) -> None:
        self._declare(name, default, text, floating_point_range=[FloatingPointRange(from_value=least, to_value=most, step=0.0)])

    def _integer(self, name: str, default: int, least: int, most: int, text: str) -> None:
        self._declare(name, default, text, integer_range=[IntegerRange(from_value=least, to_value=most, step=0)])
