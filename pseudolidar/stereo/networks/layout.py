"""How a network's inputs are fed and its output is read."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, Self, get_args, get_type_hints

from pseudolidar.errors import ModelError
from pseudolidar.formats.onnx_model import OnnxModel

Normalisation = Literal["unit", "raw", "imagenet", "centred"]
Channels = Literal["rgb", "bgr", "grey"]
Sign = Literal["positive", "negative"]
Unit = Literal["pixel", "width"]

# What an input can be given; `left+right` is both images as channels of one input.
ROLES = (
    *("left", "right", "left+right", "right+left", "half-left", "half-right"),
    *("flow", "negative-flow", "iterations", "true", "false"),
)
# Fields that are numbers, with the types of JSON that they may have; the others are text.
_NUMBERS: dict[str, tuple[type, ...]] = {"channel": (int,), "scale": (float, int), "pad": (int,)}
PREFIX = "pseudolidar."  # of our keys in a network's own metadata
_LARGEST_SIDECAR_BYTES = 100_000


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
        for name, kind in get_type_hints(type(self)).items():
            choices = [c for part in get_args(kind) for c in get_args(part)]
            value = getattr(self, name)
            if choices and value is not None and value not in choices:
                raise ModelError(f"{name} {value!r}", want=" or ".join(choices), where=name)

    @property
    def roles(self) -> tuple[str, ...]:
        """What each input is given."""
        return () if self.inputs is None else tuple(part.strip() for part in self.inputs.split(","))

    @property
    def unknown(self) -> tuple[str, ...]:
        """Fields that are not known."""
        return tuple(field.name for field in fields(self) if getattr(self, field.name) is None)

    def filled(self, other: NetworkLayout) -> NetworkLayout:
        """With what `other` knows where this one does not."""
        return replace(self, **{name: getattr(other, name) for name in self.unknown})

    def as_dict(self) -> dict[str, Any]:
        """The known fields, plain JSON values."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None}

    @classmethod
    def of_dict(cls, values: dict[str, Any], path: Path) -> Self:
        """From the fields of a file.

        Raises:
            ModelError: a field is unknown, or its value is not legal.
        """
        names = [field.name for field in fields(cls)]
        for name, value in values.items():
            if name not in names:
                raise ModelError(f"unknown field {name!r}", want=", ".join(names), path=path)
            kinds = _NUMBERS.get(name, (str,))
            if type(value) not in kinds:
                raise ModelError(f"{name} = {value!r}", want=kinds[0].__name__, path=path)
        try:
            return cls(**values)
        except ModelError as error:
            raise error.located(path) from None

    def flags(self) -> str:
        """The command line flags that say the same."""
        return " ".join(
            f"--matcher.layout.{name} {value}" for name, value in self.as_dict().items()
        )

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
    return _of_sidecar(model.path.with_suffix(".json")).filled(_of_metadata(model))


def _of_sidecar(path: Path) -> NetworkLayout:
    if not path.is_file():
        return NetworkLayout()
    try:
        with path.open("rb") as file:
            values = json.loads(file.read(_LARGEST_SIDECAR_BYTES))
        if not isinstance(values, dict):
            raise ValueError("no object")
    except (OSError, ValueError, RecursionError) as error:
        raise ModelError(
            f"not a layout: {error}",
            want='an object such as {"normalisation": "imagenet", "sign": "negative"}',
            path=path,
        ) from error
    return NetworkLayout.of_dict(values, path)


def _of_metadata(model: OnnxModel) -> NetworkLayout:
    values: dict[str, Any] = {}
    for key, text in model.metadata.items():
        if key.startswith(PREFIX):
            name = key.removeprefix(PREFIX)
            try:
                values[name] = json.loads(text) if name in _NUMBERS else text
            except ValueError as error:
                raise ModelError(
                    f"metadata {key} = {text!r}", want="a number", path=model.path
                ) from error
    return NetworkLayout.of_dict(values, model.path)
