"""ROS without ROS: messages, their definitions, bags."""
