"""Print constraints: the installed versions of all that the package and its development need."""

import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

PROJECT = tomllib.loads(Path("pyproject.toml").read_text())["project"]


def requirements(name: str, extras: set[str]) -> list[Requirement]:
    """What a distribution requires here."""
    if name == PROJECT["name"]:
        optional = PROJECT["optional-dependencies"]
        texts = [*PROJECT["dependencies"], *(text for extra in extras for text in optional[extra])]
    else:
        texts = metadata.requires(name) or []
    found = map(Requirement, texts)
    return [
        requirement
        for requirement in found
        if requirement.marker is None
        or any(requirement.marker.evaluate({"extra": extra}) for extra in extras | {""})
    ]


def closure(name: str, extras: set[str], pins: dict[str, str]) -> None:
    """Add everything that a distribution requires, directly or not."""
    for requirement in requirements(name, extras):
        key = re.sub(r"[-_.]+", "-", requirement.name).lower()
        wanted = f"{key}{sorted(requirement.extras)}"
        if wanted not in pins:
            try:
                pins[wanted] = f"{key}=={metadata.version(key)}"
            except metadata.PackageNotFoundError:
                sys.stderr.write(f"{key}, which {name} needs, is not installed\n")
                continue
            closure(key, requirement.extras, pins)


pins: dict[str, str] = {}
closure(PROJECT["name"], {"dev"}, pins)
lines = sorted({pin for pin in pins.values() if not pin.startswith(PROJECT["name"])})
sys.stdout.write("# The versions that CI runs with, as printed by .ci/freeze.py.\n")
sys.stdout.write("\n".join(lines) + "\n")
