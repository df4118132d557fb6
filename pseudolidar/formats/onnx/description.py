"""What is known of how a network is fed and read: dataclasses of fields that are None until known.

They are filled from flags, a JSON file beside the network and the network's own metadata.
"""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_type_hints

from pseudolidar.errors import ModelError
from pseudolidar.formats.onnx.model import OnnxModel

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Description = TypeVar("Description", bound=DataclassInstance)

PREFIX = "pseudolidar."  # of our keys in a network's own metadata
_LARGEST_SIDECAR_BYTES = 100_000


def unknown_fields(description: DataclassInstance) -> tuple[str, ...]:
    """Names of the fields that are not known."""
    return tuple(f.name for f in fields(description) if getattr(description, f.name) is None)


def filled(description: Description, other: Description) -> Description:
    """With what `other` knows where this one does not."""
    return replace(
        description, **{name: getattr(other, name) for name in unknown_fields(description)}
    )


def known_values(description: DataclassInstance) -> dict[str, Any]:
    """The known fields, plain JSON values."""
    values = {f.name: getattr(description, f.name) for f in fields(description)}
    return {name: value for name, value in values.items() if value is not None}


def as_flags(description: DataclassInstance, flag: str) -> str:
    """The command line flags that say the same, each beginning with `flag`."""
    return " ".join(
        f"{flag}.{name.replace('_', '-')} {value}"
        for name, value in known_values(description).items()
    )


def check_choices(description: DataclassInstance) -> None:
    """Refuse a text that is none of its field's choices.

    Raises:
        ModelError: with the field as place.
    """
    for name, kind in get_type_hints(type(description)).items():
        choices = [c for part in get_args(kind) for c in get_args(part)]
        value = getattr(description, name)
        if choices and value is not None and value not in choices:
            raise ModelError(f"{name} {value!r}", want=" or ".join(map(str, choices)), where=name)


def of_values(cls: type[Description], values: dict[str, Any], path: Path) -> Description:
    """From the fields of a file.

    Raises:
        ModelError: a field is unknown, or its value is not legal.
    """
    names = [f.name for f in fields(cls)]
    for name, value in values.items():
        if name not in names:
            raise ModelError(f"unknown field {name!r}", want=", ".join(names), path=path)
        kinds = _kinds(cls, name)
        if type(value) not in kinds:
            raise ModelError(f"{name} = {value!r}", want=kinds[0].__name__, path=path)
    try:
        return cls(**values)
    except ModelError as error:
        raise error.located(path) from None


def of_metadata(cls: type[Description], model: OnnxModel) -> Description:
    """From the keys of ours in a network's own metadata.

    Raises:
        ModelError: one of them is unknown, or not legal.
    """
    values: dict[str, Any] = {}
    names = {f.name for f in fields(cls)}
    for key, text in model.metadata.items():
        if key.startswith(PREFIX):
            name = key.removeprefix(PREFIX)
            number = name in names and str not in _kinds(cls, name)
            try:
                values[name] = json.loads(text) if number else text
            except ValueError as error:
                raise ModelError(
                    f"metadata {key} = {text!r}", want="a number", path=model.path
                ) from error
    return of_values(cls, values, model.path)


def json_beside(model: OnnxModel, example: str) -> tuple[Path, Any] | None:
    """The JSON file of a network's name beside it; None where there is none.

    Args:
        model: the network.
        example: of what is wanted there.

    Raises:
        ModelError: it cannot be read.
    """
    path = model.path.with_suffix(".json")
    if not path.is_file():
        return None
    try:
        with path.open("rb") as file:
            return path, json.loads(file.read(_LARGEST_SIDECAR_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        raise ModelError(f"not a layout: {error}", want=example, path=path) from error


def _kinds(cls: type[DataclassInstance], name: str) -> tuple[type, ...]:
    """Types of JSON that a field may have; an int may stand for a float."""
    kinds = [part for part in get_args(get_type_hints(cls)[name]) if part is not type(None)]
    if float in kinds:
        return (float, int)
    return (int,) if int in kinds else (str,)
