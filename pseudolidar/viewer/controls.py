"""Controls of a page that are set from here."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from viser import GuiInputHandle

Value = TypeVar("Value")


def set_value(control: GuiInputHandle[Value], value: Value) -> None:
    """Show another value; what listens to the control is told, as if a person had set it."""
    control.value = value  # type: ignore[misc] # viser has a setter that mypy does not see
