"""What a browser may say: known messages with values of the right kind, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any, Protocol

from pseudolidar.viewer.checks import (
    LARGEST,
    Check,
    is_direction,
    is_number,
    is_pixels,
    is_png_within,
    is_text,
    is_turn,
    one_of,
    only,
    or_none,
    vector,
    within,
)

# The longest message of a browser but pictures that it was asked for.
MESSAGE_BYTES = 65_536
# A picture that a browser was asked for. A screen of 5120x2880 has 14.7 million pixels; as many as
# these hold 64 MiB when they are decoded.
PICTURE_BYTES, MOST_PICTURE_PX = 32 << 20, 1 << 24

# Keys that are held with a click, as viser's page says it.
_KEYS = ("cmd/ctrl", "alt", "shift")
_MODIFIER = or_none(one_of(*("+".join(held) for n in (1, 2, 3) for held in combinations(_KEYS, n))))
_PLACE = vector(3)
_POSE: dict[str, Check] = {"wxyz": is_turn, "position": _PLACE}

# Fields of the messages that are let in, by type. What is not here is refused: requests for public
# tunnels, files that nobody asked for, clicks and drags that no panel listens to.
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
        "event_type": one_of("click"),
        "ray_origin": _PLACE,
        "ray_direction": is_direction,
        "screen_pos": only(vector(2)),
        "modifier": _MODIFIER,
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

DRAGS = frozenset(kind for kind in FIELDS if kind.startswith("TransformControls"))

Bound = float | Sequence[float] | None


@dataclass(frozen=True)
class Control:
    """What a control of the page is, to judge values for it by.

    Args:
        value: what it has now: a new one has the same type.
        least: smallest number, or one for each of a vector's; None without such.
        most: largest number, or likewise; None without such.
        options: words to choose from; None without such.
        rising: whether the numbers of a vector are in order.
    """

    value: Any
    least: Bound = None
    most: Bound = None
    options: tuple[str, ...] | None = None
    rising: bool = False

    def takes(self, value: Any) -> bool:
        """Whether a browser may set it to this."""
        if isinstance(self.value, bool):
            return isinstance(value, bool)
        if isinstance(self.value, str):
            return is_text(value) and (self.options is None or value in self.options)
        if isinstance(self.value, int | float):
            return self._in_range(value, 0)
        if isinstance(self.value, tuple):
            right = vector(len(self.value))(value) and not (self.rising and _falls(value))
            return right and all(self._in_range(one, place) for place, one in enumerate(value))
        return False

    def _in_range(self, value: Any, place: int) -> bool:
        least, most = _at(self.least, place, -LARGEST), _at(self.most, place, LARGEST)
        return is_number(value) and least <= value <= most


def _at(bound: Bound, place: int, none: float) -> float:
    if bound is None:
        return none
    return bound[place] if isinstance(bound, Sequence) else bound


def _falls(values: Sequence[float]) -> bool:
    return any(before > after for before, after in pairwise(values))


class Touchable(Protocol):
    """What of a page somebody can touch now."""

    def control(self, uuid: str) -> Control | None:
        """The control with that identity; None where there is none, or it is not to be seen."""

    def handle(self, name: str) -> Control | None:
        """The place (3,) of a node that can be dragged; None where there is none of that name."""


@dataclass(frozen=True)
class Fault:
    """Why a message is not let in.

    Args:
        words: one line.
        late: whether it is of something that was there a moment ago, perhaps: browsers say such
            things while the page changes, and are not blamed for it.
    """

    words: str
    late: bool = False


def fault_of(message: Any, size: int, touchable: Touchable, *, pictures_due: int) -> Fault | None:
    """Why a message is not let in; None where it may pass.

    Args:
        message: decoded, of any shape.
        size: bytes of it.
        touchable: what can be touched.
        pictures_due: how many pictures browsers were asked for and have not sent yet.
    """
    words = _fault_of_form(message, size, pictures_due)
    if words:
        return Fault(words)
    if message["type"] == "GuiUpdateMessage":
        return _fault_of_update(message["updates"], touchable.control(message["uuid"]))
    if message["type"] in DRAGS:
        return _fault_of_drag(message, touchable.handle(message["name"]))
    return None


def _fault_of_form(message: Any, size: int, pictures_due: int) -> str:
    """What is wrong with a message, whatever it is about; "" for nothing."""
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
    return ""


def _fault_of_update(updates: Mapping[Any, Any], control: Control | None) -> Fault | None:
    # viser would set any attribute of a control, its callbacks included.
    if set(updates) != {"value"}:
        return Fault("an update of something other than a value")
    if control is None:
        return Fault("an update of no control", late=True)
    fits = control.takes(updates["value"])
    return None if fits else Fault("a value that its control does not have")


def _fault_of_drag(message: Mapping[str, Any], handle: Control | None) -> Fault | None:
    if handle is None:
        return Fault("a drag of nothing", late=True)
    fits = "position" not in message or handle.takes(message["position"])
    return None if fits else Fault("a drag to where nothing goes")
