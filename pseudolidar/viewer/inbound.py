"""What a browser may say: known messages with values of the right kind, and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

# The longest message of a browser but pictures that it was asked for, and the longest text in it.
MESSAGE_BYTES, TEXT_LENGTH = 65_536, 4096
# A picture that a browser was asked for.
PICTURE_BYTES = 32 << 20
# Coordinates and sizes beyond are no view of anything.
LARGEST = 1e12

Check = Callable[[Any], bool]


def is_text(value: Any) -> bool:
    """Text of a length that somebody types."""
    return isinstance(value, str) and len(value) <= TEXT_LENGTH


def is_number(value: Any) -> bool:
    """A finite number; true and false are none."""
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= LARGEST  # which NaN is not
    )


def is_count(value: Any) -> bool:
    """A whole number, not negative."""
    return is_number(value) and isinstance(value, int) and value >= 0


def vector(length: int) -> Check:
    """So many finite numbers."""
    return lambda value: (
        isinstance(value, list | tuple) and len(value) == length and all(map(is_number, value))
    )


def vectors(length: int, most: int) -> Check:
    """At most so many vectors."""
    one = vector(length)
    return lambda value: (
        isinstance(value, list | tuple) and len(value) <= most and all(map(one, value))
    )


def one_of(*choices: str) -> Check:
    """One of these words."""
    return lambda value: isinstance(value, str) and value in choices


def or_none(check: Check) -> Check:
    """That, or nothing."""
    return lambda value: value is None or check(value)


_MODIFIER = or_none(is_text)
_RAY = vector(3)
_POSE: dict[str, Check] = {"wxyz": vector(4), "position": vector(3)}

# Fields of the messages that are let in, by type. What is not here is refused: requests for public
# tunnels, files that nobody asked for, drags of what cannot be dragged.
FIELDS: Mapping[str, Mapping[str, Check]] = {
    "ViewerCameraMessage": {
        **_POSE,
        "fov": is_number,
        "near": is_number,
        "far": is_number,
        "image_height": is_count,
        "image_width": is_count,
        "look_at": vector(3),
        "up_direction": vector(3),
    },
    "ScenePointerMessage": {
        "event_type": one_of("click", "rect-select"),
        "ray_origin": or_none(_RAY),
        "ray_direction": or_none(_RAY),
        "screen_pos": vectors(2, 2),
        "modifier": _MODIFIER,
    },
    "SceneNodeClickMessage": {
        "name": is_text,
        "instance_index": or_none(is_count),
        "ray_origin": _RAY,
        "ray_direction": _RAY,
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
        "payload": lambda value: isinstance(value, bytes),
        "render_uuid": is_text,
    },
}


@dataclass(frozen=True)
class Control:
    """What a control of the page is, to judge values for it by.

    Args:
        value: what it has now: a new one has the same type.
        least: smallest number; None without such.
        most: largest number; None without such.
        options: words to choose from; None without such.
    """

    value: Any
    least: float | None = None
    most: float | None = None
    options: tuple[str, ...] | None = None

    def takes(self, value: Any) -> bool:
        """Whether a browser may set it to this."""
        if isinstance(self.value, bool):
            return isinstance(value, bool)
        if isinstance(self.value, str):
            return is_text(value) and (self.options is None or value in self.options)
        if isinstance(self.value, int | float):
            return self._in_range(value)
        if isinstance(self.value, tuple):
            return vector(len(self.value))(value) and all(map(self._in_range, value))
        return False

    def _in_range(self, value: Any) -> bool:
        return (
            is_number(value)
            and (self.least is None or value >= self.least)
            and (self.most is None or value <= self.most)
        )


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
    return ""


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
