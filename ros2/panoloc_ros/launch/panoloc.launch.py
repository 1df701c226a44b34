"""Starts the node, configures and activates it: ``ros2 launch panoloc_ros panoloc.launch.py map_file:=hall.panomap``."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.conditions import IfCondition
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode, Node
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.substitutions import FindPackageShare
from lifecycle_msgs.msg import Transition


def generate_launch_description() -> LaunchDescription:
    """The node, its first two transitions, and RViz if that is wanted."""
    share = FindPackageShare("panoloc_ros")
    node = LifecycleNode(
        package="panoloc_ros",
        executable="panoloc_node",
        name="panoloc",
        namespace="",
        output="screen",
        parameters=[
            LaunchConfiguration("params_file"),
            {"map_file": LaunchConfiguration("map_file"), "use_sim_time": LaunchConfiguration("use_sim_time")},
        ],
        remappings=[("image", LaunchConfiguration("image")), ("odom", LaunchConfiguration("odom"))],
    )
    configure = EmitEvent(
        event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=Transition.TRANSITION_CONFIGURE)
    )
    activate = RegisterEventHandler(
        OnStateTransition(
            target_lifecycle_node=node,
            start_state="configuring",
            goal_state="inactive",
            entities=[
                EmitEvent(
                    event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=Transition.TRANSITION_ACTIVATE)
                )
            ],
        )
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", PathJoinSubstitution([share, "rviz", "panoloc.rviz"])],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("map_file", description="Map, from: panoloc build-map"),
            DeclareLaunchArgument("params_file", default_value=PathJoinSubstitution([share, "config", "panoloc.yaml"])),
            DeclareLaunchArgument("image", default_value="image"),
            DeclareLaunchArgument("odom", default_value="odom"),
            DeclareLaunchArgument("use_sim_time", default_value="false"),
            DeclareLaunchArgument("rviz", default_value="false"),
            node,
            activate,
            configure,
            rviz,
        ]
    )
