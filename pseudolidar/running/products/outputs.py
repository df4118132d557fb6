"""`--to pcd,mcap`: which files a frame becomes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from pseudolidar.errors import NoPairs, UsageError
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.recorded import Frame

MCAP = "mcap"
KINDS = ("pcd", "pcd:compressed", "pcd:ascii", "ply", "ply:ascii", "bin", "npz")
MAPS = ("disparity", "depth")
# Layouts of other tools: folders of their own, several files a frame.
TREES = ("kitti", "colmap")


@dataclass(frozen=True)
class Outputs:
    """What is written of each frame, as a comma list.

    Clouds: `pcd`, `pcd:compressed`, `pcd:ascii`, `ply`, `ply:ascii`, `npz` with every column, and
    `bin` (KITTI: x, y, z, intensity; x forward). Maps: `disparity` and `depth`, PNG at KITTI's
    scale. `mcap` is one recording of everything. `kitti` is a training tree in KITTI's object
    layout, `colmap` a COLMAP model of cameras, poses and points.

    Args:
        kinds: names in the order given, each folder once.
    """

    kinds: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `pcd,ply:ascii,mcap`.

        Raises:
            UsageError: nothing, an unknown name, or two forms of one format.
        """
        kinds = tuple(part.strip() for part in text.split(",") if part.strip())
        known = (*KINDS, *MAPS, MCAP, *TREES)
        folders = [folder_of(kind) for kind in kinds]
        if not kinds or not set(kinds) <= set(known) or len(set(folders)) < len(folders):
            raise UsageError(
                f"{text!r}", want=f"a comma list, each format once, of {', '.join(known)}"
            )
        return cls(kinds)

    def __str__(self) -> str:
        return ",".join(self.kinds)

    def check_possible(self, source: FrameSequence[Frame]) -> None:
        """Refuse, before anything is matched, what several pairs of a frame are not one of.

        Raises:
            NoPairs: a map or a layout of pictures of a body, or of several views.
        """
        asked = [kind for kind in self.kinds if kind in (*MAPS, *TREES)]
        if asked and source.yields is BodyFrame:
            raise NoPairs(
                f"--to {','.join(asked)} of several pairs a frame: {source.summary.line}",
                want="pairs of pictures, in one view each",
                fix=f"Leave {' and '.join(asked)} out of --to; or convert the folder of one pair, "
                "or one view (--rectify.views 1).",
                path=source.summary.path,
            )

    @property
    def recording(self) -> bool:
        """Whether an MCAP is asked for."""
        return MCAP in self.kinds

    @property
    def files(self) -> tuple[str, ...]:
        """The kinds that are a file for each frame."""
        return tuple(kind for kind in self.kinds if kind not in (MCAP, *TREES))

    @property
    def folders(self) -> tuple[str, ...]:
        """Folders in the output folder that are written to."""
        return tuple(folder_of(kind) for kind in self.kinds if kind != MCAP)

    @property
    def trees(self) -> tuple[str, ...]:
        """The kinds that are layouts of other tools."""
        return tuple(kind for kind in self.kinds if kind in TREES)


def folder_of(kind: str) -> str:
    """Folder of the files of a kind, and for clouds their extension."""
    return kind.partition(":")[0]


def file_name(kind: str, frame_id: str) -> str:
    """Name in the output folder of a frame's file."""
    return f"{folder_of(kind)}/{frame_id}.{'png' if kind in MAPS else folder_of(kind)}"
