"""Array types and the one check of shape and dtype that every noun makes at its door."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pseudolidar.errors import StructureError

Bool = npt.NDArray[np.bool_]
Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]
Int64 = npt.NDArray[np.int64]
UInt8 = npt.NDArray[np.uint8]
Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
AnyArray = npt.NDArray[Any]


def size_of(image: AnyArray) -> tuple[int, int]:
    """(width, height) of a picture (H, W) or (H, W, C)."""
    return int(image.shape[1]), int(image.shape[0])


def check_array(
    owner: str,
    name: str,
    array: AnyArray,
    shape: tuple[int | None, ...],
    *dtypes: type[np.generic],
) -> None:
    """Raise `StructureError` unless `array` has `shape` (None = any length) and one of `dtypes`.

    Raises:
        StructureError: with owner and name as place.
    """
    if not isinstance(array, np.ndarray):
        raise StructureError(
            f"a {type(array).__name__}", want="a numpy array", where=f"{owner}.{name}"
        )
    fits = array.ndim == len(shape) and all(
        want in (None, have) for want, have in zip(shape, array.shape, strict=True)
    )
    if fits and array.dtype.type in dtypes:
        return
    wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
    kinds = " or ".join(np.dtype(kind).name for kind in dtypes)
    raise StructureError(
        f"{array.dtype} array of shape {array.shape}",
        want=f"{kinds} of shape {wanted}",
        where=f"{owner}.{name}",
    )
