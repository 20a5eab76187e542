"""A ROS 2 node that listens to a robot's bus and publishes its joints and IMU.

It sends no commands, so it can run next to another process's loop or the vendor's own.
ROS 2 (rclpy) is imported only when the node runs; without it this file says so.

    ros2 run ... or: python examples/ros2_node.py unitree_g1 eth0
"""

import sys

from wbc.hardware.ros import fill, imu, joint_state
from wbc.hardware.setup import Where
from wbc.hardware.unitree import profile_named
from wbc.robot import Robot

PERIOD = 0.002  # s


def main(name: str = "unitree_g1", interface: str = "lo") -> None:
    """Publish until the node is shut down."""
    try:
        import rclpy
        from sensor_msgs.msg import Imu, JointState
    except ImportError:
        sys.exit("ROS 2 is not here: source its setup.bash first")
    profile = profile_named(name)
    robot = Robot.load(profile.model)
    bus = Where("unitree", interface).open(profile, robot)
    rclpy.init()
    node = rclpy.create_node("wbc_readings")
    joints = node.create_publisher(JointState, "joint_states", 10)
    imus = node.create_publisher(Imu, "imu", 10)

    def publish() -> None:
        reading = bus.read()
        if reading is not None:
            joints.publish(fill(JointState(), joint_state(robot, reading)))
            imus.publish(fill(Imu(), imu(reading)))

    node.create_timer(PERIOD, publish)
    rclpy.spin(node)


if __name__ == "__main__":
    main(*sys.argv[1:3])
