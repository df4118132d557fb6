"""Several stereo pairs on one body, and what they see at one moment."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.errors import CalibrationValue, StructureError
from pseudolidar.structures.arrays import Float64, check_array
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.pose import Pose

BASE_LINK = "base_link"
# Names of pairs name folders and coordinate frames.
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,30}")
# Numbers of pairs are one byte for each point.
MOST_PAIRS = 255


@dataclass(frozen=True, eq=False)
class MountedPair:
    """A stereo pair and where it is mounted.

    Args:
        name: of the pair, such as `front`.
        rig: its cameras.
        T_base_link_left: where its left camera is on the body.
        rotation_sigma_rad: (3,) standard deviations of the place's rotation vector, where known.
        translation_sigma_m: (3,) of its translation.

    Raises:
        StructureError: the pose is between other frames.
        CalibrationValue: a name that cannot be that of a folder.
    """

    name: str
    rig: StereoRig
    T_base_link_left: Pose
    rotation_sigma_rad: Float64 | None = None
    translation_sigma_m: Float64 | None = None

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise CalibrationValue(
                f"a pair called {self.name!r}",
                want="a letter, then letters, digits, _ and - (up to 31)",
                where="pairs",
            )
        pose = self.T_base_link_left
        if (pose.dst, pose.src) != (BASE_LINK, self.rig.left.frame):
            raise StructureError(
                f"T_{pose.dst}_{pose.src}",
                want=f"T_{BASE_LINK}_{self.rig.left.frame}",
                where="MountedPair",
            )
        for name in ("rotation_sigma_rad", "translation_sigma_m"):
            if getattr(self, name) is not None:
                check_array("MountedPair", name, getattr(self, name), (3,), np.float64)

    def placed(self, T_base_link_left: Pose) -> MountedPair:
        """The same pair elsewhere; how well the place was known is not known of the new one."""
        return replace(
            self,
            T_base_link_left=T_base_link_left,
            rotation_sigma_rad=None,
            translation_sigma_m=None,
        )


@dataclass(frozen=True, eq=False)
class BodyRig:
    """The stereo pairs of a body.

    Args:
        pairs: at least one; each with a name of its own.
        origin: where the calibration comes from, in words.

    Raises:
        CalibrationValue: no pair, too many, or two of one name.
    """

    pairs: tuple[MountedPair, ...]
    origin: str = ""

    def __post_init__(self) -> None:
        names = self.names
        if not 1 <= len(names) <= MOST_PAIRS or len({name.lower() for name in names}) < len(names):
            raise CalibrationValue(
                f"pairs {', '.join(names) or 'none'}",
                want=f"1 to {MOST_PAIRS}, each with a name of its own",
                where="pairs",
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the pairs, in order."""
        return tuple(pair.name for pair in self.pairs)

    def __getitem__(self, name: str) -> MountedPair:
        """The pair of that name.

        Raises:
            KeyError: there is none.
        """
        return {pair.name: pair for pair in self.pairs}[name]


@dataclass(frozen=True, eq=False)
class BodyFrame:
    """What the pairs of a body see at one moment.

    Args:
        pairs: rectified pairs by their names; those that could not be read are left out.
        T_base_link_left: by name, where the left camera of that rectified pair is.
        order: names of all pairs of the body, in the order of their numbers.
        id: the source's name of the frame; names its output files.
        index: position in the source.
        timestamp_ns: time of the first pair's picture.
        pose: `T_map_base_link`, where the source knows it.
        scan: LiDAR scan of the same moment, in `T_base_link_lidar.src`.
        T_base_link_lidar: where that is.
        notes: what was odd about it, for the report.
    """

    pairs: Mapping[str, StereoFrame]
    T_base_link_left: Mapping[str, Pose]
    order: tuple[str, ...]
    id: str
    index: int
    timestamp_ns: int
    pose: Pose | None = None
    scan: LidarScan | None = None
    T_base_link_lidar: Pose | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        unknown = [name for name in self.pairs if name not in self.order]
        if unknown or not self.pairs or set(self.pairs) - set(self.T_base_link_left):
            raise StructureError(
                f"pairs {', '.join(self.pairs) or 'none'}",
                want=f"some of {', '.join(self.order)}, each with its place",
                where=f"frame {self.id}",
            )
