"""A board that moves by itself before the camera, as a bus does: in pictures, depth and scan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import LidarScan, StereoFrame

# Its texture: so many squares of noise, each of so many pixels, and a noise of the camera.
SQUARES, SQUARE_PX, NOISE = (60, 160), 8, 1.5
# It stands at half of the median depth, between these rows of the picture there, shares of all.
NEARER, TOP, BOTTOM = 0.5, 0.05, 0.7
# A frame, by kind: `across` goes so far to the right, share of the width; `near` comes so much
# nearer, in disparity. `still` stays where it is in the picture: it drives beside the camera.
ACROSS, NEAR = 0.01, 0.03
KINDS = "still", "across", "near"


@dataclass(frozen=True, eq=False)
class Board:
    """A board that covers a share of the picture's width.

    Args:
        kind: how it moves, of `KINDS`.
        share: of the width, in the frame in which it comes.
        depth_m: how far away it is then.
        seed: of its texture.
    """

    kind: str
    share: float
    depth_m: float
    seed: int = 0

    @classmethod
    def before(cls, frame: StereoFrame, kind: str, share: float, *, seed: int = 0) -> Board:
        """One that stands before what a frame shows."""
        d = float(np.nanmedian(frame.truth.values)) + frame.rig.doffs_px
        return cls(kind, share, NEARER * frame.rig.fB_px_m / d, seed)

    def on(self, frame: StereoFrame, number: int) -> StereoFrame:
        """A frame with the board, so many frames after it came, and its disparities."""
        left, right, values = frame.left.copy(), frame.right.copy(), frame.truth.values.copy()
        z, box = self._at(frame, number)
        d = frame.rig.fB_px_m / z - frame.rig.doffs_px
        values[self._draw(left, frame, box, z, 0.0, 2 * number)] = d
        self._draw(right, frame, box, z, d, 2 * number + 1)
        scan = None if frame.scan is None else self._scanned(frame, box, z)
        return replace(frame, left=left, right=right, truth=DisparityMap(values), scan=scan)

    def _at(self, frame: StereoFrame, number: int) -> tuple[float, np.ndarray]:
        """Its depth, m, and its left, right, upper and lower edge in the left camera's frame, m."""
        (height, width), K = frame.left.shape[:2], frame.rig.left.K
        middle = 0.5 * width
        if self.kind == "across":
            middle = 0.25 * width + number * ACROSS * width
        half = 0.5 * self.share * width
        z = self.depth_m / (1.0 + NEAR * number) if self.kind == "near" else self.depth_m
        columns, rows = np.array([middle - half, middle + half]), height * np.array([TOP, BOTTOM])
        u, v = (columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1]
        return z, self.depth_m * np.concatenate([u, v])

    def _draw(
        self, image: np.ndarray, frame: StereoFrame, box: np.ndarray, z: float, d: float, take: int
    ) -> np.ndarray:
        """Paint it into a picture that sees it shifted by a disparity; which pixels it covers."""
        (height, width), K = image.shape[:2], frame.rig.left.K
        x = (np.arange(width) + d - K[0, 2]) / K[0, 0] * z
        y = (np.arange(height) - K[1, 2]) / K[1, 1] * z
        texture = self._texture()
        at_x = (x - box[0]) / (box[1] - box[0]) * (texture.shape[1] - 1)
        at_y = (y - box[2]) / (box[3] - box[2]) * (texture.shape[0] - 1)
        grid = np.meshgrid(at_x.astype(np.float32), at_y.astype(np.float32))
        grey = cv2.remap(texture, *grid, cv2.INTER_LINEAR).astype(np.float64)
        noise = np.random.default_rng([self.seed, take]).normal(0.0, NOISE, grey.shape)
        inside = np.outer((y > box[2]) & (y < box[3]), (x > box[0]) & (x < box[1]))
        seen = np.clip(grey + noise, 0, 255).astype(np.uint8)[inside]
        image[inside] = seen if image.ndim == 2 else seen[:, None]
        return inside

    def _texture(self) -> np.ndarray:
        rows, columns = SQUARES
        squares = np.random.default_rng(self.seed).integers(0, 256, (rows, columns), np.uint8)
        size = columns * SQUARE_PX, rows * SQUARE_PX
        large = cv2.resize(squares, size, interpolation=cv2.INTER_CUBIC)
        return cv2.addWeighted(large, 0.6, np.full_like(large, 100), 0.4, 0)

    @staticmethod
    def _scanned(frame: StereoFrame, box: np.ndarray, z: float) -> LidarScan:
        """The scan, whose rays end on it where they would go through."""
        T = frame.rig.T_left_velodyne.matrix
        eye, xyz = T[:3, 3], frame.scan.xyz @ T[:3, :3].T + T[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            part = (z - eye[2]) / (xyz[:, 2] - eye[2])
        hit = eye + part[:, None] * (xyz - eye)
        met = (part > 0) & (part < 1)
        met &= (hit[:, 0] > box[0]) & (hit[:, 0] < box[1])
        met &= (hit[:, 1] > box[2]) & (hit[:, 1] < box[3])
        own = (np.where(met[:, None], hit, xyz) - T[:3, 3]) @ T[:3, :3]
        return replace(frame.scan, xyz=own.astype(np.float32))


def with_board(
    frames: list[StereoFrame], kind: str, share: float, *, begin: int, seed: int = 0
) -> list[StereoFrame]:
    """Frames with a board from number `begin` on; see `Board`."""
    board = Board.before(frames[0], kind, share, seed=seed)
    return [
        board.on(frame, at - begin) if at >= begin else frame for at, frame in enumerate(frames)
    ]
