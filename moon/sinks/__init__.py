"""Where verdicts go: a topic, a file, ROS 2's diagnostics."""
