"""What browsers may say, message by message."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.viewer.checks import PNG_START, TEXT_LENGTH
from pseudolidar.viewer.inbound import MESSAGE_BYTES, MOST_PICTURE_PX, Control, fault_of
from tests.viewer.clients import CAMERA

CONTROLS = {
    "slider": Control(5, 0, 10),
    "number": Control(0.5),
    "check": Control(True),
    "text": Control("a"),
    "choice": Control("a", options=("a", "b")),
    "vector": Control((0.0, 1.0), 0.0, 1.0),
    "range": Control((0.0, 1.0), 0.0, 9.0, rising=True),
}
HANDLES = {"/box": Control((0.0, 0.0, 0.0), (-1.0, -1.0, -1.0), (1.0, 1.0, 2.0))}
TOUCHABLE = SimpleNamespace(control=CONTROLS.get, handle=HANDLES.get)


def fault(message: object, size: int = 100, due: int = 0) -> str:
    found = fault_of(message, size, TOUCHABLE, pictures_due=due)
    return "" if found is None else found.words


def drag(name: str, *position: float) -> dict[str, object]:
    turned = {"wxyz": [1.0, 0.0, 0.0, 0.0], "position": list(position), "owner": ""}
    return {"type": "TransformControlsUpdateMessage", "name": name} | turned


def click(**changes: object) -> dict[str, object]:
    where = {"ray_origin": [0.0] * 3, "ray_direction": [1.0, 0, 0], "screen_pos": [[0.5, 0.5]]}
    return (
        {"type": "ScenePointerMessage", "event_type": "click", "modifier": None} | where | changes
    )


def update(uuid: object, **updates: object) -> dict[str, object]:
    return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates}


@pytest.mark.parametrize(
    "message",
    [
        CAMERA,
        update("slider", value=7),
        update("slider", value=7.5),
        update("number", value=-3),
        update("check", value=False),
        update("text", value="b" * TEXT_LENGTH),
        update("choice", value="b"),
        update("vector", value=[0.0, 1.0]),
        update("range", value=[2.0, 2.0]),
        {"type": "CommandTriggerMessage", "uuid": "x"},
        click(),
        click(modifier="cmd/ctrl+shift"),
        drag("/box", 0.5, -1.0, 2.0),
        {"type": "TransformControlsDragEndMessage", "name": "/box", "owner": ""},
    ],
)
def test_what_a_browser_says_passes(message: dict[str, object]):
    assert fault(message) == ""


@pytest.mark.parametrize(
    "message",
    [
        None,
        [],
        "text",
        {},
        {"type": 3},
        {"type": "ShareUrlRequest"},
        {"type": "RunJavascriptMessage", "source": "alert(1)"},
        {"type": "FileTransferStartUpload", "filename": "../x"},
        {"type": "ViewerCameraMessage"},
        CAMERA | {"fov": math.nan},
        CAMERA | {"fov": "1"},
        CAMERA | {"near": True},
        CAMERA | {"position": [0.0, 0, math.inf]},
        CAMERA | {"position": [0.0, 0]},
        CAMERA | {"position": [0.0, 0, 1e30]},
        CAMERA | {"image_width": -1},
        CAMERA | {"image_width": 1.5},
        CAMERA | {"more": 1},
        update("slider", value=11),
        update("slider", value=-1),
        update("slider", value="7"),
        update("slider", value=True),
        update("slider", value=math.nan),
        update("slider", value=None),
        update("slider", update_cb=[]),
        update("slider", value=7, visible=False),
        update("slider"),
        update("number", value=10**400),
        update("check", value=1),
        update("text", value=3),
        update("text", value="b" * (TEXT_LENGTH + 1)),
        update("choice", value="c"),
        update("vector", value=[0.0, 2.0]),
        update("vector", value=[0.0, 1.0, 1.0]),
        update("vector", value="01"),
        update("range", value=[3.0, 2.0]),
        update("nobody", value=1),
        click(event_type="rect-select", screen_pos=[[0.1, 0.1], [0.2, 0.2]]),
        click(screen_pos=[]),
        click(screen_pos=[[0.1, 0.1], [0.2, 0.2]]),
        click(ray_origin=None),
        click(ray_direction=[0.0, 0.0, 0.0]),
        click(modifier="shift+alt+shift"),
        {"type": "SceneNodeClickMessage", "name": "/box"},
        drag("/box", 0.0, 0.0, 2.1),
        drag("/box", 0.0, 0.0),
        drag("/map", 0.0, 0.0, 0.0),
        {"type": "TransformControlsDragStartMessage", "name": "/map", "owner": ""},
        update(3, value=1),
    ],
)
def test_what_no_browser_of_ours_says_is_refused(message: object):
    assert fault(message)


def test_nobody_is_blamed_for_what_was_there_a_moment_ago():
    for message in (update("nobody", value=1), drag("/map", 0.0, 0.0, 0.0)):
        late = fault_of(message, 100, TOUCHABLE, pictures_due=0)
        assert late is not None
        assert late.late
    for message in (
        update("slider", value=11),
        update("nobody", value=1, more=1),
        drag("/box", 9, 9, 9),
    ):
        wrong = fault_of(message, 100, TOUCHABLE, pictures_due=0)
        assert wrong is not None
        assert not wrong.late


def test_long_messages_are_refused_except_pictures_that_were_asked_for():
    picture = {"type": "GetRenderResponseMessage", "payload": png(600, 800), "render_uuid": "a"}
    assert fault(CAMERA, MESSAGE_BYTES + 1)
    assert fault(picture, 10)
    assert fault(picture, MESSAGE_BYTES + 1, due=1) == ""


def png(height: int, width: int) -> bytes:
    """How a picture begins."""
    return PNG_START + width.to_bytes(4, "big") + height.to_bytes(4, "big") + b"\x08\x06\0\0\0"


def test_pictures_begin_as_they_are_made_here():
    begun = encode_png(np.zeros((3, 5, 3), np.uint8))
    assert begun.startswith(png(3, 5)[:24])


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"x",
        "text",
        png(600, 800)[:17],
        png(0, 800),
        png(5000, 5000),
        png(1, MOST_PICTURE_PX + 1),
        b"\xff\xd8\xff" + png(600, 800),
    ],
)
def test_pictures_of_many_pixels_or_of_another_kind_are_not_decoded(payload: object):
    picture = {"type": "GetRenderResponseMessage", "payload": payload, "render_uuid": "a"}
    assert "payload" in fault(picture, due=1)


def test_ten_thousand_mangled_messages_get_a_word_and_no_exception():
    rng = np.random.default_rng(5)
    pieces = [None, True, -1, 2**70, 1e300, math.nan, "", "a" * 9999, b"", [], {}, [[[]]], {1: 2}]
    messages = [CAMERA, update("slider", value=7), update("vector", value=[0.0, 1.0])]
    passed = 0
    for _ in range(10_000):
        message = dict(messages[rng.integers(len(messages))])
        key = list(message)[rng.integers(len(message))]
        message[key] = pieces[rng.integers(len(pieces))]
        passed += fault(message) == ""
    # Small whole numbers fit where heights and the like are wanted.
    assert passed < 500
