"""Find a network's layout by showing it pairs of known disparity and looking at what it answers.

Every way of feeding it that is open is tried on one scene; of the answers every map, sign and scale
is read, and the reading nearest to the truth wins. It must then find a second scene, darker and of
another width where the size is free.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import cast, get_args

import numpy as np

from pseudolidar.errors import ModelError
from pseudolidar.formats.onnx.model import OnnxModel
from pseudolidar.formats.onnx.pixels import Channels, Normalisation, channel_count, size_of
from pseudolidar.formats.onnx.session import NetworkSession
from pseudolidar.stereo.networks.feed import tensors
from pseudolidar.stereo.networks.judge import Finding, best_reading
from pseudolidar.stereo.networks.layout import NetworkLayout
from pseudolidar.stereo.networks.names import colours_of, role_candidates
from pseudolidar.stereo.networks.reading import output_maps
from pseudolidar.stereo.networks.scene import probe_scene

# Sizes for networks of free size: multiples of 32, 64 and 128; large enough for spatial pyramids
# of 64 pixels at a quarter of the resolution.
SIZE_PX, SECOND_SIZE_PX = (512, 256), (640, 256)
# Edges that are tried, and by how many of them: odd numbers, so that no larger edge fits as well.
PADS = {32: (17, 9), 64: (9, 5), 128: (5, 3)}
_FIRST, _SECOND = (7, 1.0), (11, 0.6)  # seed and gain of the scenes
# So many of the visible pixels must be found.
LEAST_FOUND = 0.7
# From here on other roles of the inputs are not tried: the right view's disparities, or sides
# exchanged, are wrong along the edges of all patches.
SURE = 0.85
# What the names say, and red first, hold unless the error is smaller by this factor otherwise.
_AS_GOOD = 1.03


def network_size(model: OnnxModel, roles: tuple[str, ...]) -> tuple[int, int] | None:
    """(width, height) that the network is made for, None where it is free.

    Raises:
        ModelError: one of the two is fixed and the other free.
    """
    for info, role in zip(model.inputs, roles, strict=True):
        if role in ("left", "right", "left+right", "right+left"):
            height, width = size_of(info)
            if (height is None) != (width is None):
                raise ModelError(
                    f"input {info}, half of its size free", want="both or none", path=model.path
                )
            return None if height is None or width is None else (width, height)
    raise ModelError(f"roles {roles}", want="left and right among them", path=model.path)


def find_layout(
    session: NetworkSession, asked: NetworkLayout, expected: NetworkLayout, *, iterations: int
) -> Finding:
    """The layout that finds the known disparities.

    Args:
        session: the network.
        asked: fields that are settled.
        expected: what the names say; tried first, and kept where nothing else is clearly better.
        iterations: for networks that ask for a number of them.

    Raises:
        ModelError: no reading finds them; says how good the best was and how to describe it.
    """
    best: Finding | None = None
    refusal, tried = "", 0
    for stage in _feeds(session.model, asked, expected):
        for layout in stage(best):
            tried += 1
            try:
                finding = try_feed(session, layout, expected, iterations=iterations)
            except ModelError as error:  # roles of which the network knows better
                refusal, finding = error.got, None
            if finding is not None and (best is None or _clearly_better(finding, best, expected)):
                best = finding
        if best is not None and best.found >= SURE and stage.may_end_here:
            break
    if best is None or best.found < LEAST_FOUND:
        raise not_recognised(session.model, best, tried, refusal)
    return confirmed(session, best, tried, iterations=iterations)


def _clearly_better(finding: Finding, best: Finding, expected: NetworkLayout) -> bool:
    """Smaller error; by a margin where the best is what names say, or the other is blue first."""
    named = best.layout.normalisation == expected.normalisation
    margin = _AS_GOOD if named or finding.layout.channels == "bgr" else 1.0
    return finding.error_px * margin < best.error_px


@dataclass(frozen=True)
class _Stage:
    """Feeds to try, given the best so far."""

    model: OnnxModel
    asked: NetworkLayout
    expected: NetworkLayout
    roles: tuple[str, ...]
    may_end_here: bool = True

    def __call__(self, _best: Finding | None) -> Iterator[NetworkLayout]:
        for roles in self.roles:
            for normalisation in _open(self.asked.normalisation, self.expected.normalisation):
                for channels in self.channels(roles):
                    yield replace(
                        self.asked, inputs=roles, normalisation=normalisation, channels=channels
                    )

    def channels(self, roles: str) -> tuple[Channels, ...]:
        """RGB; BGR is tried afterwards, with the normalisation that was found."""
        if self.asked.channels is not None:
            return (self.asked.channels,)
        return (cast(Channels, colours_of(self.model, tuple(roles.split(",")))),)


@dataclass(frozen=True)
class _OtherOrder:
    """The best feed so far with blue first."""

    asked: NetworkLayout
    may_end_here: bool = True

    def __call__(self, best: Finding | None) -> Iterator[NetworkLayout]:
        if best is not None and self.asked.channels is None and best.layout.channels == "rgb":
            yield replace(
                self.asked,
                inputs=best.layout.inputs,
                normalisation=best.layout.normalisation,
                channels="bgr",
            )


def _feeds(
    model: OnnxModel, asked: NetworkLayout, expected: NetworkLayout
) -> list[_Stage | _OtherOrder]:
    roles = [asked.inputs] if asked.inputs is not None else role_candidates(model)
    # A network that is given a flow may hand it on as it is, whatever else it is given: then the
    # first roles look good enough, and are not.
    sure = "flow" not in roles[0]
    return [
        _Stage(model, asked, expected, (roles[0],), may_end_here=False),
        _OtherOrder(asked, may_end_here=sure),
        _Stage(model, asked, expected, tuple(roles[1:]), may_end_here=False),
        _OtherOrder(asked),
    ]


def _open(asked: Normalisation | None, expected: Normalisation | None) -> list[Normalisation]:
    """What is asked for; else all, what is expected first."""
    if asked is not None:
        return [asked]
    every = get_args(Normalisation)
    return sorted(every, key=lambda name: name != expected)


def try_feed(
    session: NetworkSession,
    feed: NetworkLayout,
    expected: NetworkLayout,
    *,
    iterations: int,
    second: bool = False,
) -> Finding | None:
    """The best reading of what the network answers to one way of feeding, None if there is none.

    Raises:
        ModelError: the network does not take it.
    """
    size = network_size(session.model, feed.roles) or (SECOND_SIZE_PX if second else SIZE_PX)
    seed, gain = _SECOND if second else _FIRST
    scene = probe_scene(*size, seed=seed, gain=gain)
    given = tensors(session.model, feed, scene.left, scene.right, iterations=iterations)
    maps = output_maps(session.outputs, session(given))
    return best_reading(maps, feed, expected, scene)


def confirmed(session: NetworkSession, first: Finding, tried: int, *, iterations: int) -> Finding:
    """The finding, if the layout holds on the second scene too; with its worse figures.

    Raises:
        ModelError: it does not.
    """
    layout = first.layout
    second = try_feed(session, layout, layout, iterations=iterations, second=True)
    if second is None or second.found < LEAST_FOUND:
        raise not_recognised(session.model, second or first, tried)
    return Finding(layout, min(first.found, second.found), max(first.error_px, second.error_px))


def working_pad(session: NetworkSession, layout: NetworkLayout, *, iterations: int) -> int:
    """Smallest edge of which free sizes must be a multiple, so that the network takes them.

    Raises:
        ModelError: it takes none of them.
    """
    refused: ModelError | None = None
    for pad, (columns, rows) in PADS.items():
        image = np.zeros((rows * pad, columns * pad, 3), np.uint8)
        try:
            session(tensors(session.model, layout, image, image, iterations=iterations))
            return pad
        except ModelError as error:
            refused = error
    assert refused is not None
    raise refused


def not_recognised(
    model: OnnxModel, best: Finding | None, tried: int, refusal: str = ""
) -> ModelError:
    """The error that shows the signature and the flags that would describe the network.

    Args:
        model: the network.
        best: the best reading, None where there was none.
        tried: ways of feeding that were tried.
        refusal: what onnxruntime said to one that it did not take.
    """
    likely = (
        best.layout
        if best is not None
        else NetworkLayout(
            inputs=role_candidates(model)[0],
            normalisation="imagenet",
            channels="rgb" if max(map(channel_count, model.inputs)) in (3, 6) else "grey",
            output=model.outputs[-1].name,
            channel=0,
            sign="positive",
            unit="pixel",
            scale=1.0,
        )
    )
    share = f"none was taken ({refusal})" if refusal else "none gave a disparity"
    if best is not None:
        share = f"the best found {best.found:.0%} of a known scene"
    return ModelError(
        f"its layout could not be told: {model.signature}; of {tried} ways of feeding it {share}",
        want=f"a two-image stereo network that finds {LEAST_FOUND:.0%}",
        fix=f"Describe it, such as: {likely.flags()} --matcher.no-probe.",
        path=model.path,
    )
