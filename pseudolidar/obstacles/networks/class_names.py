"""Names of a detector's classes: given, in its metadata, in a file beside it, or COCO's."""

from __future__ import annotations

import ast
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.errors import ModelError, PseudolidarError
from pseudolidar.formats.onnx.model import OnnxModel
from pseudolidar.formats.rigs.strict_yaml import parse_yaml
from pseudolidar.obstacles.networks.coco import COCO_BY_NUMBER, COCO_NAMES, MOST_COCO_LABELS
from pseudolidar.obstacles.networks.layout import NAMES_KEYS, DetectorLayout

_SUFFIXES = (".names", ".txt", ".yaml", ".yml", ".json")
# Words in the name of a file that lists classes, where it is not called as the network is.
_WORDS = ("class", "label", "names")
_NOTHING = ("background", "__background__", "???", "none")
_LARGEST_BYTES = 1_000_000
_WANT = "a name a line, or a list or numbered names under `names`"


@dataclass(frozen=True)
class ClassNames:
    """Names by the network's labels.

    Args:
        by_label: of the labels that have one.
        told_by: where they come from, for people.
    """

    by_label: dict[int, str]
    told_by: str

    def __getitem__(self, label: int) -> str:
        return self.by_label.get(label) or f"class {label}"


def listed_names(model: OnnxModel, given: Path | None) -> tuple[tuple[str, ...], str]:
    """Names that belong to this network for sure, in order, and where they come from; or none.

    A file that is given, then the network's metadata, then a file of its name beside it.

    Raises:
        ModelError: one of them cannot be read.
    """
    if given is not None:
        return names_of_file(given), given.name
    for key in NAMES_KEYS:
        if text := model.metadata.get(key):
            return _of_metadata(model, key, text), "its metadata"
    for suffix in _SUFFIXES:
        path = model.path.with_suffix(suffix)
        if path.is_file() and (names := _of_sidecar(path)):
            return names, path.name
    return (), ""


def class_names(model: OnnxModel, layout: DetectorLayout, given: Path | None) -> ClassNames:
    """Names of the labels of a network whose layout is known.

    Where none are listed, a file with `class`, `label` or `names` in its name, in the network's
    folder, is taken if it is the only one with as many names as there are classes; then COCO's.

    Raises:
        ModelError: a list cannot be read, or has another number of classes than the network.
    """
    names, origin = listed_names(model, given)
    if not names:
        names, origin = _nearby(model.path.parent, layout.classes)
    first = layout.first_label or 0
    if names:
        if names[0].lower() in _NOTHING:
            first = 0
        elif layout.classes and first == 0 and len(names) != layout.classes:
            raise ModelError(
                f"{len(names)} class names in {origin}",
                want=f"{layout.classes}, as the network has",
                path=model.path,
                where="names",
            )
        return ClassNames({first + i: name for i, name in enumerate(names)}, origin)
    if first == 1 and layout.classes in (None, MOST_COCO_LABELS - 1, MOST_COCO_LABELS):
        return ClassNames(dict(COCO_BY_NUMBER), "COCO (by annotation number)")
    if layout.classes in (None, len(COCO_NAMES)):
        return ClassNames({first + i: name for i, name in enumerate(COCO_NAMES)}, "COCO")
    return ClassNames({}, "nobody")


