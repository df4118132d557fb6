"""The names under which programs keep the matrices of a stereo pair, and the values found there."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pseudolidar.errors import CalibrationField, CalibrationSyntax
from pseudolidar.formats.rigs.placed import Node
from pseudolidar.formats.rigs.storage import is_matrix, matrix_of
from pseudolidar.structures.arrays import Float64

Eye = Literal["left", "right"] | None
# How the left and the right eye are told apart; the first that has both cameras counts.
EYES = (
    ("left", "right"),
    ("1", "2"),
    ("l", "r"),
    ("0", "1"),
    ("cam0", "cam1"),
    ("cam1", "cam2"),
    ("camera1", "camera2"),
)
# Names without case and punctuation; OpenCV's samples, ROS, ORB-SLAM, common scripts.
NAMES = {
    "K": ("m", "k", "cameramatrix", "intrinsics", "intrinsic", "intrinsicmatrix", "mtx"),
    "D": ("d", "distcoeffs", "distcoeff", "distortioncoefficients", "distortioncoeffs",
          "distortion", "dist"),
    "P": ("p", "projectionmatrix", "projection"),
    "R_rect": ("r", "rectificationmatrix", "rectification", "rect"),
    "model": ("distortionmodel", "cameramodel", "model"),
    "width": ("imagewidth", "width"),
    "height": ("imageheight", "height"),
}  # fmt: skip
SHARED = {
    "R": ("r", "rotation", "rotationmatrix", "stereor"),
    "T": ("t", "translation", "translationvector", "stereot"),
    "Q": ("q", "disparitytodepthmatrix"),
    "size": ("imagesize", "size"),
    "width": ("imagewidth", "width"),
    "height": ("imageheight", "height"),
    "model": ("distortionmodel", "cameramodel", "model"),
}
_WORDS = {
    "K": "camera matrix",
    "D": "distortion numbers",
    "P": "projection matrix",
    "R_rect": "rectifying rotation",
    "model": "lens model",
}
_PUNCTUATION = re.compile(r"[^0-9a-z]+")


@dataclass(frozen=True)
class StereoFields:
    """The values of one or several files of a pair.

    Args:
        path: file or folder, for errors.
        nodes: values by name without case and punctuation.
        shown: their names as they are in the file.
        eyes: marks of the left and the right eye in the names.
    """

    path: Path
    nodes: Mapping[str, Node]
    shown: Mapping[str, str]
    eyes: tuple[str, str]

    @classmethod
    def of(cls, path: Path, parts: Sequence[tuple[Eye, Node]]) -> StereoFields:
        """The values of trees, each of one eye, or of both.

        Raises:
            CalibrationSyntax: a file that is no mapping.
            CalibrationField: one name in two files, or no camera of a pair.
        """
        nodes: dict[str, Node] = {}
        shown: dict[str, str] = {}
        for eye, root in parts:
            for name, node in _flat(root, eye or ""):
                key = _PUNCTUATION.sub("", name.lower())
                if key in nodes:
                    raise CalibrationField(
                        f"{shown[key]!r} twice, the first time at {nodes[key].where}",
                        want="once",
                        fix="Give the files of one calibration alone.",
                        path=node.path,
                        where=node.where,
                    )
                nodes[key], shown[key] = node, name
        fields = cls(path, nodes, shown, EYES[0])
        for eyes in EYES:
            option = cls(path, nodes, shown, eyes)
            if any(option._both(kind) for kind in ("K", "P")):
                return option
        raise fields.lacks(fields._missing_camera(), "M1 and M2, P1 and P2, or the like")

    def _both(self, kind: str) -> bool:
        return all(self.node(kind, eye) is not None for eye in (0, 1))

    def alone(self, kind: str) -> int | None:
        """The eye that has no value of a kind, where the other one has; None where none has."""
        without = [eye for eye in (0, 1) if self.node(kind, eye) is None]
        return without[0] if len(without) == 1 else None

    def _missing_camera(self) -> str:
        """What keeps the values from being those of a pair, in words."""
        for eyes in EYES:
            option = StereoFields(self.path, self.nodes, self.shown, eyes)
            for kind in ("K", "P"):
                eye = option.alone(kind)
                if eye is not None:
                    return of_eye(kind, eye)
        single = next((name for name in NAMES["K"] if name in self.nodes), None)
        return "cameras of a pair" + (f", {self.shown[single]} is of one" if single else "")

    def node(self, kind: str, eye: int | None = None) -> Node | None:
        """The value of a kind of `NAMES` for an eye, or of `SHARED`; None where there is none."""
        if eye is None:
            names = SHARED[kind]
            return next((self.nodes[name] for name in names if name in self.nodes), None)
        mark = self.eyes[eye]
        options = (form for name in NAMES[kind] for form in (f"{mark}{name}", f"{name}{mark}"))
        return next((self.nodes[form] for form in options if form in self.nodes), None)

    def matrix(self, kind: str, eye: int | None, rows: int, cols: int) -> Float64 | None:
        """(rows, cols) numbers of a kind, None where there are none.

        Raises:
            CalibrationSyntax: another count of numbers.
            CalibrationField, CalibrationValue: as `matrix_of` does.
        """
        node = self.node(kind, eye)
        if node is None:
            return None
        found = matrix_of(node)
        if found.size != rows * cols:
            shape = " x ".join(str(n) for n in found.shape)
            raise CalibrationSyntax(
                f"a matrix of {shape}", want=f"{rows} x {cols}", path=node.path, where=node.where
            )
        return found.reshape(rows, cols)

    def place(self, kind: str, eye: int | None = None) -> tuple[Path, str]:
        """File and place of a value, for errors."""
        node = self.node(kind, eye)
        return (self.path, "") if node is None else (Path(node.path), node.where)

    def lacks(self, what: str, want: str) -> CalibrationField:
        """The error of files without something; what is there is named."""
        names = ", ".join(list(self.shown.values())[:20])
        return CalibrationField(
            f"no {what}; found {names or 'nothing'}", want=want, path=self.path, where="keys"
        )


def of_eye(kind: str, eye: int) -> str:
    """A value of `NAMES` in words: "camera matrix of the left camera"."""
    return f"{_WORDS[kind]} of the {('left', 'right')[eye]} camera"


def _flat(node: Node, name: str) -> Iterator[tuple[str, Node]]:
    """Values with their path, `left.K`; matrices are values."""
    if isinstance(node.value, dict) and not is_matrix(node):
        for key, inner in node.value.items():
            yield from _flat(inner, f"{name}.{key}" if name else key)
    elif name:
        yield name, node
    else:
        raise CalibrationSyntax("no mapping", want="KEY: value", path=node.path, where=node.where)
