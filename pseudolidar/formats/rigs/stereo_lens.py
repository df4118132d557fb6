"""The lens models of both eyes, by the names and numbers that calibration files have for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pseudolidar.errors import CalibrationValue, PseudolidarError
from pseudolidar.formats.rigs.placed import at_place
from pseudolidar.formats.rigs.rig_parts import check_coefficients
from pseudolidar.formats.rigs.stereo_fields import StereoFields, of_eye
from pseudolidar.formats.rigs.storage import matrix_of
from pseudolidar.formats.text import LONGEST_SHOWN
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, LensModel

# Words in a model's name that say it is OpenCV's fisheye model, or its pinhole one.
FISHEYE_MODELS = ("fisheye", "equidistant", "kannala")
PINHOLE_MODELS = ("plumb", "rational", "pinhole", "radtan", "radial", "brown", "opencv", "none")


def with_lens(camera: Camera, fields: StereoFields, eye: int) -> Camera:
    """A camera with the distortion that files have for its eye.

    Raises:
        CalibrationField: the other eye alone has distortion numbers.
        CalibrationSyntax: a count of numbers that the model does not have.
        CalibrationValue: a number that no lens has.
    """
    numbers, model = _lens(fields, eye)
    try:
        return replace(camera, distortion=numbers, model=model)
    except CalibrationValue as error:
        path, where = fields.place("D", eye)
        raise at_place(error, path=path, where=where) from None


def _lens(fields: StereoFields, eye: int) -> tuple[Float64, LensModel]:
    bare = fields.alone("D")
    if bare is not None:
        want = "distortion of both cameras, zeros where there is none"
        raise fields.lacks(of_eye("D", bare), want)
    node, name = fields.node("D", eye), _model_name(fields, eye)
    model: LensModel = "fisheye" if _is_of(name, FISHEYE_MODELS) else "pinhole"
    if node is None or node.value == ():
        return np.zeros(0), model
    numbers = matrix_of(node).ravel()
    check_coefficients(len(numbers), model, node)
    return numbers, model


def _model_name(fields: StereoFields, eye: int) -> str:
    named = fields.node("model", eye) or fields.node("model")
    return "" if named is None or named.value is None else str(named.value)[:LONGEST_SHOWN]


def _is_of(name: str, words: tuple[str, ...]) -> bool:
    return any(word in name.lower() for word in words)


def lens_refusal(fields: StereoFields) -> PseudolidarError | None:
    """What is wrong with the names of the lens models: none of OpenCV's, or of one eye alone."""
    names = [_model_name(fields, eye) for eye in (0, 1)]
    for eye, name in enumerate(names):
        if name and not _is_of(name, (*FISHEYE_MODELS, *PINHOLE_MODELS)):
            own = fields.node("model", eye) is not None
            path, where = fields.place("model", eye if own else None)
            return CalibrationValue(
                f"lens model {name!r}",
                want="plumb_bob, rational_polynomial or equidistant",
                fix="Calibrate with one of these: others bend pictures by other formulas.",
                path=path,
                where=where,
            )
    if "" in names and _is_of(names[0] or names[1], FISHEYE_MODELS):
        return fields.lacks(of_eye("model", names.index("")), "the same model of both lenses")
    return None
