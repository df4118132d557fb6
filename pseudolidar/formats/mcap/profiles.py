"""The profiles there are, loaded when they are wanted."""

from __future__ import annotations

from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.mcap.profile import Profile


def profile_of(content: McapContent) -> Profile:
    """The profile that the settings name."""
    return profile_of_header("ros2" if content.profile == "ros2" else "")


def profile_of_header(header: str) -> Profile:
    """The profile of a file whose header names it so."""
    if header == "ros2":
        from pseudolidar.formats.mcap.ros2 import ROS2

        return ROS2
    from pseudolidar.formats.mcap.foxglove import FOXGLOVE

    return FOXGLOVE
