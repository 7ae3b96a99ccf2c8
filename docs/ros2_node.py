"""A ROS 2 node: sensed routes in; tension, elongation and the command that reaches a target out.

It needs rclpy, the usual messages and tssgeom in one Python:

    python3 ros2_node.py --ros-args -p rig:=rig.toml -p unit:=mm -r shape:=/fibre/shape -r drive:=/motor/state

| topic | type | content |
|---|---|---|
| `shape` | geometry_msgs/PoseArray | positions along the route, proximal to distal, in `unit` |
| `drive` | sensor_msgs/JointState | optional: `effort` is the tension [N], or `position` [m], of the tendon |
| `target` | std_msgs/Float64 | optional: position of the distal end that is wanted [m] |
| `tendon` | sensor_msgs/JointState | the results, under the header of their shape: `NAMES` |

The parameters are those that `Tendon` declares.
"""

import math

import numpy as np
import rclpy
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from tssgeom import Engine, Frame, Rejected, Rig, read_rig

NAMES = ("proximal", "distal", "elongation", "elongation_se", "command")
"""What `tendon` has a position [m] and an effort [N] of; NaN where there is none."""


class Tendon(Node):
    """Carries one tendon from shape to shape."""

    def __init__(self):
        super().__init__("tssgeom")
        rig = self.declare_parameter("rig", "").value  # a file; without one the paper's rig
        unit = self.declare_parameter("unit", "m").value  # m by REP 103; many drivers send mm
        self.field = self.declare_parameter("drive_field", "effort").value  # or position
        self.joint = self.declare_parameter("drive_joint", "").value  # without one the first
        without_drive = self.declare_parameter("tension_in_N", 15.0).value
        self.engine = Engine(read_rig(rig) if rig else Rig(), tension_in=without_drive)
        self.per_metre = {"m": 1.0, "mm": 1000.0}[unit]
        self.drive = self.target = None
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(PoseArray, "shape", self.take_shape, newest)
        self.create_subscription(JointState, "drive", self.take_drive, newest)
        self.create_subscription(Float64, "target", self.take_target, newest)
        self.results = self.create_publisher(JointState, "tendon", 1)

    def take_drive(self, message):
        """Keep the newest reading of the drive, for the next shape."""
        values = dict(zip(message.name, getattr(message, self.field), strict=False))
        self.drive = values.get(self.joint or next(iter(values), ""), self.drive)
        if values and self.drive is None:
            text = f"drive_joint {self.joint!r} is not among {list(values)}: the drive is not read"
            self.get_logger().warning(text, throttle_duration_sec=1.0)

    def take_target(self, message):
        """Keep the newest target, for the next shape [m]."""
        self.target = message.data

    def take_shape(self, message):
        """Carry the tendon over a shape and publish the results."""
        points = [(pose.position.x, pose.position.y, pose.position.z) for pose in message.poses]
        stamp = message.header.stamp
        frame = Frame(
            np.reshape(points, (-1, 3)) / self.per_metre,
            stamp.sec + 1e-9 * stamp.nanosec,
            tension_in=self.drive if self.field == "effort" else None,
            displacement_in=self.drive if self.field == "position" else None,
            displacement_target=self.target,
        )
        result = self.engine.push(frame)
        if isinstance(result, Rejected):
            self.get_logger().warning(result.reason, throttle_duration_sec=1.0)
            return
        of = result.transmission
        rows = (
            (of.displacement_in, of.tension_in),
            (of.displacement_out, of.tension_out),
            (of.elongation, None),
            (of.elongation_se, None),
            (result.displacement_command, result.tension_command),
        )
        position, effort = zip(*(map(_number, row) for row in rows), strict=True)
        self.results.publish(
            JointState(
                header=message.header,
                name=list(NAMES),
                position=list(position),
                velocity=[],
                effort=list(effort),
            )
        )
        if result.warnings:
            self.get_logger().warning("; ".join(result.warnings), throttle_duration_sec=1.0)
        self.engine.idle()


def _number(value):
    return math.nan if value is None else float(value)


def main():
    """Run the node until it is interrupted."""
    rclpy.init()
    node = Tendon()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
