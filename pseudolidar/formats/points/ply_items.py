"""Items of PLY elements, taken from the bytes or lines of a file; lists are walked over."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from pseudolidar.errors import MeshIndex, PointFileCorrupt, PointFileTruncated
from pseudolidar.formats.points.ascii_table import decode_table
from pseudolidar.formats.points.ply_header import PlyElement, PlyProperty
from pseudolidar.formats.points.point_file import check_claim
from pseudolidar.structures.arrays import AnyArray, Bool, Int64, UInt8

Columns = dict[str, AnyArray]
# What programs call the list of a face's vertices.
_FACE_LISTS = ("vertex_indices", "vertex_index")
_LONGEST_COUNT = 10  # digits of a list's length, or of a vertex's number, in text


def binary_items(
    data: bytes, at: int, element: PlyElement, *, vertices: int
) -> tuple[Columns, int]:
    """Single-valued properties of a binary element, and the byte behind its last item.

    Args:
        data: the file.
        at: where the element begins.
        element: what its items have.
        vertices: how many there are, to judge faces by.

    Raises:
        PointFileTruncated: the file ends within it.
        PointFileCorrupt: a list of negative length.
        MeshIndex: a face of a vertex that is not there.
    """
    claimed = element.count * element.smallest_bytes
    check_claim(claimed, len(data) - at, items=element.count, at_byte=at)
    if not element.properties or not element.count:
        return {p.name: np.zeros(0, p.dtype) for p in element.properties}, at
    lengths = _first_lengths(data, at, element)
    fixed = _fixed_items(data, at, element, lengths, vertices)
    return _walked_items(data, at, element, vertices) if fixed is None else fixed


def _first_lengths(data: bytes, at: int, element: PlyElement) -> list[int]:
    """Length of each property of the first item; 1 for single values."""
    lengths = []
    for p in element.properties:
        length, size = 1, p.dtype.itemsize
        if p.length is not None:
            length, at = _length(data, at, p.length)
        lengths.append(length)
        at += length * size
    return lengths


def _length(data: bytes, at: int, dtype: np.dtype[np.generic]) -> tuple[int, int]:
    check_claim(dtype.itemsize, len(data) - at, items=1, at_byte=at)
    length = int(np.frombuffer(data, dtype, 1, at)[0])
    if length < 0:
        raise PointFileCorrupt(f"a list of {length} values", want="0 or more", where=f"byte {at}")
    return length, at + dtype.itemsize


def _fixed_items(
    data: bytes, at: int, element: PlyElement, lengths: Sequence[int], vertices: int
) -> tuple[Columns, int] | None:
    """The items if all have lists of the same `lengths` (triangles), else None."""
    fields: list[tuple[str, object, tuple[int, ...]]] = []
    size = 0
    for i, (p, length) in enumerate(zip(element.properties, lengths, strict=True)):
        if p.length is not None:
            fields.append((f"n{i}", p.length, ()))
            size += p.length.itemsize
        fields.append((f"v{i}", p.dtype, () if p.length is None else (length,)))
        size += p.dtype.itemsize * length
    if size * element.count > len(data) - at:
        if not element.has_lists:
            check_claim(size * element.count, len(data) - at, items=element.count, at_byte=at)
        return None
    items = np.frombuffer(data, np.dtype(fields), element.count, at)
    columns: Columns = {}
    for i, (p, length) in enumerate(zip(element.properties, lengths, strict=True)):
        if p.length is None:
            columns[p.name] = items[f"v{i}"].astype(p.dtype.newbyteorder("="))
        elif np.any(items[f"n{i}"] != length):
            return None
    for i, p in enumerate(element.properties):
        if _names_vertices(element, p):
            _check_faces(items[f"v{i}"], vertices)
    return columns, at + size * element.count


def _walked_items(data: bytes, at: int, element: PlyElement, vertices: int) -> tuple[Columns, int]:
    """The items, each with lists of its own lengths, found one by one."""
    single = [p for p in element.properties if p.length is None]
    places = np.empty((element.count, len(single)), np.int64)
    faces: dict[str, list[tuple[int, int]]] = {}
    for item in range(element.count):
        column = 0
        for p in element.properties:
            if p.length is None:
                places[item, column] = at
                column, at = column + 1, at + p.dtype.itemsize
            else:
                length, at = _length(data, at, p.length)
                if _names_vertices(element, p):
                    faces.setdefault(p.name, []).append((at, length))
                at += length * p.dtype.itemsize
        if at > len(data):
            raise PointFileTruncated(
                f"{item} of {element.count} items of {element.name!r}",
                want="all of them",
                fix="Copy or make the file again: it ends early.",
                where=f"byte {len(data)}",
            )
    raw = np.frombuffer(data, np.uint8)
    for p in element.properties:
        if p.name in faces:
            _check_walked(raw, np.array(faces[p.name], np.int64), p, vertices)
    gathered = {p.name: _gathered(raw, places[:, i], p.dtype) for i, p in enumerate(single)}
    return gathered, at


def _check_walked(raw: UInt8, lists: Int64, p: PlyProperty, vertices: int) -> None:
    """Check faces of (F, 2) places and lengths."""
    starts, lengths = lists[:, 0], lists[:, 1]
    face = np.repeat(np.arange(len(lists)), lengths)
    within = np.arange(len(face)) - (np.cumsum(lengths) - lengths)[face]
    numbers = _gathered(raw, starts[face] + within * p.dtype.itemsize, p.dtype)
    bad = np.zeros(len(lists), np.bool_)
    bad[face[_absent(numbers, vertices)]] = True
    if bad.any():
        first = int(np.argmax(bad))
        raise _no_vertex(first, numbers[face == first], vertices)


def _names_vertices(element: PlyElement, p: PlyProperty) -> bool:
    """Whether a property is the list of a face's vertices."""
    return element.name == "face" and p.name in _FACE_LISTS and p.length is not None


