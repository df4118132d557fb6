"""Clouds of frames in which it is written which points are of which obstacle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from pseudolidar.errors import UsageError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.labels import encode_labels, encode_tracking_labels, result_label
from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.products.compared_outputs import COLUMN_KINDS, NOTHING
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.encoders import ENCODERS
from pseudolidar.running.products.found import Found
from pseudolidar.running.products.outputs import MCAP, file_name, folder_of
from pseudolidar.running.products.told import ToldFrame

# Digits of KITTI's files: centimetres.
DECIMALS = 2
KITTI, LABEL_FOLDER, TRACKING_NAME = "kitti", "label_2", "tracking.txt"


@dataclass(frozen=True)
class FoundOutputs:
    """What is written of obstacles beside the tables, as a comma list, or `none`.

    `pcd`, `ply` and their forms, and `npz` hold the clouds with a column `object`: the number of
    the obstacle in its frame, 0 for none. `mcap` is one recording of pictures, maps, clouds and
    obstacles. `kitti` is a result file of each frame, label_2/ID.txt, and with tracks tracking.txt.

    Args:
        kinds: names in the order given.
    """

    kinds: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `pcd,kitti`, or `none`.

        Raises:
            UsageError: an unknown name, or two forms of one format.
        """
        kinds = tuple(part.strip() for part in text.split(",") if part.strip())
        if kinds == (NOTHING,):
            return cls()
        known = (*COLUMN_KINDS, MCAP, KITTI)
        folders = [folder_of(kind) for kind in kinds]
        if not kinds or not set(kinds) <= set(known) or len(set(folders)) < len(folders):
            raise UsageError(
                f"{text!r}",
                want=f"none, or a comma list, each format once, of {', '.join(known)}",
            )
        return cls(kinds)

    def __str__(self) -> str:
        return ",".join(self.kinds) or NOTHING

    @property
    def clouds(self) -> tuple[str, ...]:
        """Kinds of clouds."""
        return tuple(kind for kind in self.kinds if kind not in (KITTI, MCAP))

    @property
    def recording(self) -> bool:
        """Whether an MCAP is asked for."""
        return MCAP in self.kinds

    @property
    def folders(self) -> tuple[str, ...]:
        """Folders in the output folder that are written to."""
        return tuple(
            LABEL_FOLDER if kind == KITTI else folder_of(kind)
            for kind in self.kinds
            if kind != MCAP
        )

    def files(self, found: Found) -> list[OutputFile]:
        """Of one frame."""
        files = cloud_files(found, self.clouds)
        if KITTI in self.kinds:
            labels = [result_label(obstacle) for obstacle in found.obstacles]
            data = encode_labels(labels, decimals=DECIMALS, scores=True)
            files.append(OutputFile.of(f"{LABEL_FOLDER}/{found.frame.id}.txt", data))
        return files


def write_tracking(folder: Path, told: Mapping[str, ToldFrame]) -> None:
    """`tracking.txt` of all frames, numbered in their order, in KITTI's tracking layout."""
    labels = {
        number: [result_label(one) for one in frame.obstacles if one.track is not None]
        for number, frame in enumerate(told.values())
    }
    data = encode_tracking_labels(labels, decimals=DECIMALS, scores=True)
    write_atomic(folder / TRACKING_NAME, data)


def cloud_files(found: Found, kinds: Sequence[str]) -> list[OutputFile]:
    """The cloud of a frame, with the column `object`, as files.

    Args:
        found: the frame; `object` is 0 for points of none, else the obstacle's `number` in
            `obstacles.jsonl`, which also has its track.
        kinds: of `running.products.compared_outputs.COLUMN_KINDS`: forms of PCD, PLY, NPZ.
    """
    converted = Converted(found.frame, found.cloud)
    return [
        OutputFile.of(file_name(kind, found.frame.id), ENCODERS[kind](converted)) for kind in kinds
    ]
