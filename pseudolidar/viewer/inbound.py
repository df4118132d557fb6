"""What a browser may say: known messages with values of the right kind, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pseudolidar.viewer.checks import (
    LARGEST,
    Check,
    is_count,
    is_direction,
    is_number,
    is_pixels,
    is_png_within,
    is_text,
    is_turn,
    one_of,
    or_none,
    vector,
    vectors,
    within,
)

# The longest message of a browser but pictures that it was asked for.
MESSAGE_BYTES = 65_536
# A picture that a browser was asked for. A screen of 5120x2880 has 14.7 million pixels; as many as
# these hold 64 MiB when they are decoded.
PICTURE_BYTES, MOST_PICTURE_PX = 32 << 20, 1 << 24

_MODIFIER = or_none(is_text)
_PLACE = vector(3)
_POSE: dict[str, Check] = {"wxyz": is_turn, "position": _PLACE}

# Fields of the messages that are let in, by type. What is not here is refused: requests for public
# tunnels, files that nobody asked for, drags of what cannot be dragged.
FIELDS: Mapping[str, Mapping[str, Check]] = {
    "ViewerCameraMessage": {
        **_POSE,
        "fov": within(0, math.pi),
        "near": within(0, LARGEST),
        "far": within(0, LARGEST),
        "image_height": is_pixels,
        "image_width": is_pixels,
        "look_at": _PLACE,
        "up_direction": is_direction,
    },
    "ScenePointerMessage": {
        "event_type": one_of("click", "rect-select"),
        "ray_origin": or_none(_PLACE),
        "ray_direction": or_none(is_direction),
        "screen_pos": vectors(2, 2),
        "modifier": _MODIFIER,
    },
    "SceneNodeClickMessage": {
        "name": is_text,
        "instance_index": or_none(is_count),
        "ray_origin": _PLACE,
        "ray_direction": is_direction,
        "screen_pos": vector(2),
        "modifier": _MODIFIER,
        "owner": is_text,
    },
    "TransformControlsUpdateMessage": {"name": is_text, **_POSE, "owner": is_text},
    "TransformControlsDragStartMessage": {"name": is_text, "owner": is_text},
    "TransformControlsDragEndMessage": {"name": is_text, "owner": is_text},
    "CommandTriggerMessage": {"uuid": is_text},
    "GuiUpdateMessage": {"uuid": is_text, "updates": lambda value: isinstance(value, dict)},
    "GetRenderResponseMessage": {
        "payload": is_png_within(MOST_PICTURE_PX),
        "render_uuid": is_text,
    },
}


Bound = float | Sequence[float] | None


@dataclass(frozen=True)
class Control:
    """What a control of the page is, to judge values for it by.

    Args:
        value: what it has now: a new one has the same type.
        least: smallest number, or one for each of a vector's; None without such.
        most: largest number, or likewise; None without such.
        options: words to choose from; None without such.
    """

    value: Any
    least: Bound = None
    most: Bound = None
    options: tuple[str, ...] | None = None

    def takes(self, value: Any) -> bool:
        """Whether a browser may set it to this."""
        if isinstance(self.value, bool):
            return isinstance(value, bool)
        if isinstance(self.value, str):
            return is_text(value) and (self.options is None or value in self.options)
        if isinstance(self.value, int | float):
            return self._in_range(value, 0)
        if isinstance(self.value, tuple):
            right = vector(len(self.value))(value)
            return right and all(self._in_range(one, place) for place, one in enumerate(value))
        return False

    def _in_range(self, value: Any, place: int) -> bool:
        least, most = _at(self.least, place, -LARGEST), _at(self.most, place, LARGEST)
        return is_number(value) and least <= value <= most


def _at(bound: Bound, place: int, none: float) -> float:
    if bound is None:
        return none
    return bound[place] if isinstance(bound, Sequence) else bound


def fault_of(
    message: Any, size: int, control_of: Callable[[str], Control | None], *, pictures_due: int
) -> str:
    """Why a message is not let in.

    Args:
        message: decoded, of any shape.
        size: bytes of it.
        control_of: the control with an identity; None where there is none.
        pictures_due: how many pictures browsers were asked for and have not sent yet.

    Returns:
        One line; "" where it may pass.
    """
    if not isinstance(message, dict) or not isinstance(message.get("type"), str):
        return "no message"
    kind = message["type"]
    fields = FIELDS.get(kind)
    if fields is None:
        return f"a message {kind[:40]!r}, which is not taken"
    is_picture = kind == "GetRenderResponseMessage"
    if is_picture and pictures_due < 1:
        return "a picture that nobody asked for"
    if size > (PICTURE_BYTES if is_picture else MESSAGE_BYTES):
        return f"{size} bytes in {kind}"
    given = {name for name in message if name != "type"}
    if given - set(fields):
        return f"{kind} with a field more"
    wrong = [name for name in fields if name in message and not fields[name](message[name])]
    missing = [name for name in fields if name not in message and name != "owner"]
    if wrong or missing:
        return f"{kind}.{(wrong or missing)[0]} of the wrong kind"
    if kind == "GuiUpdateMessage":
        return _fault_of_update(message["uuid"], message["updates"], control_of)
    if kind == "ScenePointerMessage" and not _is_whole(message):
        return f"{message['event_type']} without its places"
    return ""


def _is_whole(pointed: Mapping[str, Any]) -> bool:
    """Whether a click has a line of sight and a place, and a rectangle two corners."""
    if pointed["event_type"] == "click":
        ray = pointed["ray_origin"], pointed["ray_direction"]
        return None not in ray and len(pointed["screen_pos"]) == 1
    return len(pointed["screen_pos"]) == 2


def _fault_of_update(
    uuid: str, updates: Mapping[Any, Any], control_of: Callable[[str], Control | None]
) -> str:
    # viser would set any attribute of a control, its callbacks included.
    if set(updates) != {"value"}:
        return "an update of something other than a value"
    control = control_of(uuid)
    if control is None:
        return "an update of no control"
    return "" if control.takes(updates["value"]) else "a value that its control does not have"
