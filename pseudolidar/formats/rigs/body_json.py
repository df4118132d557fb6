"""Rig files with several pairs on one body; read_x beside write_x.

    {"schema": 1, "pairs": {"front": {"T_base_link_left": {"R": ..., "t_m": ...}, "width_px": ...}}}

Each pair has the fields of a rig file besides its place. `rig.json#front` means one of them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pseudolidar.errors import (
    CalibrationField,
    CalibrationSyntax,
    PseudolidarError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.placed import Node
from pseudolidar.formats.rigs.rig_fields import fields_of, numbers, text, wrong
from pseudolidar.formats.rigs.rig_json import (
    SCHEMA,
    checked_schema,
    missing_rig,
    pose_fields,
    pretty,
    rig_fields_of,
    rig_of_fields,
)
from pseudolidar.formats.rigs.rig_parts import LEFT, optional_pose
from pseudolidar.formats.rigs.strict_json import parse_json
from pseudolidar.formats.text import read_lines
from pseudolidar.structures.body import BASE_LINK, BodyRig, MountedPair
from pseudolidar.structures.camera import StereoRig

PAIRS, PLACE, PLACE_SIGMA = "pairs", "T_base_link_left", "T_base_link_left_sigma"
_SIGMAS = {"rotation_rad": "rotation_sigma_rad", "t_m": "translation_sigma_m"}
# Between a rig file and the name of one of its pairs.
MARK = "#"


def has_pairs(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> bool:
    """Whether a file is a rig file of several pairs; False for what is none or is not there."""
    try:
        lines = read_lines(path, error=CalibrationSyntax, limits=limits)
    except PseudolidarError:
        return False
    return any(f'"{PAIRS}"' in line.text for line in lines)


def read_body(path: str | Path, *, limits: Limits = DEFAULT_LIMITS) -> BodyRig:
    """Read the pairs of a rig file.

    Raises:
        CalibrationMissing: no such file.
        CalibrationSyntax, CalibrationField, CalibrationValue: as `read_rig`, with the pair's name.
    """
    path = Path(path)
    if not path.exists():
        raise missing_rig(path)
    lines = read_lines(path, error=CalibrationSyntax, limits=limits)
    return parse_body("\n".join(line.text for line in lines), path)


def parse_body(document: str, path: str | Path) -> BodyRig:
    """The pairs in `document`; `path` names it in errors. Raises as `read_body`."""
    root = parse_json(document, path)
    fields = fields_of(root, ("schema", PAIRS), ("$schema", "origin"))
    checked_schema(fields["schema"])
    held = fields[PAIRS]
    if not isinstance(held.value, dict):
        raise wrong(held, 'pairs by their names, {"front": { }, ... }')
    try:
        pairs = tuple(_mounted(name, node) for name, node in held.value.items())
        return BodyRig(pairs, text(fields["origin"]) if "origin" in fields else "")
    except PseudolidarError as error:
        raise error.located(path, held.where) from None


def _mounted(name: str, node: Node) -> MountedPair:
    rig, fields = rig_of_fields(node, (PLACE,), (PLACE_SIGMA,))
    place = optional_pose(fields, PLACE, BASE_LINK, LEFT)
    assert place is not None  # required above
    sigmas: dict[str, Any] = {}
    if PLACE_SIGMA in fields:
        held = fields_of(fields[PLACE_SIGMA], tuple(_SIGMAS))
        sigmas = {_SIGMAS[key]: numbers(held[key], 3) for key in _SIGMAS}
    return MountedPair(name, rig, place, **sigmas)


def read_pair(path: str | Path, *, limits: Limits = DEFAULT_LIMITS) -> StereoRig:
    """The rig of `rig.json#front`.

    Raises:
        CalibrationField: no pair of that name.
        PseudolidarError: as `read_body`.
    """
    file, _, name = str(path).rpartition(MARK)
    body = read_body(file, limits=limits)
    if name not in body.names:
        raise CalibrationField(
            f"no pair {name!r}; found {', '.join(body.names)}",
            want="the name of a pair",
            path=file,
            where=PAIRS,
        )
    return body[name].rig


def write_body(path: str | Path, body: BodyRig) -> None:
    """Write the pairs of a body; reading them gives the same, bit for bit.

    Raises:
        StructureError: frames of a rig have other names than the file's.
        OutputError: the disk is full or not writable.
    """
    write_atomic(Path(path), body_text(body).encode())


def body_text(body: BodyRig) -> str:
    """The pairs as text of a rig file."""
    fields: dict[str, Any] = {"schema": SCHEMA}
    if body.origin:
        fields["origin"] = body.origin
    fields[PAIRS] = {pair.name: _mounted_fields(pair) for pair in body.pairs}
    return pretty(fields) + "\n"


def _mounted_fields(pair: MountedPair) -> dict[str, Any]:
    fields: dict[str, Any] = {PLACE: pose_fields(pair.T_base_link_left)}
    if pair.rotation_sigma_rad is not None and pair.translation_sigma_m is not None:
        fields[PLACE_SIGMA] = {key: getattr(pair, name).tolist() for key, name in _SIGMAS.items()}
    return fields | rig_fields_of(pair.rig)
