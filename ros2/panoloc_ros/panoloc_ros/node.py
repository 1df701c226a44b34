"""The lifecycle node: images and odometry in; transform, pose, particles and diagnostics out."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry as RosOdometry
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage
from sensor_msgs.msg import Image as RosImage
from std_srvs.srv import Empty

from panoloc_mcl import Localizer, PanolocError, PanoramaMap, Status
from panoloc_mcl import Odometry as PanolocOdometry
from panoloc_mcl.robot.camera.files import read_camera
from panoloc_mcl.robot.interface.keeper import StateKeeper
from panoloc_mcl.tools.datasets.recordings.ros.transforms import mount_of
from panoloc_mcl.tools.live import Answer, Engine
from panoloc_ros.conversions import (
    given_covariance,
    image_of,
    odometry_of,
    pose_of,
    ros_covariance,
    ros_pose,
    stamp_of,
    transform,
)
from panoloc_ros.frames import Frames
from panoloc_ros.parameters import Parameters

_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
_ODOMETRY = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
_MOST_PARTICLES = 1000
_LEVELS = {Status.CONVERGED: DiagnosticStatus.OK, Status.LOST: DiagnosticStatus.ERROR}


class PanolocNode(LifecycleNode):
    """In AMCL's place: the same topics, frames, services and parameters where they mean the same."""

    def __init__(self, **options: Any) -> None:
        super().__init__("panoloc", **options)
        self.parameters = Parameters(self)
        self.localizer: Localizer | None = None
        self._engine: Engine | None = None
        self._keeper: StateKeeper | None = None
        # Where odometry's frame was when the pose was last known: it is held while the robot is lost.
        self._held: np.ndarray | None = None
        self._last: Answer | None = None
        self._mount_from_tf = False
        self._lock = threading.Lock()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load map, camera and saved state; topics and services are there, but nothing is worked off yet."""
        parameters = self.parameters
        try:
            file = parameters.path("map_file")
            if file is None:
                raise PanolocError("map_file: is not set; give a map, from: panoloc build-map")
            self._map, config = PanoramaMap.load(file), parameters.config()
            camera_file = parameters.path("camera_file")
            self._camera = self._map.camera if camera_file is None else read_camera(camera_file)
            self._mount_from_tf = self._camera.mount is None
            self.localizer = Localizer(self._map, config, camera=self._camera)
        except PanolocError as error:
            for fault in error.faults:
                self.get_logger().error(fault)
            return TransitionCallbackReturn.FAILURE
        self._keep_state()
        self._connect()
        return super().on_configure(state)

    def _keep_state(self) -> None:
        file, rate = self.parameters.path("state_file"), self.parameters["save_pose_rate"]
        if file is None or self.localizer is None:
            return
        self._keeper = StateKeeper(self.localizer, file, 1.0 / rate if rate > 0.0 else 1e9)
        if self._keeper.problem:
            self.get_logger().warning(self._keeper.problem)
        elif self._keeper.resumed:
            self.get_logger().info(f"goes on from {file}")

    def _connect(self) -> None:
        first, second, third = (MutuallyExclusiveCallbackGroup() for _ in range(3))
        heard = self._on_transform if self.parameters["odometry_from_tf"] else None
        self._frames = Frames(self, heard)
        self._pose = self.create_lifecycle_publisher(PoseWithCovarianceStamped, "pose", _LATCHED)
        self._particles = self.create_lifecycle_publisher(PoseArray, "particle_cloud", 1)
        self._diagnostics = self.create_lifecycle_publisher(DiagnosticArray, "/diagnostics", 10)
        sensor = qos_profile_sensor_data
        self._subscriptions_ = [
            self.create_subscription(RosImage, "image", self._on_image, sensor, callback_group=first),
            self.create_subscription(CompressedImage, "image/compressed", self._on_image, sensor, callback_group=first),
            self.create_subscription(RosOdometry, "odom", self._on_odometry, _ODOMETRY, callback_group=second),
            self.create_subscription(PoseWithCovarianceStamped, "initialpose", self._on_initial_pose, 1, callback_group=third),
        ]
        self._services_ = [
            self.create_service(Empty, "reinitialize_global_localization", self._on_reinitialize, callback_group=third),
            self.create_service(Empty, "request_nomotion_update", self._on_nomotion_update, callback_group=third),
        ]
        self._timer = self.create_timer(1.0, self._report, callback_group=third)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin."""
        assert self.localizer is not None
        done = super().on_activate(state)
        self._start_engine()
        if self._keeper is not None:
            self._keeper.__enter__()
        return done

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, and save the state."""
        self._stop()
        return super().on_deactivate(state)

    def _stop(self) -> None:
        engine, self._engine = self._engine, None
        if engine is not None:
            engine.stop()
        keeper, self._keeper = self._keeper, None
        if keeper is not None and engine is not None:
            keeper.__exit__(None, None, None)
            self._keep_state()

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the map; everything can be configured anew."""
        self._stop()
        for subscription in self._subscriptions_:
            self.destroy_subscription(subscription)
        for service in self._services_:
            self.destroy_service(service)
        self.destroy_timer(self._timer)
        self.localizer, self._held, self._last = None, None, None
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As deactivated."""
        self._stop()
        return super().on_shutdown(state)

    # What comes in.

    def _on_image(self, message: Any) -> None:
        engine = self._engine
        if engine is None:
            return
        if self._mount_from_tf:
            self._take_mount(message.header.frame_id)
        engine.put(image_of(message, "image"))

    def _take_mount(self, frame: str) -> None:
        """Where the camera sits, if tf says so; looked up until it does or the first image is answered."""
        base = self.parameters["base_frame_id"]
        found = self._frames.fixed.placed(base, frame.lstrip("/"))
        if found is None or self.localizer is None or self._last is not None:
            return
        self._mount_from_tf = False
        mount = mount_of(*found, frame)
        self.get_logger().info(f"camera at x {mount.x_m:.3f} m, y {mount.y_m:.3f} m, yaw {mount.yaw_deg:.1f} degrees, by tf")
        camera = self._camera.model_copy(update={"mount": mount})
        self._stop()
        self.localizer = Localizer(self._map, self.parameters.config(), camera=camera)
        self._keep_state()
        self._start_engine()

    def _start_engine(self) -> None:
        assert self.localizer is not None
        image, compressed, odom = (self.resolve_topic_name(name) for name in ("image", "image/compressed", "odom"))
        sources = f"image on {image} or {compressed}", f"odometry on {'/tf' if self.parameters['odometry_from_tf'] else odom}"
        missing, error = self.parameters["missing_after"], self.get_logger().error
        self._engine = Engine(self.localizer, [self], missing_after_s=missing, on_error=error, sources=sources)
        self._engine.__enter__()

    def _on_odometry(self, message: RosOdometry) -> None:
        odometry = odometry_of(message)
        if odometry is not None:
            self._take_odometry(odometry)

    def _on_transform(self, message: TransformStamped) -> None:
        names = (message.header.frame_id.lstrip("/"), message.child_frame_id.lstrip("/"))
        if names != (self.parameters["odom_frame_id"], self.parameters["base_frame_id"]):
            return
        move = message.transform
        found = pose_of(_Posed(move.translation, move.rotation))
        if found is not None:
            stamp = message.header.stamp
            self._take_odometry(PanolocOdometry((stamp.sec * 10**9 + stamp.nanosec) / 10**9, found))

    def _take_odometry(self, odometry: PanolocOdometry) -> None:
        engine, localizer = self._engine, self.localizer
        if engine is None or localizer is None:
            return
        if not engine.put(odometry):
            return
        frame = localizer.odometry_to_map(odometry.timestamp)
        with self._lock:
            if frame is not None and localizer.has_fix and (self._held is None or frame.status is Status.CONVERGED):
                self._held = frame.pose
            held = self._held
        if held is not None and self.parameters["tf_broadcast"]:
            stamp = stamp_of(odometry.timestamp + self.parameters["transform_tolerance"])
            self._frames.send(transform(self.parameters["global_frame_id"], self.parameters["odom_frame_id"], stamp, held))

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        pose = pose_of(message.pose.pose)
        if self.localizer is None or self._engine is None:
            self.get_logger().warning("initialpose: the node is not active; activate it first")
            return
        frame = message.header.frame_id.lstrip("/")
        if pose is None or frame not in ("", self.parameters["global_frame_id"]):
            self.get_logger().warning(
                f"initialpose: in frame '{frame}' or not a pose; give it in {self.parameters['global_frame_id']}"
            )
            return
        try:
            self.localizer.set_pose(pose, given_covariance(message))
            # Given by a person: odometry's frame follows at once.
            with self._lock:
                self._held = None
        except PanolocError as error:
            self.get_logger().warning(f"initialpose: {error}")

    def _on_reinitialize(self, request: Any, response: Any) -> Any:
        if self.localizer is not None:
            self.localizer.relocalize()
        return response

    def _on_nomotion_update(self, request: Any, response: Any) -> Any:
        if self.localizer is not None:
            self.localizer.force_update()
        return response

    # What goes out: the node is an output of the engine.

    def answered(self, answer: Answer) -> None:
        """Publish pose and particles."""
        estimate, self._last = answer.estimate, answer
        header_frame, stamp = self.parameters["global_frame_id"], stamp_of(answer.image.timestamp)
        pose = PoseWithCovarianceStamped()
        pose.header.frame_id, pose.header.stamp = header_frame, stamp
        pose.pose.pose, pose.pose.covariance = ros_pose(estimate.pose), ros_covariance(estimate.covariance)
        if self.localizer is not None and self.localizer.has_fix:
            self._pose.publish(pose)
        assert self.localizer is not None
        poses, _ = self.localizer.particles
        cloud = PoseArray()
        cloud.header.frame_id, cloud.header.stamp = header_frame, stamp
        cloud.poses = [ros_pose(one) for one in poses[:: max(1, -(-len(poses) // _MOST_PARTICLES))]]
        self._particles.publish(cloud)

    def moved(self, robot: Any, odometry: Any) -> None:
        """The transform goes out where odometry comes in."""

    def close(self) -> None:
        """Nothing is held open."""

    def _report(self) -> None:
        engine, last = self._engine, self._last
        if engine is None:
            return
        figures = engine.figures()
        status = DiagnosticStatus(name="panoloc: localization", hardware_id="camera")
        status.level = DiagnosticStatus.WARN if last is None else _LEVELS.get(last.estimate.status, DiagnosticStatus.WARN)
        status.message = f"{figures.status}: {figures.message}" if figures.message else figures.status
        if "no image on" in figures.message or "no odometry on" in figures.message:
            status.level = max(status.level, DiagnosticStatus.WARN)
            self.get_logger().warning(figures.message, throttle_duration_sec=10.0)
        values = {
            "status": figures.status,
            "match": math.nan if last is None else last.estimate.state.match,
            "age of the last image, s": figures.image_age_s,
            "age of the last odometry, s": figures.odometry_age_s,
            "latency, ms": figures.latency_ms,
            "work, ms": figures.step_ms,
            "images": figures.images,
            "images dropped": figures.dropped,
        }
        texts = {key: f"{value:.3f}" if isinstance(value, float) else str(value) for key, value in values.items()}
        status.values = [KeyValue(key=key, value=text) for key, text in texts.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)


class _Posed:
    """A transform's parts under the names of a pose's."""

    def __init__(self, position: Any, orientation: Any) -> None:
        self.position, self.orientation = position, orientation


def main(arguments: list[str] | None = None) -> None:
    """Spin the node; callbacks of images, odometry and services each in a thread of their own."""
    rclpy.init(args=arguments)
    node = PanolocNode()
    executor = MultiThreadedExecutor(num_threads=4)
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node._stop()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