def _absent(numbers: AnyArray, vertices: int) -> Bool:
    """Numbers that no vertex has; written so that NaN is one of them."""
    return np.asarray(~((numbers >= 0) & (numbers < vertices)))


def _check_faces(numbers: AnyArray, vertices: int) -> None:
    bad = np.asarray(_absent(numbers, vertices).any(axis=1))
    if bad.any():
        first = int(np.argmax(bad))
        raise _no_vertex(first, numbers[first], vertices)


def _no_vertex(face: int, numbers: Iterable[Any], vertices: int) -> MeshIndex:
    shown = " ".join(str(number) for number in itertools.islice(numbers, 8))
    return MeshIndex(
        f"a face of the vertices {shown}",
        want=f"numbers from 0 to {vertices - 1}" if vertices else "no faces without vertices",
        fix="Make the file again, or save its points alone.",
        where=f"face {face}",
    )


def _gathered(raw: UInt8, places: Int64, dtype: np.dtype[np.generic]) -> AnyArray:
    values: AnyArray = raw[places[:, None] + np.arange(dtype.itemsize)].view(dtype)[:, 0]
    return values.astype(dtype.newbyteorder("="))


def ascii_items(body: bytes, element: PlyElement, *, vertices: int) -> Columns:
    """Single-valued properties of an element whose items are the lines of `body`.

    Args:
        body: the lines.
        element: what they have.
        vertices: how many there are, to judge faces by.

    Raises:
        PointFileTruncated, PointFileCorrupt: lines are missing, or hold something else.
        MeshIndex: a face of a vertex that is not there.
    """
    single = [p for p in element.properties if p.length is None]
    if element.has_lists:
        lines = body.split(b"\n")[:-1]
        rows = [_single_words(line, i, element, vertices) for i, line in enumerate(lines)]
        body = b"".join(row + b"\n" for row in rows)
        if not single:
            return {}
    dtypes = [p.dtype.newbyteorder("=") for p in single]
    columns = decode_table(body, dtypes, element.count)
    return {p.name: column for p, column in zip(single, columns, strict=True)}


def _single_words(line: bytes, index: int, element: PlyElement, vertices: int) -> bytes:
    words, kept, at = line.split(), [], 0
    for p in element.properties:
        length = 1
        if p.length is None:
            kept += words[at : at + 1]
        elif at < len(words) and words[at].isdigit() and len(words[at]) < _LONGEST_COUNT:
            length = 1 + int(words[at])
            if _names_vertices(element, p):
                numbers = words[at + 1 : at + length]
                if not all(_is_vertex(number, vertices) for number in numbers):
                    raise _no_vertex(index, (n.decode(errors="replace") for n in numbers), vertices)
        else:
            at = len(words) + 1
        at += length
    if at != len(words):
        raise PointFileCorrupt(
            f"{len(words)} values that do not fit the lists among them",
            want="the length of each list before its values",
            where=f"line {index + 1} of {element.name!r}",
        )
    return b" ".join(kept)


def _is_vertex(word: bytes, vertices: int) -> bool:
    return word.isdigit() and len(word) < _LONGEST_COUNT and int(word) < vertices
