"""MCAP recordings: written, read, checked, recovered; profiles for Foxglove and ROS 2."""
