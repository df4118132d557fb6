"""What KITTI's layouts share: camera folders, optional data, one of several sequences."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pseudolidar.errors import CalibrationMissing, SourceEmpty, SourceUnknown, UsageError
from pseudolidar.formats.rigs.kitti_calibration import CAMERAS, CameraPair
from pseudolidar.sources.numbered import (
    FrameNumber,
    NumberedFiles,
    Pairs,
    first_number_parts,
    listed,
    numbered_files,
)
from pseudolidar.sources.source import UNPAIRED

CameraChoice = Literal["auto", "colour", "grey"]
CameraKind = Literal["colour", "grey"]
Split = Literal["training", "testing"]
SPLITS: tuple[Split, ...] = ("training", "testing")
SCAN_SUFFIXES, TEXT_SUFFIXES, PNG_SUFFIXES = (
    frozenset((".bin",)),
    frozenset((".txt",)),
    frozenset((".png",)),
)
# The number of a sequence, `06`, or of a drive, `2011_09_26_drive_0002_sync`.
SEQUENCE_NUMBER = re.compile(r"(?:^|_drive_)([0-9]+)(?:_[a-z]+)?$")
# Where the layouts keep the cameras' pictures; stereo 2012 says colored_0.
COLOUR_FOLDERS = (
    ("image_2", "image_3"),
    ("colored_0", "colored_1"),
    ("colour_0", "colour_1"),
    ("color_0", "color_1"),
)
GREY_FOLDERS = (("image_0", "image_1"),)


@dataclass(frozen=True)
class CameraFolders:
    """Pictures of a left and a right camera.

    Args:
        kind: colour or grey.
        left: pictures of the left one.
        right: pictures of the right one.
    """

    kind: CameraKind
    left: NumberedFiles
    right: NumberedFiles

    @property
    def numbers(self) -> CameraPair:
        """KITTI's numbers of the cameras."""
        return CAMERAS[self.kind]

    @property
    def complete(self) -> bool:
        """Whether both have pictures."""
        return bool(len(self.left) and len(self.right))

    @property
    def described(self) -> str:
        """Kind and folders, for people."""
        return f"{self.kind} cameras ({_camera_name(self.left)}, {_camera_name(self.right)})"


def _camera_name(files: NumberedFiles) -> str:
    folder = files.folder
    return folder.parent.name if folder.name == "data" else folder.name


def camera_folders(
    root: Path,
    *,
    colour: Iterable[tuple[str, str]] = COLOUR_FOLDERS,
    grey: Iterable[tuple[str, str]] = GREY_FOLDERS,
) -> tuple[CameraFolders, ...]:
    """The camera pairs that a layout can have in `root`, the first name of each kind that is there.

    Args:
        root: folder that holds the cameras' folders.
        colour: names of the left and right colour cameras' folders.
        grey: names of the grey ones'.
    """
    found: list[CameraFolders] = []
    kinds: tuple[tuple[CameraKind, Iterable[tuple[str, str]]], ...] = (
        ("colour", colour),
        ("grey", grey),
    )
    for kind, names in kinds:
        options = [
            CameraFolders(kind, numbered_files(root / left), numbered_files(root / right))
            for left, right in names
        ]
        options.sort(key=lambda option: -(bool(len(option.left)) + bool(len(option.right))))
        found += options[:1]
    return tuple(found)


def choose_cameras(
    wanted: CameraChoice,
    present: Sequence[CameraFolders],
    *,
    path: Path,
    calibrated: Callable[[CameraPair], bool] = lambda _: True,
) -> tuple[CameraFolders, tuple[str, ...]]:
    """The camera pair to use and what is absent: colour where both eyes are there, else grey.

    Raises:
        SourceEmpty: the pair that is wanted, or any, has not both eyes.
    """
    complete = [cameras for cameras in present if cameras.complete]
    candidates = [cameras for cameras in complete if wanted in ("auto", cameras.kind)]
    if not candidates:
        raise _no_cameras(wanted, present, path)
    usable = [cameras for cameras in candidates if calibrated(cameras.numbers)]
    chosen = (usable or candidates)[0]
    absent = tuple(cameras.described for cameras in present if not cameras.complete)
    return chosen, absent


def _no_cameras(wanted: CameraChoice, present: Sequence[CameraFolders], path: Path) -> SourceEmpty:
    counts = [
        f"{_camera_name(files)} {len(files)}"
        for cameras in present
        for files in (cameras.left, cameras.right)
    ]
    others = [cameras.kind for cameras in present if cameras.complete]
    return SourceEmpty(
        f"pictures by camera: {', '.join(counts)}",
        want="both cameras of a pair" if wanted == "auto" else f"both {wanted} cameras",
        fix=f"Use --camera {others[0]}." if others else "Get the images of both cameras.",
        path=path,
    )


