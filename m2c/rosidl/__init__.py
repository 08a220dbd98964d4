"""ROS interface packages: building them with colcon against the pip-installed ROS 2 wheels."""
