"""What names and shapes tell about a network: the roles of its inputs, and the family it is of.

Families, and how their published ONNX files are fed and answer:

    HITNet        one input (1, 6 or 2, H, W), unit; `reference_output_disparity` (1, H, W, 1)
    CREStereo     `init_left, init_right, next_left, next_right`, two of half size first; or
                  `left, right`, with `flow_init` of half size; raw RGB; (1, 2, H, W), x first
    RAFT-Stereo   two inputs, raw RGB; output flow, so negative, often after a coarse one
    IGEV          two inputs, raw RGB; positive
    FoundationStereo  `left, right` -> `disp`, raw RGB
    ACV, GwcNet, PSMNet, LightStereo, CGI, CoEx  two inputs, ImageNet normalisation
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from itertools import permutations

from pseudolidar.errors import ModelError
from pseudolidar.formats.onnx.model import OnnxModel, TensorInfo
from pseudolidar.formats.onnx.pixels import (
    COLOURS,
    SINGLE,
    STACKED,
    Channels,
    channel_count,
    size_of,
)
from pseudolidar.stereo.networks.layout import NetworkLayout

_LEFT = re.compile(r"(^|[^a-z])(left|img_?l|imgl|im_?0|image_?1|img_?1|reference|l)($|[^a-z])")
_RIGHT = re.compile(r"(^|[^a-z])(right|img_?r|imgr|im_?1|image_?2|img_?2|target|r)($|[^a-z])")
_HALF = re.compile(r"init|half|dw2|coarse|small|low")
_ITERATIONS = re.compile(r"iter")
_OTHER_OUTPUT = re.compile(r"secondary|right|conf|occ|low|uncert|prob")


@dataclass(frozen=True)
class Family:
    """A family of networks.

    Args:
        name: for people.
        pattern: in the name of the file, an input or an output.
        layout: how its files are fed and read.
    """

    name: str
    pattern: re.Pattern[str]
    layout: NetworkLayout


def _family(name: str, pattern: str, layout: NetworkLayout) -> Family:
    return Family(name, re.compile(pattern), layout)


_RAW = NetworkLayout(normalisation="raw", channels="rgb", sign="positive", unit="pixel", scale=1.0)
_IMAGENET = NetworkLayout(
    normalisation="imagenet", channels="rgb", sign="positive", unit="pixel", scale=1.0
)
_FLOW_OUT = NetworkLayout(
    normalisation="raw", channels="rgb", sign="negative", unit="pixel", scale=1.0
)
FAMILIES = (
    _family(
        "HITNet",
        r"hitnet|reference_output_disparity",
        NetworkLayout(normalisation="unit", sign="positive", unit="pixel", scale=1.0, pad=64),
    ),
    _family("CREStereo", r"crestereo|cre_stereo|next_left|flow_init", _RAW),
    _family("IGEV", r"igev", _RAW),
    _family("FoundationStereo", r"foundation_?stereo", _RAW),
    _family("RAFT-Stereo", r"raft|flow_up|flow_predictions", _FLOW_OUT),
    _family(
        "volume network",
        r"acv|gwc|psm_?net|light_?stereo|cgi|coex|disp_pred|aanet|cfnet|openstereo",
        _IMAGENET,
    ),
)


def family_of(model: OnnxModel) -> Family | None:
    """The family that the names belong to."""
    names = [model.path.stem, *(t.name for t in (*model.inputs, *model.outputs))]
    text = " ".join(names).lower()
    return next((family for family in FAMILIES if family.pattern.search(text)), None)


def role_candidates(model: OnnxModel) -> list[str]:
    """What the inputs may be given, the likeliest first, as `NetworkLayout.inputs`.

    Raises:
        ModelError: no two-image network has such inputs.
    """
    fixed = {i: role for i, info in enumerate(model.inputs) if (role := _scalar_role(info))}
    images = [i for i in range(len(model.inputs)) if i not in fixed]
    infos = [model.inputs[i] for i in images]
    counts = [channel_count(info) for info in infos]
    _check_batch(model, infos)
    choices: list[tuple[str, ...]]
    match counts:
        case [n] if n in STACKED:
            choices = [("left+right",), ("right+left",)]
        case [a, b] if a == b and a in SINGLE:
            choices = _by_names(infos, [("left", "right"), ("right", "left")])
        case [a, b, c] if sorted((a, b, c)) in ([2, 3, 3], [1, 3, 3], [1, 1, 2]):
            choices = _with_flow(infos, counts)
        case [a, b, c, d] if a == b == c == d and a in SINGLE:
            choices = _with_halves(infos)
        case _:
            raise _no_network(model)
    found = []
    for choice in choices:
        roles = dict(zip(images, choice, strict=True)) | fixed
        found.append(",".join(roles[i] for i in range(len(model.inputs))))
    return found


def colours_of(model: OnnxModel, roles: tuple[str, ...]) -> str:
    """`rgb` where the images have three channels, else `grey`."""
    for info, role in zip(model.inputs, roles, strict=True):
        if "left" in role:
            return COLOURS.get(channel_count(info), "rgb")
    return "rgb"


def _no_network(model: OnnxModel) -> ModelError:
    return ModelError(
        f"inputs and outputs {model.signature}",
        want="one image input of 6 or 2 channels, or 2 to 4 of 3 or 1 channels, each (1, C, H, W)",
        fix="A network in several files or with other inputs must be exported as one graph from "
        "two images to a disparity.",
        path=model.path,
    )


def _scalar_role(info: TensorInfo) -> str | None:
    """Role of an input that is no image: a number of iterations, a switch."""
    few = info.shape is not None and all(axis in (1, None) for axis in info.shape[:1])
    if info.shape is None or len(info.shape) > 1 or not few:
        return None
    if info.dtype in ("int64", "int32") or _ITERATIONS.search(info.name.lower()):
        return "iterations"
    return "true" if info.dtype == "bool" else None


def _check_batch(model: OnnxModel, infos: list[TensorInfo]) -> None:
    for info in infos:
        if info.shape and isinstance(info.shape[0], int) and info.shape[0] != 1:
            raise ModelError(
                f"input {info}, a batch of {info.shape[0]}",
                want="a batch of 1, or a free one",
                fix="Export it with batch size 1.",
                path=model.path,
            )


def _by_names(infos: list[TensorInfo], choices: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """The choices, the one first in which sides agree best with the names."""

    def agreement(choice: tuple[str, ...]) -> int:
        points = 0
        for info, role in zip(infos, choice, strict=True):
            name = info.name.lower()
            left, right = bool(_LEFT.search(name)), bool(_RIGHT.search(name))
            if left != right:
                points += 1 if ("left" in role) == left else -1
            if len(infos) > 2:
                points += 1 if role.startswith("half") == bool(_HALF.search(name)) else -1
        return -points

    return sorted(choices, key=agreement)


def _with_flow(infos: list[TensorInfo], counts: list[int]) -> list[tuple[str, ...]]:
    """Two images and an initial flow: the one that has not the channels of the two others."""
    alone = next(i for i in range(3) if counts.count(counts[i]) == 1)
    pairs = _by_names(
        [info for i, info in enumerate(infos) if i != alone], [("left", "right"), ("right", "left")]
    )
    found = []
    for flow in ("flow", "negative-flow"):
        for pair in pairs:
            roles = list(pair)
            roles.insert(alone, flow)
            found.append(tuple(roles))
    return found


def _with_halves(infos: list[TensorInfo]) -> list[tuple[str, ...]]:
    """Two images and the same at half size, which static shapes tell apart."""
    roles = ("half-left", "half-right", "left", "right")
    choices = list(dict.fromkeys(permutations(roles)))
    widths = [size_of(info)[1] for info in infos]
    if all(width is not None for width in widths):
        large = max(width for width in widths if width is not None)
        choices = [
            choice
            for choice in choices
            if all(
                (width == large) == (not role.startswith("half"))
                for width, role in zip(widths, choice, strict=True)
            )
        ]
    return _by_names(infos, choices)


def expected_layout(model: OnnxModel, known: NetworkLayout) -> NetworkLayout:
    """What names and shapes say of the fields that are open; `pad` and unsaid ones stay None.

    Raises:
        ModelError: no two-image network has such inputs.
    """
    family = family_of(model)
    layout = NetworkLayout() if family is None else family.layout
    roles = known.inputs or role_candidates(model)[0]
    if len(roles.split(",")) != len(model.inputs):
        raise ModelError(
            f"{len(roles.split(','))} roles: {roles}",
            want=f"one for each input: {model.signature}",
            path=model.path,
            where="inputs",
        )
    output = known.output or _output_of(model)
    if output not in [info.name for info in model.outputs]:
        raise ModelError(
            f"no output {output!r}", want=model.signature, path=model.path, where="output"
        )
    colours = colours_of(model, tuple(roles.split(",")))
    channels: Channels = "grey" if colours == "grey" else layout.channels or "rgb"
    return replace(layout, inputs=roles, output=output, channels=channels)


def _output_of(model: OnnxModel) -> str:
    """The output that is the disparity: the last, but not of the right image or a confidence."""
    names = [info.name for info in model.outputs]
    fitting = [name for name in names if not _OTHER_OUTPUT.search(name.lower())] or names
    return fitting[-1]
