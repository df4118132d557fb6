"""A source without files: random texture, the right eye shifted by a known disparity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from pseudolidar.errors import PseudolidarError
from pseudolidar.sources.source import SourceSummary
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

SIZE_PX = (48, 32)
DISPARITY_PX = 4


def tiny_rig() -> StereoRig:
    K = np.array([[40.0, 0, 23.5], [0, 40.0, 15.5], [0, 0, 1]])
    T_right_left = Pose.from_rotation(
        "camera_right", "camera_left", np.eye(3), np.array([-0.5, 0, 0])
    )
    right = Camera(K, *SIZE_PX, frame="camera_right")
    return StereoRig(Camera(K, *SIZE_PX), right, T_right_left)


@dataclass(frozen=True)
class TextureSource:
    """`count` seeded frames; `bad` ones raise when they are loaded."""

    count: int
    bad: dict[int, Exception] = field(default_factory=dict)
    refused: tuple[tuple[str, PseudolidarError], ...] = ()
    rig: StereoRig = field(default_factory=tiny_rig)
    summary: SourceSummary = SourceSummary("texture", "memory", "random texture")

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(f"{index:06d}" for index in range(self.count))

    @property
    def timestamps_ns(self) -> tuple[int, ...]:
        return tuple(10**9 + index * 10**8 for index in range(self.count))

    def load(self, index: int) -> StereoFrame:
        if index in self.bad:
            raise self.bad[index]
        wide = np.random.default_rng(index).integers(
            0, 256, (SIZE_PX[1], SIZE_PX[0] + DISPARITY_PX), np.uint8
        )
        left, right = wide[:, :-DISPARITY_PX].copy(), wide[:, DISPARITY_PX:].copy()
        return StereoFrame(left, right, self.rig, self.ids[index], index, self.timestamps_ns[index])


@pytest.fixture
def texture_source() -> Callable[..., TextureSource]:
    return TextureSource
