"""The part of a rig file that says how good the calibration is; read beside write."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pseudolidar.errors import CalibrationValue
from pseudolidar.formats.rigs.placed import Node
from pseudolidar.formats.rigs.rig_fields import at_node, count, fields_of, number, numbers, wrong
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.quality import PIXELS, CalibrationQuality, CameraSigma

_INTRINSICS = ("fx", "fy", "cx", "cy")
_FIGURES = (*PIXELS, "baseline_sigma_m", "nearest_m")
_CAMERAS = {"left_sigma": "left", "right_sigma": "right"}
_VECTORS = ("rotation_sigma_rad", "translation_sigma_m")
_KEYS = (*_FIGURES, "views", *_CAMERAS, *_VECTORS, "depth_sigma_m")


def quality(node: Node) -> CalibrationQuality:
    """What a rig file says about its calibration.

    Raises:
        CalibrationSyntax, CalibrationField, CalibrationValue: as `rig_fields`.
    """
    fields = fields_of(node, (), _KEYS)
    found: dict[str, Any] = {name: number(fields[name]) for name in _FIGURES if name in fields}
    found |= {name: numbers(fields[name], 3) for name in _VECTORS if name in fields}
    for key, name in _CAMERAS.items():
        if key in fields:
            found[name] = _camera_sigma(fields[key])
    if "views" in fields:
        found["views"] = count(fields["views"], "views")
    if "depth_sigma_m" in fields:
        found["depth_sigma_m"] = _pairs(fields["depth_sigma_m"])
    try:
        return CalibrationQuality(**found)
    except CalibrationValue as error:
        raise at_node(error, _named(error, fields) or node) from None


def _named(error: CalibrationValue, fields: Mapping[str, Node]) -> Node | None:
    """The field that an error of the noun begins with."""
    return fields.get(error.got.split(" ", 1)[0])


def _camera_sigma(node: Node) -> CameraSigma:
    fields = fields_of(node, _INTRINSICS, ("distortion",))
    intrinsics_px = np.array([number(fields[key]) for key in _INTRINSICS])
    distortion = numbers(fields["distortion"]) if "distortion" in fields else np.zeros(0)
    try:
        return CameraSigma(intrinsics_px, distortion)
    except CalibrationValue as error:
        raise at_node(error, node) from None


def _pairs(node: Node) -> Float64:
    """(M, 2) of [depth, standard deviation]."""
    if not isinstance(node.value, tuple) or not node.value:
        raise wrong(node, "[depth in m, standard deviation in m] of several depths")
    return np.stack([numbers(pair, 2) for pair in node.value])


def quality_fields(quality: CalibrationQuality) -> dict[str, Any]:
    """The fields of a rig file; what is not known is left out."""
    fields: dict[str, Any] = {}
    for name in (*_FIGURES, "views"):
        if getattr(quality, name) is not None:
            fields[name] = getattr(quality, name)
    for key, name in _CAMERAS.items():
        sigma = getattr(quality, name)
        if sigma is not None:
            fields[key] = dict(zip(_INTRINSICS, sigma.intrinsics_px.tolist(), strict=True))
            if len(sigma.distortion):
                fields[key]["distortion"] = sigma.distortion.tolist()
    for name in (*_VECTORS, "depth_sigma_m"):
        if getattr(quality, name) is not None:
            fields[name] = getattr(quality, name).tolist()
    return fields
