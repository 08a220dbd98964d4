"""The ROS 2 transport: rclpy on any RMW, tried with Fast DDS on ROS 2 Jazzy."""

from transports.ros2.transport import Ros2Transport, connect

__all__ = ["Ros2Transport", "connect"]
