"""How depth data sets lay out pictures, depth, times, poses and the camera."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.errors import ImageMissing, PairMismatch, PseudolidarError, SourceEmpty
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.pictures.map_pixels import READERS
from pseudolidar.formats.tum import TimedName, read_associations, read_picture_list
from pseudolidar.sources.folder_layout import list_pictures
from pseudolidar.sources.names import natural_key, safe_id
from pseudolidar.sources.timed_pairs import associate

PICTURES_LIST, DEPTH_LIST = "rgb.txt", "depth.txt"
ASSOCIATIONS = ("associations.txt", "association.txt", "associated.txt")
TRAJECTORY = "groundtruth.txt"
PICTURE_FOLDERS = ("rgb", "color", "colour", "image", "images", "results")
DEPTH_FOLDERS = ("depth", "depths", "results")
# Files that a folder can have its camera in.
CAMERA_FILES = (
    "K.txt",
    "intrinsics.txt",
    "intrinsic.txt",
    "camera-intrinsics.txt",
    "intrinsic/intrinsic_color.txt",
    "intrinsic/intrinsic_depth.txt",
    "camera.json",
    "cam_params.json",
    "camera_intrinsic.json",
    "intrinsic.json",
    "intrinsics.json",
    "rig.json",
    "camera.yaml",
    "camera_info.yaml",
    "calibration.yaml",
)
_NUMBERS = re.compile(r"[0-9]+")


@dataclass(frozen=True)
class DepthPair:
    """A picture and the depth of its pixels.

    Args:
        name: of the frame.
        picture: file.
        depth: file.
        time_ns: of the picture, None where nobody knows.
    """

    name: str
    picture: Path
    depth: Path
    time_ns: int | None = None


@dataclass(frozen=True)
class DepthLayout:
    """The pairs of a folder.

    Args:
        pairs: in order of time or number.
        refused: frames without a partner, with the reason.
        rule: how they were paired, in words.
        timed: whether it is TUM's layout, with times in lists.
    """

    pairs: tuple[DepthPair, ...]
    refused: tuple[tuple[str, PseudolidarError], ...]
    rule: str
    timed: bool


def has_layout(folder: Path) -> bool:
    """Whether a folder holds pictures with depth, by what lies in it."""
    if (folder / PICTURES_LIST).is_file() and (folder / DEPTH_LIST).is_file():
        return True
    if any((folder / name).is_file() for name in ASSOCIATIONS):
        return True
    return _folders(folder) is not None


def find_depth_layout(folder: Path, *, tolerance_s: float, limits: Limits) -> DepthLayout:
    """The pairs of a folder: by its associations, by times within a tolerance, by number.

    Raises:
        SourceEmpty: not one pair.
        SequenceTime: a list that is not legal; by line.
    """
    associations = next((folder / n for n in ASSOCIATIONS if (folder / n).is_file()), None)
    if associations is not None:
        found = _associated(folder, associations, limits)
    elif (folder / PICTURES_LIST).is_file():
        found = _by_time(folder, tolerance_s, limits)
    else:
        found = _by_number(folder)
    if not found.pairs:
        raise SourceEmpty(
            f"no picture has a depth, of {len(found.refused)}",
            want="pictures and depth of the same number, or times within the tolerance",
            path=folder,
        )
    return found


def find_camera(folder: Path) -> Path | None:
    """The file with the camera, if there is one."""
    return next((folder / name for name in CAMERA_FILES if (folder / name).is_file()), None)


def _associated(folder: Path, path: Path, limits: Limits) -> DepthLayout:
    """Pairs as a file says them; depth may come first (ICL-NUIM)."""
    pairs = []
    for first, second in read_associations(path, limits=limits):
        swapped = "depth" in Path(first.name).parts[0].lower()
        picture, depth = (second, first) if swapped else (first, second)
        pairs.append(_timed_pair(folder, picture, depth))
    pairs.sort(key=lambda pair: pair.time_ns or 0)
    return DepthLayout(tuple(pairs), (), path.name, timed=True)


def _timed_pair(folder: Path, picture: TimedName, depth: TimedName) -> DepthPair:
    name = safe_id(Path(picture.name).stem)
    return DepthPair(name, folder / picture.name, folder / depth.name, picture.time_ns)


def _by_time(folder: Path, tolerance_s: float, limits: Limits) -> DepthLayout:
    pictures = read_picture_list(folder / PICTURES_LIST, limits=limits)
    depths = read_picture_list(folder / DEPTH_LIST, limits=limits)
    matched = associate(
        [p.time_ns for p in pictures],
        [d.time_ns for d in depths],
        tolerance_ns=round(tolerance_s * 1e9),
    )
    pairs = tuple(_timed_pair(folder, pictures[i], depths[j]) for i, j in matched)
    rule = f"times within {tolerance_s * 1e3:g} ms"
    used = {i for i, _ in matched}
    refused = tuple(
        (safe_id(Path(p.name).stem), _alone(folder / p.name, rule))
        for i, p in enumerate(pictures)
        if i not in used
    )
    return DepthLayout(pairs, refused, rule, timed=True)


def _by_number(folder: Path) -> DepthLayout:
    places = _folders(folder)
    assert places is not None
    colour, depth_folder = places
    pictures, twice = _numbered([p for p in list_pictures(colour) if _is_picture(p, depth_folder)])
    depths, twice_depth = _numbered(_depth_files(depth_folder, colour))
    keys = [key for key in pictures if key in depths]
    pairs = tuple(
        DepthPair(safe_id(pictures[key].stem), pictures[key], depths[key])
        for key in sorted(keys, key=lambda key: natural_key(pictures[key].stem))
    )
    rule = "equal numbers in the names"
    alone = [
        (safe_id(pictures[k].stem), _alone(pictures[k], rule)) for k in pictures if k not in depths
    ]
    return DepthLayout(pairs, (*alone, *twice, *twice_depth), rule, timed=False)


def _numbered(
    files: list[Path],
) -> tuple[dict[tuple[int, ...], Path], list[tuple[str, PseudolidarError]]]:
    """Files by the numbers in their names; those without a number are left out."""
    found: dict[tuple[int, ...], Path] = {}
    twice: list[tuple[str, PseudolidarError]] = []
    for file in files:
        key = tuple(int(part) for part in _NUMBERS.findall(file.stem))
        if not key:
            continue
        if key in found:
            error = PairMismatch(
                f"{found[key].name} and {file.name} have the same number",
                want="one file a frame",
                path=file,
            )
            twice.append((safe_id(file.name), error))
        else:
            found[key] = file
    return found, twice


def _folders(folder: Path) -> tuple[Path, Path] | None:
    """Folder of the pictures and folder of the depth, which may be one (Replica)."""
    for depth_name in DEPTH_FOLDERS:
        depth = folder / depth_name
        for name in PICTURE_FOLDERS:
            colour = folder / name
            if not (colour.is_dir() and depth.is_dir()):
                continue
            if colour == depth and not any(_is_depth(file) for file in list_pictures(depth)):
                continue
            if _depth_files(depth, colour) and list_pictures(colour):
                return colour, depth
    return None


def _is_depth(file: Path) -> bool:
    return file.stem.lower().startswith("depth")


def _is_picture(file: Path, depth_folder: Path) -> bool:
    return file.parent != depth_folder or not _is_depth(file)


def _depth_files(depth: Path, colour: Path) -> list[Path]:
    try:
        files = [file for file in depth.iterdir() if file.suffix.lower() in READERS]
    except OSError:
        return []
    return sorted(file for file in files if depth != colour or _is_depth(file))


def _alone(picture: Path, rule: str) -> ImageMissing:
    return ImageMissing("no depth belongs to it", want=f"a depth picture: {rule}", path=picture)
