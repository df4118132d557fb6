"""Tell a detector's layout from a dry run: names, shapes and values of what it answers to noise."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from pseudolidar.errors import ModelError, PseudolidarError
from pseudolidar.formats.onnx.model import OnnxModel
from pseudolidar.formats.onnx.session import NetworkSession
from pseudolidar.obstacles.networks.answer import Answer
from pseudolidar.obstacles.networks.families.dense import Nanodet, Ultralytics, Yolov5, Yolox
from pseudolidar.obstacles.networks.families.family import Family
from pseudolidar.obstacles.networks.families.listed import DetsLabels, LabelsBoxesScores, TfOd
from pseudolidar.obstacles.networks.families.rows import EndToEnd, Pairs, Queries, Rows
from pseudolidar.obstacles.networks.feed import own_batch, own_size, tensors
from pseudolidar.obstacles.networks.layout import FAMILY_NAMES, DetectorLayout
from pseudolidar.structures.arrays import AnyArray, UInt8
from pseudolidar.structures.image_size import ImageSize

# The most particular ones first: what fits one of them is tried on no other.
FAMILIES: tuple[Family, ...] = (
    TfOd(),
    DetsLabels(),
    LabelsBoxesScores(),
    Yolov5(),
    Yolox(),
    Nanodet(),
    Ultralytics(),
    Rows(),
    EndToEnd(),
    Pairs(),
    Queries(),
)
_SEED = 7
# How the dry run feeds, where nothing is known: values that no network overflows at.
_MILD = DetectorLayout(normalisation="unit", channels="rgb")


def family_of(layout: DetectorLayout) -> Family:
    """The reader of a layout."""
    return next(family for family in FAMILIES if family.name == layout.family)


def found_out(session: NetworkSession, known: DetectorLayout, size: ImageSize) -> DetectorLayout:
    """The complete layout of a network.

    Args:
        session: the network.
        known: what flags, metadata or a sidecar settle.
        size: of the input, where the network has none of its own.

    Raises:
        ModelError: it does not run, or is of no known family.
    """
    size = own_size(session.model) or size
    batch = own_batch(session.model)
    pictures = [_noise(size, _SEED + i) for i in range(batch or 1)]
    answer = answers(session, known.filled(_MILD), pictures, size)[0]
    layout = recognised(session.model, answer, known)
    if layout.batch is None:
        layout = layout.filled(DetectorLayout(batch=batch or _free_batch(session, layout, size)))
    return layout


def recognised(model: OnnxModel, answer: Answer, known: DetectorLayout) -> DetectorLayout:
    """The layout that names, shapes and values of an answer tell; `batch` may stay None.

    Raises:
        ModelError: none of the known families.
    """
    for name, array in answer.outputs.items():
        if array.dtype.kind == "f" and np.isnan(array).any():
            raise ModelError(
                f"output {name} holds NaN on a picture of noise",
                want="numbers",
                fix="A 16-bit network may overflow: take a 32-bit export.",
                path=model.path,
            )
    task = model.metadata.get("task", "detect")
    if task in ("obb", "classify"):
        raise ModelError(
            f"a network for the task {task!r}",
            want="one that finds upright boxes: detect, segment or pose",
            path=model.path,
        )
    for family in FAMILIES:
        if known.family in (None, family.name):
            told = family.told(answer, known)
            if told is not None:
                return known.filled(told)
    raise not_recognised(model, answer, known)


def not_recognised(model: OnnxModel, answer: Answer, known: DetectorLayout) -> ModelError:
    """The error that shows the signature, the dry run and the flags that would describe it."""
    forms = [f"{f.name}: {f.form}" for f in FAMILIES if known.family in (None, f.name)]
    example = known.filled(DetectorLayout("yolox", "raw", "bgr", "corner", 114, "pixel", 80, 0, 1))
    choices = ", ".join(f"--detector.layout.{f.name.replace('_', '-')}" for f in fields(known))
    return ModelError(
        f"its layout could not be told: {model.signature}; it answers noise with {answer}",
        want="; or ".join(forms),
        fix=f"Describe it with {choices}: family is one of {', '.join(FAMILY_NAMES)}; such as "
        f"{example.flags()}.",
        path=model.path,
    )


def answers(
    session: NetworkSession, layout: DetectorLayout, pictures: list[UInt8], size: ImageSize
) -> list[Answer]:
    """What the network answers to each of some pictures, in one run.

    Args:
        session: the network.
        layout: with normalisation and channels known.
        pictures: (h, w, 3) RGB of the input's size.
        size: that size.

    Raises:
        ModelError: it does not take them, or answers for another number of them.
    """
    arrays = session(tensors(session.model, layout, pictures))
    count = len(pictures)
    if count == 1:
        return [Answer(dict(zip(session.outputs, arrays, strict=True)), size)]
    if any(array.ndim == 0 or len(array) != count for array in arrays):
        shapes = ", ".join(str(list(array.shape)) for array in arrays)
        raise ModelError(
            f"outputs of {shapes} for {count} pictures",
            want="one entry for each picture",
            fix="Pass --detector.layout.batch 1.",
            path=session.model.path,
        )
    return [_one(session.outputs, arrays, i, size) for i in range(count)]


def _one(names: list[str], arrays: list[AnyArray], index: int, size: ImageSize) -> Answer:
    outputs = {n: a[index : index + 1] for n, a in zip(names, arrays, strict=True)}
    return Answer(outputs, size)


def _free_batch(session: NetworkSession, layout: DetectorLayout, size: ImageSize) -> int:
    """0 where the network takes any number of pictures, as its free axis says; 1 where not."""
    try:
        answers(session, layout, [_noise(size, _SEED), _noise(size, _SEED + 1)], size)
    except PseudolidarError:
        return 1
    return 0


def _noise(size: ImageSize, seed: int) -> UInt8:
    import cv2

    coarse = np.random.default_rng(seed).integers(0, 256, (12, 16, 3), np.uint8)
    whole = cv2.resize(coarse, (size.width, size.height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(whole, np.uint8)
