"""Which files of a folder hold the calibration of its pictures, by their names."""

from __future__ import annotations

from pathlib import Path

from pseudolidar.errors import PseudolidarError
from pseudolidar.formats.rigs.body_json import MARK, has_pairs, read_body
from pseudolidar.formats.rigs.opencv_rig import SUFFIXES, eye_of

# Files that a folder of pictures can have its rig in, the surest first.
BODY_FILE = "rig.json"
K_TXT = "k.txt"
RIG_FILES = (BODY_FILE, "calib.txt", "K.txt", "k.txt", "intrinsic.txt")
# Words in the names of YAML, XML and JSON files that hold a camera or a pair.
_PAIR_WORDS = (
    "stereo",
    "calib",
    "intrinsic",
    "extrinsic",
    "camera_info",
    "cameraparam",
    "rig",
    "camchain",
)
# Words in the names of text files that hold the projection matrices of a pair, or of one eye.
_PROJECTION_WORDS = ("camera", "projection", "p_left", "p_right")


def find_rig(folder: Path) -> Path | None:
    """The file with the rig of the pictures in `folder`; the folder itself where it takes several.

    Only names are looked at; where none is known, the folder may be that of a pair of a body, whose
    rig file lies beside it.
    """
    for name in RIG_FILES:
        if (folder / name).exists():
            return folder / name
    files = storage_files(folder) or projection_files(folder)
    if not files:
        return rig_on_body(folder)
    return next(iter(files.values())) if len(files) == 1 else folder


def rig_on_body(folder: Path) -> Path | None:
    """`rig.json#front` where the rig file beside the folder `front` has a pair of that name."""
    named = folder if folder.name not in ("", "..") else folder.resolve()
    file = named.parent / BODY_FILE
    try:
        known = file.is_file() and has_pairs(file) and named.name in read_body(file).names
    except PseudolidarError:
        return None  # whoever opens the body is told why
    return Path(f"{file}{MARK}{named.name}") if known else None


def storage_files(folder: Path) -> dict[str, Path]:
    """Files of a folder that may hold cameras, by `left`, `right`, or their name."""
    if not folder.is_dir():
        return {}
    found: dict[str, Path] = {}
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() not in SUFFIXES or not file.is_file():
            continue
        eye = eye_of(file.stem)
        if eye is not None:
            found.setdefault(eye, file)
        elif any(word in file.stem.lower() for word in _PAIR_WORDS):
            found[file.name] = file
    return found


def projection_files(folder: Path) -> dict[str, Path]:
    """Text files of a folder that may hold projection matrices: one of both, or one for each eye.

    Of a folder with more of them nothing is known.
    """
    named = [
        file
        for file in sorted(folder.glob("*.txt"))
        if any(word in file.stem.lower() for word in _PROJECTION_WORDS) and file.is_file()
    ]
    eyes = {eye: file for file in named if (eye := eye_of(file.stem)) is not None}
    if len(eyes) == len(named) == 2:
        return {"left": eyes["left"], "right": eyes["right"]}
    return {named[0].name: named[0]} if len(named) == 1 else {}
