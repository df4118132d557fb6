"""Pictures as the tensors that a detector takes."""

from __future__ import annotations

import numpy as np

from pseudolidar.errors import ModelError
from pseudolidar.formats.onnx.model import OnnxModel, TensorInfo
from pseudolidar.formats.onnx.pixels import SINGLE, as_tensor, channel_count, normalised, size_of
from pseudolidar.obstacles.networks.layout import DetectorLayout
from pseudolidar.structures.arrays import AnyArray, UInt8
from pseudolidar.structures.image_size import ImageSize

# Words in the name of an input that asks for the size that boxes are wanted in.
_SIZE_WORDS = ("size", "shape")


def image_input(model: OnnxModel) -> TensorInfo:
    """The input that takes pictures.

    Raises:
        ModelError: there is none, or another one that nobody knows how to feed.
    """
    images = [info for info in model.inputs if channel_count(info) in SINGLE]
    others = [info for info in model.inputs if info not in images]
    if len(images) != 1 or not all(map(_is_size, others)):
        raise ModelError(
            f"inputs {'; '.join(map(str, model.inputs))}",
            want="one picture (batch, 3, H, W) or (batch, H, W, 3) of 8 bits or floats, and at "
            "most its size (batch, 2)",
            fix="A detector with other inputs must be exported as one graph from a picture to "
            "its objects.",
            path=model.path,
        )
    return images[0]


def own_size(model: OnnxModel) -> ImageSize | None:
    """The size that a network is made for, None where it is free.

    Raises:
        ModelError: one of width and height is fixed and the other free.
    """
    info = image_input(model)
    height, width = size_of(info)
    if (height is None) != (width is None):
        raise ModelError(
            f"input {info}, half of its size free", want="both or none", path=model.path
        )
    return None if height is None or width is None else ImageSize(width, height)


def own_batch(model: OnnxModel) -> int:
    """Pictures that one run takes; 0 is any number."""
    shape = image_input(model).shape
    first = None if shape is None else shape[0]
    return first if isinstance(first, int) else 0


def tensors(model: OnnxModel, layout: DetectorLayout, pictures: list[UInt8]) -> dict[str, AnyArray]:
    """Inputs by name.

    Args:
        model: the network.
        layout: with normalisation and channels known.
        pictures: (h, w, 3) RGB of the input's size, all alike.
    """
    info = image_input(model)
    channels = "grey" if channel_count(info) == 1 else layout.channels
    planes = [
        as_tensor(info, normalised(picture, layout.normalisation, channels)) for picture in pictures
    ]
    given = {info.name: np.concatenate(planes) if len(planes) > 1 else planes[0]}
    height, width = pictures[0].shape[:2]
    for other in model.inputs:
        if other is not info:
            # Boxes are wanted in pixels of the input: the way back knows the picture.
            size = np.array([[width, height]] * len(pictures))
            given[other.name] = size.astype(other.dtype)
    return given


def _is_size(info: TensorInfo) -> bool:
    pair = info.shape is not None and len(info.shape) == 2 and info.shape[1] in (2, None)
    number = info.dtype in ("int64", "int32", "float32")
    return pair and number and any(word in info.name.lower() for word in _SIZE_WORDS)
