"""Ground, rings and scale bar in an app, without a browser."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.controls import set_value
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.stills import StillCloud
from tests.viewer.clients import wait_until
from tests.viewer.test_filming import Frames


def switch(app: App, label: str) -> Any:
    (found,) = [
        one
        for one in app.view.gui._gui_input_handle_from_uuid.values()
        if getattr(one._impl.props, "label", "").startswith(label)
    ]
    return found


def test_rings_and_grid_lie_on_the_ground_below_the_rig_and_are_switched():
    with App.made(Address(port=0), Opened((Frames(),))) as app:
        app.view.start()
        wait_until(lambda: app.view.moment is not None)
        wait_until(lambda: app.ground._below_m is not None)
        assert app.ground.level_m == pytest.approx(-0.95, abs=0.06)  # of 0.1 m of ground
        for label, nodes in (("Rings", "_rings"), ("Ground grid", "_grid")):
            box = switch(app, label)
            assert getattr(app.ground, nodes) is None  # nothing is sent before it is wanted
            for shown in (True, False, True):
                set_value(box, shown)
                wait_until(
                    lambda name=nodes, now=shown: (
                        getattr(app.ground, name) is not None  # type: ignore[misc]
                        and getattr(app.ground, name).visible is now
                    )
                )
        below_m = app.ground._below_m
        assert below_m is not None
        assert app.ground._rings.position[2] == pytest.approx(below_m + 0.1)
        assert app.ground._grid.position[2] == pytest.approx(below_m)
        set_value(switch(app, "Scale bar"), False)
        wait_until(lambda: app.ruler._shown is False)


def test_the_grid_of_a_map_has_cells_of_its_size_at_its_ground():
    rng = np.random.default_rng(0)
    far = np.array([4.5e5, 5.4e6, 300.0])
    xyz = far + rng.uniform((-400, -400, 0), (400, 400, 0.5), (4000, 3))
    still = StillCloud("map", PointCloud(xyz, "map"))
    with App.made(Address(port=0), Opened(stills=(still,))) as app:
        assert app.ground.title == "Ground grid, 10 m and 100 m"
        assert not switch(app, "Rings").visible
        assert abs(app.ground.level_m) < 0.3
        app.ground.show_grid(shown=True)
        assert abs(app.ground._grid.position[2]) < 0.3


def test_nothing_open_has_a_ground_at_0():
    with App.made(Address(port=0), Opened()) as app:
        assert app.ground.level_m == 0
        app.ground.show_grid(shown=True)
