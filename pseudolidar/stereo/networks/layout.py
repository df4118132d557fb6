"""How a network's inputs are fed and its output is read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

from pseudolidar.errors import ModelError
from pseudolidar.formats.onnx.description import (
    as_flags,
    check_choices,
    filled,
    json_beside,
    known_values,
    of_metadata,
    of_values,
    unknown_fields,
)
from pseudolidar.formats.onnx.model import OnnxModel
from pseudolidar.formats.onnx.pixels import Channels, Normalisation

Sign = Literal["positive", "negative"]
Unit = Literal["pixel", "width"]

# What an input can be given; `left+right` is both images as channels of one input.
ROLES = (
    *("left", "right", "left+right", "right+left", "half-left", "half-right"),
    *("flow", "negative-flow", "iterations", "true", "false"),
)
_EXAMPLE = 'an object such as {"normalisation": "imagenet", "sign": "negative"}'


@dataclass(frozen=True)
class NetworkLayout:
    """What is known of a network's layout; None is not known yet, and will be found out.

    Args:
        inputs: what each input is given, a comma list in the file's order: left, right,
            left+right, right+left, half-left, half-right, flow, negative-flow, iterations.
        normalisation: of pixel values: raw 0..255, unit 0..1, centred -1..1, imagenet (unit, mean
            and deviation of ImageNet taken off).
        channels: order of colours, or grey.
        output: name of the output that is the disparity.
        channel: of that output, where it has several (a flow, a list of iterations).
        sign: of the disparity in the output.
        unit: of the output: pixels of the network's image, or widths of it.
        scale: units of the disparity in one of the output; 4 for an output in pixels of a map at
            a quarter of the resolution.
        pad: edge that a free image size must be a multiple of, px.
    """

    inputs: str | None = None
    normalisation: Normalisation | None = None
    channels: Channels | None = None
    output: str | None = None
    channel: int | None = None
    sign: Sign | None = None
    unit: Unit | None = None
    scale: float | None = None
    pad: int | None = None

    def __post_init__(self) -> None:
        unknown = [role for role in self.roles if role not in ROLES]
        if unknown:
            raise ModelError(f"input role {unknown[0]!r}", want=", ".join(ROLES), where="inputs")
        for name in ("scale", "pad"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ModelError(f"{name} {value}", want="a positive number", where=name)
        check_choices(self)

    @property
    def roles(self) -> tuple[str, ...]:
        """What each input is given."""
        return () if self.inputs is None else tuple(part.strip() for part in self.inputs.split(","))

    @property
    def unknown(self) -> tuple[str, ...]:
        """Fields that are not known."""
        return unknown_fields(self)

    def filled(self, other: NetworkLayout) -> NetworkLayout:
        """With what `other` knows where this one does not."""
        return filled(self, other)

    def as_dict(self) -> dict[str, Any]:
        """The known fields, plain JSON values."""
        return known_values(self)

    @classmethod
    def of_dict(cls, values: dict[str, Any], path: Path) -> Self:
        """From the fields of a file.

        Raises:
            ModelError: a field is unknown, or its value is not legal.
        """
        return of_values(cls, values, path)

    def flags(self) -> str:
        """The command line flags that say the same."""
        return as_flags(self, "--matcher.layout")

    def __str__(self) -> str:
        """One line for people; for a layout that is known completely."""
        output = self.output or "?"
        if self.channel:
            output += f"[{self.channel}]"
        factor = f"{'-' if self.sign == 'negative' else ''}{self.scale or 1:g}"
        of_width = " widths" if self.unit == "width" else " px"
        return (
            f"{self.inputs} as {self.channels} {self.normalisation} -> {factor} {output}{of_width}"
        )


def layout_beside(model: OnnxModel) -> NetworkLayout:
    """What a network's own metadata say, or a JSON file of its name beside it, which counts first.

    Raises:
        ModelError: one of them cannot be read.
    """
    return _of_sidecar(model).filled(of_metadata(NetworkLayout, model))


def _of_sidecar(model: OnnxModel) -> NetworkLayout:
    found = json_beside(model, _EXAMPLE)
    if found is None:
        return NetworkLayout()
    path, values = found
    if not isinstance(values, dict):
        raise ModelError("not a layout: no object", want=_EXAMPLE, path=path)
    return NetworkLayout.of_dict(values, path)
