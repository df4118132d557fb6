"""The licence that a network's metadata or a file beside it names."""

from __future__ import annotations

from pseudolidar.formats.onnx.model import OnnxModel

_KEYS = ("license", "licence", "License", "Licence")
_FILES = ("LICENSE", "LICENSE.txt", "LICENSE.md", "LICENCE", "COPYING")
_READ_BYTES = 4096
_LONGEST_SHOWN = 80


def licence_of(model: OnnxModel) -> str:
    """One line; weights may have other terms than this says."""
    for key in _KEYS:
        if text := model.metadata.get(key, "").strip():
            return f"{_first_line(text)} (its metadata)"
    for name in _FILES:
        path = model.path.parent / name
        if path.is_file():
            with path.open("rb") as file:
                text = file.read(_READ_BYTES).decode("utf-8", "replace")
            return f"{_first_line(text)} (file {name} beside it)"
    return "not said"


def _first_line(text: str) -> str:
    lines = [" ".join(line.split()) for line in text.splitlines()]
    line = next((line for line in lines if line), "empty")
    return "".join(c for c in line if c.isprintable())[:_LONGEST_SHOWN]
