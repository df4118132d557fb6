"""What is to be checked of a message, whatever its schema."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class Stamp:
    """A time stamp within a message.

    Args:
        time_ns: ns since 1970.
    """

    time_ns: int


@dataclass(frozen=True)
class Used:
    """A coordinate frame that something is in.

    Args:
        frame: its name.
    """

    frame: str


@dataclass(frozen=True)
class Edge:
    """A transform.

    Args:
        parent: frame that it leads to.
        child: frame that it comes from.
    """

    parent: str
    child: str


@dataclass(frozen=True)
class Rotation:
    """A quaternion.

    Args:
        norm: of its four numbers.
    """

    norm: float


@dataclass(frozen=True)
class CloudLayout:
    """Points as packed records.

    Args:
        fields: name, offset and size in bytes of each field; None where it has no known type.
        stride: bytes of a point.
        nbytes: bytes of all points.
    """

    fields: tuple[tuple[str, int, int | None], ...]
    stride: int
    nbytes: int


@dataclass(frozen=True)
class ImageLayout:
    """A raw picture.

    Args:
        encoding: of its pixels.
        width: px.
        height: px.
        step: bytes of a row.
        nbytes: bytes of all rows.
    """

    encoding: str
    width: int
    height: int
    step: int
    nbytes: int


@dataclass(frozen=True)
class EncodedImage:
    """An encoded picture.

    Args:
        kind: `jpeg`, `png` or another.
        data: the file.
    """

    kind: str
    data: bytes


@dataclass(frozen=True)
class CameraNumbers:
    """A calibration.

    Args:
        K: intrinsics.
        R: rectification.
        P: projection.
    """

    K: tuple[float, ...]
    R: tuple[float, ...]
    P: tuple[float, ...]


Fact: TypeAlias = (
    Stamp | Used | Edge | Rotation | CloudLayout | ImageLayout | EncodedImage | CameraNumbers
)
