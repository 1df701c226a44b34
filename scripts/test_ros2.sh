#!/usr/bin/env bash
# The ROS 2 node for real: a virtual environment of its own with rclpy from the registry (unofficial wheels, for tests alone),
# the node in one process, a robot in another. Words after the script go on to pytest.
set -euo pipefail

root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
venv="${PANOLOC_ROS_VENV:-$root/.venv_ros}"
python="${PANOLOC_PYTHON:-python3}"
if ! "$python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))'; then
    echo "test_ros2: the wheels of rclpy are for Python 3.11, this is $("$python" --version); set PANOLOC_PYTHON" >&2
    exit 2
fi
[[ -x "$venv/bin/python" ]] || "$python" -m venv "$venv"
if ! "$venv/bin/python" -c 'import rclpy, pytest, rosbags, panoloc_mcl' 2>/dev/null; then
    echo "installing into $venv"
    "$venv/bin/pip" install -q 'ros-rclpy[fastrtps]' ros-sensor-msgs ros-nav-msgs ros-geometry-msgs ros-std-srvs \
        ros-diagnostic-msgs ros-lifecycle-msgs pytest "$root[bags]"
fi
# Only this machine hears it, and nobody else's robots are heard.
export ROS_LOCALHOST_ONLY=1 ROS_DOMAIN_ID="${ROS_DOMAIN_ID:-$((RANDOM % 100 + 1))}"
export PYTHONPATH="$root/ros2/panoloc_ros:$root"
cd "$root/ros2/panoloc_ros"
exec "$venv/bin/python" -m pytest -q -p no:cacheprovider test "$@"
