"""What docstrings of settings say: of the whole, and of each field."""

from __future__ import annotations

import inspect
import re
from dataclasses import dataclass

_SECTION = re.compile(r"^(Args|Attributes|Examples?|Returns|Raises|Source|Note):\s*(.*)$")
_INDENT = "    "
_BLANK_LINES = re.compile(r"\n{3,}")
_ENTRY = re.compile(r"^\s+(\w+):\s*(.*)$")


@dataclass(frozen=True)
class DocParts:
    """A Google docstring taken apart.

    Args:
        summary: first paragraph.
        body: what stands before the first section, the summary included.
        fields: text of each entry under `Args`.
        examples: lines under `Examples`, and indented ones in the body.
    """

    summary: str
    body: str
    fields: dict[str, str]
    examples: tuple[str, ...]


def doc_parts(doc: str) -> DocParts:
    """Take a Google docstring apart; absent parts are empty."""
    sections: dict[str, list[str]] = {"": []}
    name = ""
    for line in doc.splitlines():
        if match := _SECTION.match(line):
            name = match[1]
            line = match[2]
        sections.setdefault(name, []).append(line)
    text = [line for line in sections[""] if not line.startswith(_INDENT)]
    indented = [line for line in sections[""] if line.startswith(_INDENT)]
    body = _BLANK_LINES.sub("\n\n", "\n".join(text).strip())
    examples = indented + sections.get("Examples", []) + sections.get("Example", [])
    return DocParts(
        summary=" ".join(body.split("\n\n")[0].split()),
        body=body,
        fields=_entries(sections.get("Args", []) + sections.get("Attributes", [])),
        examples=tuple(line.strip() for line in examples if line.strip()),
    )


def class_doc(cls: type) -> DocParts:
    """The docstring of a settings class, taken apart."""
    return doc_parts(inspect.cleandoc(cls.__doc__ or ""))


def _entries(lines: list[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    name = ""
    indents = [len(line) - len(line.lstrip()) for line in lines if line.strip()]
    for line in lines:
        match = _ENTRY.match(line)
        if match and len(line) - len(line.lstrip()) == min(indents):
            name = match[1]
            found[name] = match[2]
        elif name and line.strip():
            found[name] += " " + line.strip()
    return found
