"""`obstacles.mp4`: what was found, drawn into what was seen.

Who is who, and how fast, is known only in the order of the frames. So workers commit what a frame
shows, as any other file of it, and obstacles are drawn into that when the film is made.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from pseudolidar.errors import OutputError
from pseudolidar.evaluation.birds_eye import birds_eye
from pseudolidar.evaluation.obstacle_picture import Layout, composed, finished
from pseudolidar.evaluation.pictures import disparity_picture, turbo
from pseudolidar.evaluation.preview_picture import Panel
from pseudolidar.formats.pictures.image import encode_jpeg, read_image
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.folder import inside
from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.preview import (
    JPEG_QUALITY,
    Preview,
    PreviewArtist,
    Scales,
    write_film,
)
from pseudolidar.running.reports.samples import photo_of
from pseudolidar.running.sighting import Seen, SightFrame
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.arrays import UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import Frame

if TYPE_CHECKING:
    from pseudolidar.running.run import Run

# The view from above reaches no farther: farther things are not told from each other there, m.
MOST_AHEAD_M = 60.0
# What is red in the picture of depth is nearer than what is blue by this.
RED_SHARE = 20.0
FILM_NAME, FILM_FOLDER = "obstacles.mp4", ".pictures"


@dataclass(frozen=True)
class SightScales:
    """A frame as what scales of pictures are taken from: picklable.

    Args:
        sight: frame to what is seen in it.
    """

    sight: SightFrame

    def __call__(self, frame: Frame) -> Converted:
        """Match and reproject."""
        seen = self.sight(frame)
        return Converted(frame, _upright(seen), seen.disparity, seen.sight.depth)


@dataclass(frozen=True)
class ObstacleArtist:
    """Makes pictures of frames to draw obstacles into: pure, picklable.

    Args:
        scales: of all frames; None where each has its own, as for single pictures.
    """

    scales: Scales | None = None

    @classmethod
    def of(cls, source: FrameSequence[Frame], sight: SightFrame, *, crew: CrewPlan) -> Self:
        """With scales that suit the first frame in which something is seen, in every run the same.

        Args:
            source: all frames.
            sight: picklable.
            crew: how frames are done.
        """
        scales = PreviewArtist.of(Preview(), source, SightScales(sight), crew=crew).scales
        return cls(_capped(scales))

    def files(self, frame: Frame, seen: Seen) -> list[OutputFile]:
        """What a frame shows, and what is needed to draw into it."""
        photo = photo_of(frame)
        height, width = photo.shape[:2]
        upright = _upright(seen)
        scales = self.scales or _capped(
            Scales.of(Converted(frame, upright, seen.disparity, seen.sight.depth))
        )
        camera, ahead_m = seen.sight.camera, scales.ahead_m
        layout = Layout((width, height))
        view = birds_eye(
            upright,
            side_px=layout.side_px,
            ahead_m=ahead_m,
            all_round=False,
            colour="photo",
            heights_m=scales.heights_m,
        )
        picture = composed(Panel(photo, "left"), _maps(seen, scales), Panel(view, "from above"))
        facts = {"photo_px": [width, height], "K": camera.K.tolist(), "ahead_m": ahead_m}
        return [
            OutputFile.of(f"{FILM_FOLDER}/{frame.id}.jpg", encode_jpeg(picture, JPEG_QUALITY)),
            OutputFile.of(f"{FILM_FOLDER}/{frame.id}.json", json.dumps(facts).encode()),
        ]


def _capped(scales: Scales) -> Scales:
    return replace(scales, ahead_m=min(scales.ahead_m, MOST_AHEAD_M))


def _maps(seen: Seen, scales: Scales) -> tuple[Panel, ...]:
    """Disparity of a pair, and depth; near is red and far is blue in both."""
    blue_m = scales.ahead_m
    red_m = blue_m / RED_SHARE
    depth = turbo(-np.log(seen.sight.depth.values), -math.log(blue_m), -math.log(red_m))
    maps = (Panel(depth, f"depth, red: {red_m:.2g} m, blue: {blue_m:g} m", exact=True),)
    if seen.disparity is None:
        return maps
    red_px = scales.near
    disparity = disparity_picture(seen.disparity.values, red_px)
    return (Panel(disparity, f"disparity, red: {red_px:.0f} px", exact=True), *maps)


def read_picture(
    folder: Path, frame_id: str, obstacles: Sequence[Obstacle], *, time_s: float
) -> UInt8:
    """(H, W, 3) RGB of a committed frame with its obstacles drawn in.

    Args:
        folder: output folder of the run.
        frame_id: of the frame.
        obstacles: of it, with their tracks where they have any.
        time_s: told in the caption.

    Raises:
        OutputError: its files were changed by somebody.
    """
    path = inside(folder, f"{FILM_FOLDER}/{frame_id}.json")
    try:
        facts = json.loads(path.read_bytes())
        width, height = (int(side) for side in facts["photo_px"])
        K, ahead_m = np.array(facts["K"], float).reshape(3, 3), float(facts["ahead_m"])
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise OutputError(
            f"{type(error).__name__}: {error}",
            want="what this run wrote",
            fix="Start anew: --overwrite.",
            path=path,
        ) from error
    picture = np.asarray(read_image(path.with_suffix(".jpg")).pixels, np.uint8)
    seen = [one for one in obstacles if not one.coasts]
    nearest = min((one.distance_m for one in seen), default=None)
    told = "nothing found" if nearest is None else f"nearest {nearest:.1f} m"
    unseen = f", {len(obstacles) - len(seen)} unseen" if len(seen) < len(obstacles) else ""
    caption = f"{frame_id}   {time_s:.2f} s   {len(seen)} obstacles, {told}{unseen}"
    return finished(
        picture, obstacles, photo_px=(width, height), K=K, ahead_m=ahead_m, caption=caption
    )


def write_obstacle_film(
    run: Run,
    source: FrameSequence[Frame],
    obstacles: Mapping[str, Sequence[Obstacle]],
    *,
    speed: float = 1.0,
) -> None:
    """`obstacles.mp4` of all committed frames, at the pace of their times.

    Args:
        run: which has committed the pictures.
        source: knows the times.
        obstacles: of each frame, with their tracks where they have any.
        speed: how many times as fast as recorded.

    Raises:
        OutputError: the disk is full or gone; then there is no film.
    """
    times_ns = dict(zip(source.ids, source.timestamps_ns, strict=True))
    start_ns = source.timestamps_ns[0]

    def picture(name: str) -> UInt8:
        time_s = (times_ns[name] - start_ns) / NS_PER_S
        return read_picture(run.folder, name, obstacles.get(name, ()), time_s=time_s)

    write_film(run, source, FILM_NAME, picture, speed=speed)


def _upright(seen: Seen) -> PointCloud:
    """The cloud with x ahead of the left camera."""
    cloud = seen.cloud[seen.cloud.valid]
    turned = Pose.from_rotation("camera_body", cloud.frame, R_BODY_OPTICAL, np.zeros(3))
    return cloud.transformed(turned)
