"""A cloud that is not seen, so that browsers keep the compiled shader of those that are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from viser import SceneApi

NODE = "/kept_shader"
# Behind whatever a camera can see, m.
BEYOND_M = 1e7


def keep_shader(scene: SceneApi) -> None:
    """Draw two points where nobody looks.

    viser's page makes a new material for every cloud whose colours change, and three.js deletes a
    compiled shader with the last material that uses it: it was compiled anew for each frame of a
    sequence, most of the time of the page (docs/viewer.md). This cloud never changes.

    Args:
        scene: of all browsers.
    """
    points = np.full((2, 3), BEYOND_M, np.float32)  # beyond what float16 can hold
    colours = np.zeros((2, 3), np.uint8)  # one for each: a single colour is another shader
    scene.add_point_cloud(NODE, points, colours, precision="float32")
