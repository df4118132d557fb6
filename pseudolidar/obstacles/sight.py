"""What may be looked at where objects are searched for: one frame, with what is known of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.geometry.planes import Plane
from pseudolidar.structures.arrays import Bool, Float32, Float64, Image, Int64, check_array
from pseudolidar.structures.box import Label
from pseudolidar.structures.camera import LEFT_FRAME, Camera, StereoRig
from pseudolidar.structures.disparity import DepthMap

# Sigma of depths that a source does not tell, as that of a disparity, px; and of one camera over
# the square of the depth, 1/m (that of a good depth camera).
UNTOLD_PX, UNTOLD_PER_DEPTH_SQUARED = 0.3, 0.002

# Depths end where the search for disparities does, and grow sparse before: a thing with such a
# share of its points in the last part of the range, a twelfth, may be nearer than it is told.
END_OF_RANGE, END_SHARE = 1.0 / 12.0, 0.1


@dataclass(frozen=True, eq=False)
class Sight:
    """A rectified picture with the depth of its pixels.

    Args:
        id: the source's name of the frame.
        image: (H, W) grey or (H, W, 3) RGB, uint8 or uint16, of the left camera.
        camera: of that picture, without lens distortion.
        depth: (H, W) Z in m with its sigma; NaN where nothing is known.
        right: the right picture, like `image`; None where there is one camera.
        rig: of the pair; None where there is one camera.
        ground: the plane that things stand on, in `camera_left`, its normal up; None where none
            was found.
        is_ground: (H, W) pixels that lie on it.
        labels: labelled objects of the frame, or None where the source has none.
        shared_px: the part of the disparities' error that all pixels of a thing share: what the
            calibration of the rig leaves.
        searched_px: disparities below this were looked for; None where depths have no such end.

    Raises:
        StructureError: maps of another size than the picture, a plane in another frame.
    """

    id: str
    image: Image
    camera: Camera
    depth: DepthMap
    right: Image | None = None
    rig: StereoRig | None = None
    ground: Plane | None = None
    is_ground: Bool | None = None
    labels: tuple[Label, ...] | None = None
    shared_px: float = 0.0
    searched_px: int | None = None

    def __post_init__(self) -> None:
        size = self.image.shape[:2]
        self.camera.check_size(size[1], size[0])
        check_array("Sight", "depth", self.depth.values, size, np.float32)
        if self.right is not None:
            check_array("Sight", "right", self.right, self.image.shape, self.image.dtype.type)
        if self.is_ground is not None:
            check_array("Sight", "is_ground", self.is_ground, size, np.bool_)
        if self.ground is not None and self.ground.frame != LEFT_FRAME:
            raise StructureError(
                f"a ground plane in {self.ground.frame!r}", want=LEFT_FRAME, where="Sight.ground"
            )

    @cached_property
    def xyz(self) -> Float32:
        """(H, W, 3) m in `camera_left`; NaN where there is no depth."""
        return self.xyz_in(slice(None), slice(None))

    def xyz_in(self, rows: slice, columns: slice) -> Float32:
        """(h, w, 3) of these rows and columns alone."""
        z, (across, down) = self.depth.values[rows, columns], self._rays
        return np.stack([z * across[columns], z * down[rows, None], z], axis=2)

    def xyz_at(self, pixels: Int64) -> Float32:
        """(N, 3) of pixels, by their positions (N,) in the flat picture."""
        rows, columns = np.divmod(pixels, self.camera.width_px)
        z, (across, down) = self.depth.values[rows, columns], self._rays
        return np.stack([z * across[columns], z * down[rows], z], axis=1)

    @cached_property
    def _rays(self) -> tuple[Float32, Float32]:
        """(W,) x and (H,) y of the points at z = 1 of columns and rows."""
        K, (width, height) = self.camera.K, self.camera.size_px
        across, down = (
            (np.arange(width) - K[0, 2]) / K[0, 0],
            (np.arange(height) - K[1, 2]) / K[1, 1],
        )
        return across.astype(np.float32), down.astype(np.float32)

    @cached_property
    def sigma_m(self) -> Float32:
        """(H, W) one standard deviation of the depth; an assumed one where nobody estimated it."""
        if self.depth.sigma is not None:
            return self.depth.sigma
        return np.asarray(np.float32(self.untold_per_depth_squared) * self.depth.values**2)

    @property
    def untold_per_depth_squared(self) -> float:
        """Sigma that is assumed of depths that come without one, over their square, 1/m."""
        if self.rig is None:
            return UNTOLD_PER_DEPTH_SQUARED
        return UNTOLD_PX / self.rig.fB_px_m

    @property
    def shared_per_depth_squared(self) -> float:
        """The error of depths that all pixels of a thing share, over their square, 1/m.

        What the calibration leaves; of depths that come without a sigma all of it, as nobody knows
        what many of them together tell.
        """
        shared = 0.0 if self.rig is None else self.shared_px / self.rig.fB_px_m
        if self.depth.sigma is None:
            return math.hypot(shared, self.untold_per_depth_squared)
        return shared

    @property
    def nearest_m(self) -> float:
        """Depth Z at which the search for disparities ends: what is nearer is not found.

        0 where there is no such end.
        """
        if self.searched_px is None or self.rig is None:
            return 0.0
        return self.rig.fB_px_m / max(self.searched_px + self.rig.doffs_px, 1e-3)

    def may_be_nearer(self, depth_m: Float64) -> bool:
        """Whether things with these depths (N,) stand where the search for disparities ends."""
        if not len(depth_m):
            return False
        end_m = self.nearest_m / (1.0 - END_OF_RANGE)
        return float((depth_m < end_m).mean()) > END_SHARE
