"""Boxes of the objects over the pictures: a click on one chooses it."""

from __future__ import annotations

import json
from collections.abc import Mapping

from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.panels.obstacles import ObstaclesPanel
from pseudolidar.viewer.panels.picture import PicturePanel
from pseudolidar.viewer.view import View

# The picture with a geometry of its own; all others are drawn over the left one.
RIGHT = "right"


class PictureBoxes:
    """Answers what the page of the pictures asks.

    Args:
        view: what is looked at.
        picture: shows the boxes.
        obstacles: knows them.
    """

    def __init__(self, view: View, picture: PicturePanel, obstacles: ObstaclesPanel) -> None:
        self._obstacles = obstacles
        picture.show_boxes(lambda: obstacles.version)
        view.server.pages |= {"/picture/boxes": self._boxes, "/picture/choose": self._choose}

    def _boxes(self, query: Mapping[str, str]) -> Answer:
        """Those over one of the pictures of the shown frame."""
        boxes = self._obstacles.in_picture(right=query.get("kind") == RIGHT)
        fields = {
            "chosen": self._obstacles.scene.chosen,
            "boxes": [one.fields for one in boxes],
        }
        return Answer(json.dumps(fields).encode())

    def _choose(self, query: Mapping[str, str]) -> Answer:
        self._obstacles.choose(query.get("key", ""))
        return Answer(b"{}")