def absent_part(name: str, files: NumberedFiles, numbers: Sequence[FrameNumber]) -> tuple[str, ...]:
    """What to say about optional data that not all frames have."""
    return absent_count(name, sum(files.get(n) is None for n in numbers), len(numbers))


def absent_count(name: str, missing: int, frames: int) -> tuple[str, ...]:
    """What to say about optional data that so many of the frames lack."""
    if not missing:
        return ()
    return (name if missing == frames else f"{name} of {missing} of {frames} frames",)


def stray_note(name: str, files: NumberedFiles, numbers: Iterable[FrameNumber]) -> tuple[str, ...]:
    """A note about optional data without a picture."""
    strays = sorted(files.paths.keys() - set(numbers))
    if not strays:
        return ()
    names = listed(files.paths[number].name for number in strays)
    return (f"{name}{UNPAIRED}{names}",)


def one_of(what: str, names: Sequence[str], wanted: str | None, *, path: Path) -> int:
    """Index of the wanted sequence, or of the only one.

    A name may be shortened, `drive_0002` or `2` for `2011_09_26_drive_0002_sync`.

    Raises:
        UsageError: several fit, or none does; they are listed.
    """
    fits = [i for i, name in enumerate(names) if wanted is None or _named(name, wanted)]
    exact = [i for i in fits if names[i] == wanted]
    if len(exact or fits) == 1:
        return (exact or fits)[0]
    if not names:
        raise SourceUnknown(f"no {what}", want=f"at least one {what}", path=path)
    got = "several fit" if fits else f"no {what} {wanted!r}"
    raise UsageError(
        f"{got}: {', '.join(names[i] for i in fits or range(len(names)))}",
        want=f"one {what}",
        fix="Choose it with --sequence.",
        path=path,
    )


def _named(name: str, wanted: str) -> bool:
    if wanted.isdecimal():
        number = SEQUENCE_NUMBER.search(name)
        return number is not None and int(number[1]) == int(wanted)
    return f"_{wanted}_" in f"_{name}_"


def split_folder(path: Path, split: Split | None, *, has: Callable[[Path], bool]) -> Path | None:
    """The folder `training` or `testing` of a data set whose root or split `path` is.

    Args:
        path: root or split.
        split: which one; by default the one that is there, training first.
        has: whether a folder is a split of this layout.
    """
    options = [path / name for name in SPLITS if split in (None, name)]
    if split in (None, path.resolve().name):
        options.insert(0, path)
    return next((folder for folder in options if has(folder)), None)


def split_or_raise(
    path: Path, split: Split | None, *, has: Callable[[Path], bool], what: str
) -> Path:
    """The folder of a split: `split_folder` that insists.

    Raises:
        SourceUnknown: there is none of the layout `what`.
    """
    folder = split_folder(path, split, has=has)
    if folder is None:
        raise SourceUnknown(
            f"no {split or 'training'} data of {what}",
            want="image_2 and image_3 with numbered pictures, and their calibration",
            fix="Pass the data set's root, or its training or testing.",
            path=path,
        )
    return folder


def holds_pictures(folder: Path, name_parts: int) -> bool:
    """Whether a camera folder in `folder` has pictures whose names have so many numbers."""
    names = (name for pair in (*COLOUR_FOLDERS, *GREY_FOLDERS) for name in pair)
    return any(first_number_parts(folder / name) == name_parts for name in names)


def calibrations_or_raise(count: int, folder: Path) -> None:
    """Raise `CalibrationMissing` where a data set has no calibration at all."""
    if not count:
        raise CalibrationMissing(
            "no calibration",
            want="one calibration file a frame",
            fix="Get the calibration, a separate download.",
            path=folder,
        )


def no_calibration(
    pairs: Pairs, calibrations: Container[FrameNumber], folder: Path
) -> tuple[tuple[str, CalibrationMissing], ...]:
    """Frames without a calibration of their number, with the error."""
    return tuple(
        (
            left.stem,
            CalibrationMissing(
                f"no calibration of frame {left.stem}",
                want=f"{number[0]:06d}.txt",
                path=folder,
                where=f"frame {left.stem}",
            ),
        )
        for number, left, _ in pairs.pairs
        if number[:1] not in calibrations
    )
