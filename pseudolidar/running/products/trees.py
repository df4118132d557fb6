"""Layouts of other tools: what a frame adds to them, and what is written when all frames are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from pseudolidar.errors import NoPairs
from pseudolidar.running.journal.record import FrameRecord, OutputFile
from pseudolidar.running.products import colmap_model, kitti_tree
from pseudolidar.running.products.colmap_model import ColmapModel
from pseudolidar.running.products.kitti_tree import KittiTree
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import Frame

_PRODUCTS = {"kitti": kitti_tree.PRODUCTS, "colmap": colmap_model.PRODUCTS}


@dataclass(frozen=True)
class Trees:
    """Which layouts a run makes; pure and picklable.

    Args:
        kinds: `kitti`, `colmap`.
        kitti: settings.
        colmap: settings.
        numbers: six digits by id of the source's frames.
        times_ns: of the source's frames by id.
        source_kind: of the source.
    """

    kinds: tuple[str, ...] = ()
    kitti: KittiTree = field(default_factory=KittiTree)
    colmap: ColmapModel = field(default_factory=ColmapModel)
    numbers: Mapping[str, str] = field(default_factory=dict)
    times_ns: Mapping[str, int] = field(default_factory=dict)
    source_kind: str = ""

    @classmethod
    def of(
        cls,
        kinds: tuple[str, ...],
        kitti: KittiTree,
        colmap: ColmapModel,
        source: FrameSequence[Frame],
    ) -> Self:
        """For the frames of a source."""
        if not kinds:
            return cls()
        times_ns = dict(zip(source.ids, source.timestamps_ns, strict=True))
        numbers = kitti_tree.numbers_of(source.ids)
        return cls(kinds, kitti, colmap, numbers, times_ns, source.summary.kind)

    @property
    def products(self) -> tuple[str, ...]:
        """Files that belong to no single frame."""
        return tuple(name for kind in self.kinds for name in _PRODUCTS[kind])

    def files(self, frame: Frame, cloud: PointCloud) -> list[OutputFile]:
        """What a frame adds.

        Raises:
            NoPairs: the frame is no pair.
            PoseMissing: a COLMAP model of a frame without a pose.
        """
        if not self.kinds:
            return []
        if not isinstance(frame, StereoFrame):
            raise NoPairs(
                "a frame without a pair",
                want=f"pairs of pictures for --to {','.join(self.kinds)}",
                where=f"frame {frame.id}",
            )
        found: list[OutputFile] = []
        if "kitti" in self.kinds:
            number = self.numbers[frame.id]
            found += kitti_tree.tree_files(frame, cloud, number=number, tree=self.kitti)
        if "colmap" in self.kinds:
            points = max(1, self.colmap.points // len(self.numbers))
            found += colmap_model.model_files(frame, cloud, points=points)
        return found

    def finish(self, folder: Path, records: Sequence[FrameRecord]) -> None:
        """Write what joins the committed frames."""
        if "kitti" in self.kinds:
            kitti_tree.finish_tree(
                folder,
                records,
                self.times_ns,
                kind=self.source_kind,
                numbers=self.numbers,
                tree=self.kitti,
            )
        if "colmap" in self.kinds:
            colmap_model.finish_model(folder, records)
