"""Clouds in messages: records of any layout to columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import PointFileCorrupt, PointFileTruncated
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.mcap.columns import OPAQUE
from pseudolidar.formats.points.columns import Notes, assemble, fit_names
from pseudolidar.formats.points.point_file import check_point_limit
from pseudolidar.structures.arrays import AnyArray, UInt8
from pseudolidar.structures.cloud import PointCloud

MOST_FIELDS = 1000
_COLOURS = ("red", "green", "blue")
# Fields that hold B, G, R, alpha in four bytes.
_PACKED_COLOURS = ("rgb", "rgba")
_ALPHA = "alpha"


@dataclass(frozen=True)
class PackedField:
    """A field of the records.

    Args:
        name: of the field.
        offset: its byte in the record.
        code: numpy type, without byte order.
        count: how many values it has.
    """

    name: str
    offset: int
    code: str
    count: int = 1


@dataclass(frozen=True, eq=False)
class PackedCloud:
    """A cloud as a message holds it.

    Args:
        frame: coordinate frame.
        stamp_ns: time of the cloud.
        fields: of a record.
        stride: bytes of a record.
        width: points of a row.
        height: rows; 1 for a cloud without order.
        row_bytes: bytes of a row, padding included.
        big_endian: order of the bytes.
        data: the rows.
    """

    frame: str
    stamp_ns: int
    fields: tuple[PackedField, ...]
    stride: int
    width: int
    height: int
    row_bytes: int
    big_endian: bool
    data: bytes | memoryview

    def cloud(self, *, own: bool, limits: Limits) -> PointCloud:
        """The cloud with all its columns.

        Args:
            own: whether this package wrote it: its columns mean what ours do then.
            limits: cap on the points.

        Raises:
            PointFileCorrupt, PointFileTruncated: the layout contradicts itself or the data.
            PointFileField: no x, y, z.
            LimitError: more points than `limits.points`.
        """
        check_point_limit(self.width * self.height, limits)
        columns = _unpacked(self._records(), self.fields)
        shape = (self.height, self.width) if self.height > 1 else None
        return cloud_of(columns, self.frame, self.stamp_ns, shape, own=own)

    def _records(self) -> AnyArray:
        """(N,) records."""
        dtype = self._dtype()
        points, row = self.width * self.height, self.width * self.stride
        if self.row_bytes < row or self.width < 0 or self.height < 0:
            raise PointFileCorrupt(
                f"rows of {self.row_bytes} bytes", want=f"{row} for {self.width} points"
            )
        needed = self.row_bytes * (self.height - 1) + row if points else 0
        if len(self.data) < needed:
            raise PointFileTruncated(f"{len(self.data)} bytes of points", want=f"{needed} bytes")
        if self.row_bytes == row or self.height == 1 or not points:
            return np.frombuffer(self.data, dtype, points)
        rows = np.lib.stride_tricks.as_strided(
            np.frombuffer(self.data, np.uint8), (self.height, row), (self.row_bytes, 1)
        )
        return np.ascontiguousarray(rows).view(dtype).reshape(-1)

    def _dtype(self) -> np.dtype[np.void]:
        order = ">" if self.big_endian else "<"
        if not self.fields or len(self.fields) > MOST_FIELDS:
            raise PointFileCorrupt(f"{len(self.fields)} fields", want=f"1 to {MOST_FIELDS}")
        for field in self.fields:
            end = field.offset + np.dtype(field.code).itemsize * field.count
            if not 0 <= field.offset <= end <= self.stride or field.count < 1:
                raise PointFileCorrupt(
                    f"field {field.name[:40]!r} at bytes {field.offset} to {end}",
                    want=f"within the {self.stride} bytes of a point",
                )
        return np.dtype(
            {
                "names": [str(i) for i in range(len(self.fields))],
                "formats": [
                    (order + field.code, (field.count,)) if field.count > 1 else order + field.code
                    for field in self.fields
                ],
                "offsets": [field.offset for field in self.fields],
                "itemsize": self.stride,
            }
        )


def cloud_of(
    columns: list[tuple[PackedField, AnyArray]],
    frame: str,
    stamp_ns: int,
    shape: tuple[int, int] | None,
    *,
    own: bool,
) -> PointCloud:
    """The cloud of a message's columns.

    Args:
        columns: (N,) or (N, values) each, with their fields.
        frame: coordinate frame.
        stamp_ns: time of the cloud.
        shape: (rows, columns) of an organised cloud.
        own: whether this package wrote it.

    Raises:
        PointFileField: no x, y, z.
    """
    columns = list(columns)
    rgb = _pop_colours(columns, own=own)
    fields = _named(columns)
    listed = _own_columns(fields) if own else None
    return assemble(fields, rgb, Notes(frame, stamp_ns, columns=listed), shape)


def _unpacked(
    records: AnyArray, fields: Sequence[PackedField]
) -> list[tuple[PackedField, AnyArray]]:
    columns = [(field, records[str(i)]) for i, field in enumerate(fields)]
    return [(f, c.astype(c.dtype.newbyteorder("="), order="C")) for f, c in columns]


def _pop_colours(columns: list[tuple[PackedField, AnyArray]], *, own: bool) -> UInt8 | None:
    """Colours as (N, 3), taken out of `columns`: packed, or red, green and blue."""
    by_name = {field.name.lower(): at for at, (field, _) in enumerate(columns)}
    for name in _PACKED_COLOURS:
        at = by_name.get(name)
        if at is not None and columns[at][1].ndim == 1 and columns[at][1].dtype.itemsize == 4:
            field, packed = columns.pop(at)
            bgra = packed.astype(packed.dtype.newbyteorder("<")).view(np.uint8).reshape(-1, 4)
            if field.name.lower() == "rgba":
                alpha = PackedField(_ALPHA, field.offset, "u1")
                columns.insert(at, (alpha, bgra[:, 3].copy()))
            return bgra[:, 2::-1].copy()
    places = [by_name.get(name, -1) for name in _COLOURS]
    if min(places) < 0 or any(columns[at][1].dtype != np.uint8 for at in places):
        return None
    rgb = np.stack([columns[at][1] for at in places], axis=1)
    gone = set(places)
    alpha_at = by_name.get(_ALPHA, -1)
    if own and alpha_at >= 0 and np.all(columns[alpha_at][1] == OPAQUE):
        gone.add(alpha_at)
    columns[:] = [column for at, column in enumerate(columns) if at not in gone]
    return rgb


def _named(columns: Iterable[tuple[PackedField, AnyArray]]) -> dict[str, AnyArray]:
    """(N,) columns by names that files can hold; several values of a field are numbered."""
    parts: list[tuple[str, AnyArray]] = []
    for field, column in columns:
        if column.ndim == 1:
            parts.append((field.name, column))
        else:
            numbered = range(column.shape[1])
            parts += [(f"{field.name}_{i}", column[:, i].copy()) for i in numbered]
    return fit_names(parts)


def _own_columns(fields: dict[str, AnyArray]) -> tuple[str, ...]:
    single = {name for name, column in fields.items() if column.dtype == np.float32}
    own = tuple(name for name in ("intensity", "sigma_m") if name in single)
    return (*own, "uv") if {"u", "v"} <= single else own
