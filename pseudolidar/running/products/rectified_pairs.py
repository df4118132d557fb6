"""Rectified pairs as files that every verb reads: two folders, their rig, their mask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pseudolidar.errors import CalibrationValue
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.pictures import pair_mask
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.formats.rigs.rig_parts import LEFT, RIGHT
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.running.journal.record import FrameRecord, OutputFile
from pseudolidar.running.products.product import Product
from pseudolidar.sources.rectified import name_of_view
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import PairMask, StereoFrame
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import Frame

RIG, TIMES = "rig.json", "times.txt"
MASKS = (f"{pair_mask.FOLDER}/{pair_mask.LEFT}", f"{pair_mask.FOLDER}/{pair_mask.RIGHT}")
# Rigs whose numbers differ by less are one: those of text files.
SAME = 1e-9


def pairs_in(frame: Frame) -> tuple[StereoFrame, ...]:
    """The pair of a frame, or those of all its views."""
    if isinstance(frame, BodyFrame):
        return tuple(frame.pairs.values())
    assert isinstance(frame, StereoFrame)
    return (frame,)


def folder_of_view(number: int, views: int) -> str:
    """Folder of a view's pairs, "" where there is one view."""
    return f"{name_of_view(number)}/" if views > 1 else ""


@dataclass(frozen=True)
class EncodePairs:
    """The pictures of a frame as PNG: pure, picklable.

    Args:
        rigs: of the first frame's pairs, which are written for all.
    """

    rigs: tuple[StereoRig, ...]

    def __call__(self, frame: Frame) -> Product:
        """Both pictures of each view.

        Raises:
            CalibrationValue: the frame has another rig than the first one.
        """
        pairs = pairs_in(frame)
        files: list[OutputFile] = []
        for number, (pair, rig) in enumerate(zip(pairs, self.rigs, strict=True)):
            if not _same(pair.rig, rig):
                raise CalibrationValue(
                    "another rig than that of the first frame",
                    want="one rig for all pairs",
                    fix="Rectify each scene by itself.",
                    where=f"frame {frame.id}",
                )
            place = folder_of_view(number, len(pairs))
            for eye, picture in (("left", pair.left), ("right", pair.right)):
                name = f"{place}{eye}/{frame.id}.png"
                files.append(OutputFile.of(name, encode_png(picture)))
        notes = {"notes": list(frame.notes)} if frame.notes else {}
        return Product(tuple(files), figures=notes)


def _same(a: StereoRig, b: StereoRig) -> bool:
    parts = ((a.left.K, b.left.K), (a.T_right_left.matrix, b.T_right_left.matrix))
    return a is b or all(np.allclose(x, y, rtol=SAME, atol=SAME) for x, y in parts)


def shared_names(views: int) -> tuple[str, ...]:
    """Files that belong to no single frame."""
    places = [folder_of_view(number, views) for number in range(views)]
    return tuple(f"{place}{name}" for place in places for name in (RIG, TIMES, *MASKS))


def write_shared(folder: Path, pairs: Sequence[StereoFrame]) -> None:
    """Write rigs and masks.

    Args:
        folder: output folder.
        pairs: the pair of any frame, or those of all its views.

    Raises:
        OutputError: the folder cannot be written to.
    """
    for number, pair in enumerate(pairs):
        place = folder / folder_of_view(number, len(pairs))
        (place / pair_mask.FOLDER).mkdir(parents=True, exist_ok=True)
        write_rig(place / RIG, with_usual_frames(pair.rig.with_rows(None)))
        everywhere = np.ones(pair.left.shape[:2], np.bool_)
        mask = pair.mask or PairMask(everywhere, everywhere)
        for name, shown in zip(MASKS, (mask.left, mask.right), strict=True):
            write_atomic(place / name, pair_mask.encode_mask(shown))


def write_times(
    folder: Path, records: Sequence[FrameRecord], times_ns: dict[str, int], views: int
) -> None:
    """Write the times of the pairs that are there, with the names of their pictures.

    Args:
        folder: output folder.
        records: of the frames.
        times_ns: of each frame, by its id.
        views: how many views each frame has.

    Raises:
        OutputError: the folder cannot be written to.
    """
    ids = [record.id for record in records if record.skipped is None]
    lines = [f"{_seconds(times_ns[name])} {name}.png\n" for name in ids]
    for number in range(views):
        write_atomic(folder / folder_of_view(number, views) / TIMES, "".join(lines).encode())


def _seconds(time_ns: int) -> str:
    return f"{time_ns // NS_PER_S}.{time_ns % NS_PER_S:09d}"


def with_usual_frames(rig: StereoRig) -> StereoRig:
    """The rig with the names of frames that files have."""
    T, at = rig.T_right_left, rig.T_left_velodyne
    return replace(
        rig,
        left=replace(rig.left, frame=LEFT),
        right=replace(rig.right, frame=RIGHT),
        T_right_left=Pose(RIGHT, LEFT, T.matrix),
        T_left_velodyne=at and Pose(LEFT, at.src, at.matrix),
    )
