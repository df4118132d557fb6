"""What panels say and do, without a browser."""

from __future__ import annotations

import socket

import numpy as np
import pytest

from pseudolidar.viewer import app as whole
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.live_reel import LiveReel
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.panels.help import keys, listed
from pseudolidar.viewer.panels.run import NOTHING, WAITING
from pseudolidar.viewer.stills import StillPath
from tests.viewer.clients import wait_until
from tests.viewer.test_filming import Frames


def test_help_lists_what_there_is():
    run, endless, frames = LiveReel("a run", 7), LiveReel("cameras"), Frames()
    assert listed(Opened((run,))) == "- a run: 7 frames"
    assert listed(Opened((endless,))) == "- cameras"
    assert listed(Opened((frames,))) == "- frames: 3 frames"
    assert "| F |" in keys(Opened((run,)))
    assert "play" not in keys(Opened((run,)))
    assert "play" in keys(Opened((frames,)))


def test_keys_that_help_lists_are_there():
    for opened in (Opened((LiveReel("a run"),)), Opened((Frames(),))):
        with App.made(Address(port=0), opened) as app:
            commands = app.view.gui._command_handle_from_uuid.values()
            listed_keys = [
                key
                for line in keys(opened).splitlines()[3:]
                if line.startswith("|")
                for key in line.split("|")[1].replace(" ", "").split(",")
            ]
            assert sorted(str(one._impl.props.hotkey) for one in commands) == sorted(listed_keys)


def test_the_key_and_the_box_follow_the_rig_together():
    with App.made(Address(port=0), Opened((Frames(),))) as app:
        gui, placement = app.view.gui, app.view.stage.placement
        (key,) = [
            one for one in gui._command_handle_from_uuid.values() if one._impl.props.hotkey == "F"
        ]
        (box,) = [
            one
            for one in gui._gui_input_handle_from_uuid.values()
            if getattr(one._impl.props, "label", "") == "Follow the rig"
        ]
        for following in (False, True):
            (trigger,) = key._impl.trigger_cb
            trigger(None)  # type: ignore[arg-type]
            wait_until(lambda now=following: placement.follow is now)  # type: ignore[misc]
            assert box.value is following


def test_a_run_that_makes_no_frame_says_so():
    reel = LiveReel("a run", 7)
    with App.made(Address(port=0), Opened((reel,))) as app:
        assert app.run is not None
        app.view.start()
        wait_until(lambda: app.view.moment is not None)
        assert app.run._text.content == WAITING
        reel.finished = True
        app.run.say()
        assert app.run._text.content == NOTHING
        assert "no new frame was made" in NOTHING


def test_a_viewer_that_cannot_be_made_serves_nothing(monkeypatch: pytest.MonkeyPatch):
    ports = list[int]()

    def faulty(view: object, *_: object) -> None:
        ports.append(view.server.guard.port)  # type: ignore[attr-defined]
        raise ValueError("odd")

    monkeypatch.setattr(whole, "HelpPanel", faulty)
    with pytest.raises(ValueError, match="odd"), App.made(Address(port=0), Opened()):
        pass
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", ports[0]), timeout=1)


def test_clouds_without_pictures_have_no_empty_frame_for_them():
    frames = Frames()
    with App.made(Address(port=0), Opened((frames,))) as app:
        app.view.show(frames.load(0))
        assert not app.picture._folder.visible


def test_paths_alone_are_looked_at_as_a_whole():
    places_m = np.array([[0.0, 0, 0], [200, 0, 0], [200, 100, 0]])
    with App.made(Address(port=0), Opened(stills=(StillPath("way", places_m),))) as app:
        camera = app.view.server.viser.initial_camera
        away_m = np.linalg.norm(np.subtract(camera.position, camera.look_at))
    assert away_m > 100
