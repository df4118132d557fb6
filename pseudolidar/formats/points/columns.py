"""The one mapping between a cloud's columns and named fields of PCD, PLY and NPZ files."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from pseudolidar.errors import PointFileField, PointFileHeader, StructureError
from pseudolidar.structures.arrays import AnyArray, UInt8
from pseudolidar.structures.cloud import PointCloud

# Frame of a file that does not name one.
UNKNOWN_FRAME = "unknown"
# Columns of the noun that fields of these names belong to.
_OWN = {
    "x": "xyz",
    "y": "xyz",
    "z": "xyz",
    "xyz": "xyz",
    "rgb": "rgb",
    "rgba": "rgb",
    "intensity": "intensity",
    "sigma_m": "sigma_m",
    "u": "uv",
    "v": "uv",
    "uv": "uv",
}
# Of these no part can be missing or another column's: no extra one may have their name.
_TAKEN = ("xyz", "rgb")
# Dtypes that text-headed formats lack, and as what they are stored.
_STORED_AS = {"bool": "uint8", "float16": "float32"}
_NOTED_DTYPES = (*_STORED_AS, "int64", "uint64")
_NAME = re.compile(r"[\x21-\x22\x24-\x7e]+")  # printable ASCII without blank and #
_UNFIT = re.compile(r"[^\x21-\x22\x24-\x7e]")
_TAG = "pseudolidar"
DTYPE_LINE = f"{_TAG} dtype "
SHAPE_LINE = f"{_TAG} shape "
_MAX_NOTE_CHARS = 1000  # rply, which many programs read PLY with, takes lines of 1024


@dataclass(frozen=True)
class Notes:
    """What a file says beside its fields, in comment lines `pseudolidar KEY JSON`.

    Args:
        frame: coordinate frame.
        timestamp_ns: time of the picture.
        shape: (rows, columns) of an organised cloud.
        columns: which of the noun's optional columns are in the file; None in files of others,
            where fields are recognised by what they hold.
        dtypes: dtype of columns that the format cannot hold as they are.
    """

    frame: str = UNKNOWN_FRAME
    timestamp_ns: int = 0
    shape: tuple[int, int] | None = None
    columns: tuple[str, ...] | None = None
    dtypes: Mapping[str, str] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """One line a fact, printable ASCII."""
        facts: list[tuple[str, object]] = [
            ("frame", self.frame),
            ("timestamp_ns", self.timestamp_ns),
            ("columns", list(self.columns or ())),
        ]
        if self.shape is not None:
            facts.append(("shape", list(self.shape)))
        facts += [("dtype", [name, dtype]) for name, dtype in self.dtypes.items()]
        return [f"{_TAG} {key} {json.dumps(value)}" for key, value in facts]


def lines_beside(dtypes: Mapping[str, str], shape: tuple[int, int] | None) -> list[str]:
    """The lines that note dtypes, and rows and columns, which messages cannot hold."""
    lines = Notes(dtypes=dtypes, shape=shape).lines()
    return [line for line in lines if line.startswith((DTYPE_LINE, SHAPE_LINE))]


def restored(column: AnyArray, dtype: str) -> AnyArray:
    """A column in the dtype that it was noted to have, where that holds all its values."""
    with np.errstate(all="ignore"):
        narrow = column.astype(dtype)
        back = narrow.astype(column.dtype)
    same = np.array_equal(back, column, equal_nan=column.dtype.kind == "f")
    return narrow if same else column


def notes_of(cloud: PointCloud, dtypes: Mapping[str, str]) -> Notes:
    """The notes that a file of `cloud` carries."""
    optional = ("rgb", "intensity", "sigma_m", "uv")
    present = tuple(name for name in optional if getattr(cloud, name) is not None)
    return Notes(cloud.frame, cloud.timestamp_ns, cloud.shape, present, dtypes)


def parse_notes(comments: Iterable[str]) -> Notes:
    """The notes among a header's comment lines; other comments are ignored.

    Raises:
        PointFileHeader: a line with our tag that cannot be ours.
    """
    known: dict[str, object] = {}
    dtypes: dict[str, str] = {}
    for comment in comments:
        words = comment.strip().split(maxsplit=2)
        if len(words) != 3 or words[0] != _TAG or len(comment) > _MAX_NOTE_CHARS:
            continue
        try:
            value = json.loads(words[2])
            if words[1] == "dtype":
                name, dtype = value
                dtypes[str(name)] = _NOTED_DTYPES[_NOTED_DTYPES.index(dtype)]
            else:
                known[words[1]] = _checked_note(words[1], value)
        except (ValueError, TypeError, RecursionError) as error:
            raise PointFileHeader(
                f"comment {comment.strip()[:80]!r}", want="a fact written by this package"
            ) from error
    return Notes(**known, dtypes=dtypes)  # type: ignore[arg-type]


def _checked_note(key: str, value: object) -> object:
    if key == "frame" and isinstance(value, str):
        return value
    if key == "timestamp_ns" and isinstance(value, int) and abs(value) < 2**63:
        return value
    if key == "columns" and isinstance(value, list) and all(isinstance(v, str) for v in value):
        return tuple(value)
    if key == "shape" and isinstance(value, list):
        rows, columns = value
        if isinstance(rows, int) and isinstance(columns, int) and min(rows, columns) >= 0:
            return rows, columns
    raise ValueError(key)


def fit_names(columns: Iterable[tuple[str, AnyArray]]) -> dict[str, AnyArray]:
    """Columns by names that every format can hold: what cannot stand in one becomes `_`."""
    named: dict[str, AnyArray] = {}
    for name, column in columns:
        title = _UNFIT.sub("_", name) or "_"
        while title in named:
            title += "_"
        named[title] = column
    return named


def check_extras(cloud: PointCloud) -> None:
    """Raise unless each extra column can be a named field of numbers.

    Raises:
        StructureError: an illegal or taken name, another shape than (N,), not numbers.
    """
    for name, column in cloud.extra.items():
        where = f"PointCloud.extra[{name!r}]"
        if not _NAME.fullmatch(name):
            raise StructureError("its name", want="printable ASCII, no blank, no #", where=where)
        own = _OWN.get(name)
        if own is not None and (own in _TAKEN or getattr(cloud, own) is not None):
            raise StructureError(
                "the name of an own column of clouds", want="another name", where=where
            )
        if column.ndim != 1 or column.dtype.kind not in "biuf" or column.dtype.itemsize > 8:
            raise StructureError(
                f"{column.dtype} of shape {column.shape}",
                want="numbers of at most 8 bytes, shape (N,)",
                where=where,
            )


def scalar_fields(cloud: PointCloud) -> dict[str, AnyArray]:
    """Every column but xyz and rgb as (N,) arrays by field name, in file order.

    Raises:
        StructureError: an extra column that cannot be a named field.
    """
    check_extras(cloud)
    fields: dict[str, AnyArray] = {}
    if cloud.intensity is not None:
        fields["intensity"] = cloud.intensity
    if cloud.sigma_m is not None:
        fields["sigma_m"] = cloud.sigma_m
    if cloud.uv is not None:
        fields["u"], fields["v"] = cloud.uv[:, 0], cloud.uv[:, 1]
    return fields | dict(cloud.extra)


def storable(fields: Mapping[str, AnyArray]) -> tuple[dict[str, AnyArray], dict[str, str]]:
    """`fields` in dtypes that text-headed formats know (bool as uint8, float16 as float32).

    Returns:
        The fields, and the dtypes to be restored by name.
    """
    stored = {
        name: column.astype(_STORED_AS.get(column.dtype.name, column.dtype), copy=False)
        for name, column in fields.items()
    }
    return stored, {n: c.dtype.name for n, c in fields.items() if c.dtype.name in _STORED_AS}


def assemble(
    fields: dict[str, AnyArray], rgb: UInt8 | None, notes: Notes, shape: tuple[int, int] | None
) -> PointCloud:
    """The cloud of named (N,) fields; the inverse of `scalar_fields`.

    Args:
        fields: by name, x, y and z (any case) among them.
        rgb: (N, 3).
        notes: what the header said.
        shape: (rows, columns) that the format itself gives, or None.

    Raises:
        PointFileField: x, y or z is not there.
        PointFileHeader: the notes contradict the fields.
    """
    fields = dict(fields)
    xyz = _pop_xyz(fields)
    with np.errstate(over="ignore"):
        for name, dtype in notes.dtypes.items():
            if name in fields and fields[name].dtype.name == _STORED_AS.get(dtype):
                fields[name] = fields[name].astype(dtype)
        own = _pop_own(fields) if notes.columns is None else _pop_listed(fields, notes.columns)
    shape = notes.shape or shape
    if shape is None and notes.columns is None and not np.isfinite(xyz).all():
        shape = (1, len(xyz))  # points of others without a position: a cloud with holes
    if shape is not None and shape[0] * shape[1] != len(xyz):
        raise PointFileHeader(f"shape {shape} of {len(xyz)} points", want="their product")
    return PointCloud(
        xyz, notes.frame, notes.timestamp_ns, rgb=rgb, extra=fields, shape=shape, **own
    )


def _pop_xyz(fields: dict[str, AnyArray]) -> AnyArray:
    axes = ("x", "y", "z")
    names = {name.lower(): name for name in fields if name.lower() in axes}
    names |= {name: name for name in axes if name in fields}
    if len(names) < len(axes):
        raise PointFileField(
            f"fields {', '.join(fields)[:200] or 'none'}",
            want="x, y and z",
            fix="Check that the file holds points.",
        )
    columns = [fields.pop(names[axis]) for axis in axes]
    single = all(column.dtype == np.float32 for column in columns)
    xyz = np.empty((len(columns[0]), 3), np.float32 if single else np.float64)
    for axis, column in enumerate(columns):
        xyz[:, axis] = column
    return xyz


def _pop_listed(fields: dict[str, AnyArray], listed: tuple[str, ...]) -> dict[str, AnyArray]:
    own: dict[str, AnyArray] = {}
    try:
        for name in ("intensity", "sigma_m"):
            if name in listed:
                own[name] = fields.pop(name).astype(np.float32, copy=False)
        if "uv" in listed:
            uv = np.stack([fields.pop("u"), fields.pop("v")], axis=1)
            own["uv"] = uv.astype(np.float32, copy=False)
    except KeyError as error:
        raise PointFileHeader(
            f"no field {error}", want="the columns that the header's comment lists"
        ) from error
    return own


def _pop_own(fields: dict[str, AnyArray]) -> dict[str, AnyArray]:
    """In files of others only an intensity of 0-1 means what ours does; the rest are extras."""
    name = next((name for name in fields if name.lower() == "intensity"), None)
    if name is None or fields[name].dtype.kind != "f":
        return {}
    with np.errstate(invalid="ignore"):  # NaN, also of the kind that signals, is no other scale
        if np.any(np.abs(fields[name] - 0.5) > 0.5):
            return {}
    return {"intensity": fields.pop(name).astype(np.float32)}