def names_of_file(path: Path) -> tuple[str, ...]:
    """The names that a file lists, in the order of their numbers.

    Raises:
        ModelError: absent, or no list of names.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST_BYTES + 1)
        if len(data) > _LARGEST_BYTES:
            raise ValueError(f"more than {_LARGEST_BYTES} bytes")
        names = _parsed(data.decode("utf-8-sig"), path)
    except OSError as error:
        raise ModelError(
            error.strerror or str(error), want=_WANT, fix="Check the path.", path=path
        ) from error
    except (ValueError, RecursionError) as error:
        raise ModelError(f"no class names: {error}", want=_WANT, path=path) from error
    except PseudolidarError as error:
        raise ModelError(
            f"no class names: {error.got}", want=_WANT, path=path, where=error.where
        ) from error
    if not names:
        raise ModelError("no class names", want=_WANT, path=path)
    return names


def _of_sidecar(path: Path) -> tuple[str, ...]:
    """Names of a file that may hold something else: a JSON file with the layout alone."""
    if path.suffix == ".json":
        values = json.loads(path.read_bytes()[:_LARGEST_BYTES])  # read before, with its errors
        if isinstance(values, dict) and not set(values) & set(NAMES_KEYS):
            return ()
    return names_of_file(path)


def _parsed(text: str, path: Path) -> tuple[str, ...]:
    match path.suffix.lower():
        case ".json":
            return _ordered(_under_key(json.loads(text)))
        case ".yaml" | ".yml":
            return _ordered(_plain(parse_yaml(_names_block(text), path)[0].value))
        case _:
            lines = [line.strip() for line in text.splitlines()]
            return tuple(line for line in lines if line)


def _under_key(values: Any) -> Any:
    if isinstance(values, dict):
        return next((values[key] for key in NAMES_KEYS if key in values), values)
    return values


def _names_block(text: str) -> str:
    """What stands under `names:`; the rest of a training file may be any YAML."""
    lines = text.splitlines()
    starts = [i for i, line in enumerate(lines) if line.startswith("names:")]
    if not starts:
        raise ValueError("no key `names`")
    start = starts[0]
    end = start + 1
    while end < len(lines) and (not lines[end].strip() or lines[end][0] in " \t-#]}"):
        end += 1
    return "\n".join(lines[start:end]) + "\n"


def _plain(value: Any) -> Any:
    """Values without their places, of the one key `names`."""
    names = value["names"].value
    if isinstance(names, dict):
        return {key: node.value for key, node in names.items()}
    return [node.value for node in names] if isinstance(names, tuple) else names


def _of_metadata(model: OnnxModel, key: str, text: str) -> tuple[str, ...]:
    """As Ultralytics writes them, a Python literal; or JSON; or a comma list."""
    try:
        if text.lstrip()[:1] not in "{[":
            return tuple(part.strip() for part in text.split(",") if part.strip())
        try:
            values = json.loads(text)
        except ValueError:
            values = ast.literal_eval(text)  # literals only: it runs nothing
        return _ordered(values)
    except (ValueError, SyntaxError, RecursionError, MemoryError) as error:
        raise ModelError(
            f"metadata {key} = {text[:60]!r}: no class names",
            want="{0: 'name', ...} or a list",
            path=model.path,
        ) from error


def _ordered(values: Any) -> tuple[str, ...]:
    """Names of a list, or of numbers with names; a number left out gets none.

    Raises:
        ValueError: anything else.
    """
    if isinstance(values, list | tuple):
        names = list(values)
    elif isinstance(values, dict) and values:
        by_number = {int(number): name for number, name in values.items()}
        if min(by_number) < 0 or max(by_number) > 100_000:
            raise ValueError("numbers of classes beyond 100000")
        names = [by_number.get(i, "???") for i in range(max(by_number) + 1)]
    else:
        raise ValueError("neither a list nor numbered names")
    if not all(isinstance(name, str | int | float) for name in names):
        raise ValueError("names that are no text")
    return tuple(str(name) for name in names)


def _nearby(folder: Path, classes: int | None) -> tuple[tuple[str, ...], str]:
    """Of the lists in a folder, the only one of the right length."""
    fitting = []
    for path in sorted(folder.iterdir()) if classes else []:
        called = any(word in path.stem.lower() for word in _WORDS) or path.suffix == ".names"
        if called and path.suffix.lower() in _SUFFIXES and path.is_file():
            try:
                names = names_of_file(path)
            except ModelError:  # somebody else's file
                continue
            if len(names) == classes:
                fitting.append((names, path.name))
    return fitting[0] if len(fitting) == 1 else ((), "")
