"""`preview.mp4`: what a run saw and made, to look at in a browser.

Each frame's picture is drawn by the worker that converts it and committed like any other file; the
video is put together at the end. So a run that was killed and continued gives the same bytes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Generic, Self, TypeVar

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.evaluation.birds_eye import PointColour, birds_eye, round_length
from pseudolidar.evaluation.pictures import disparity_picture
from pseudolidar.evaluation.preview_picture import Panel, compose, side_of_view
from pseudolidar.formats.pictures.image import encode_jpeg, read_image
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.formats.video.mp4 import TICKS_PER_S, mp4_comment, mp4_encoder, write_mp4
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.folder import inside
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.reports.samples import photo_of
from pseudolidar.running.stream import stream
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.arrays import Float32, UInt8
from pseudolidar.structures.recorded import Frame

if TYPE_CHECKING:
    from pseudolidar.running.run import Run

AnyFrame = TypeVar("AnyFrame", bound=Frame)

PREVIEW_NAME, PREVIEW_FOLDER = "preview.mp4", ".preview"
JPEG_QUALITY = 88
# The view from above reaches as far as this share of the first frame's points, within bounds, m.
REACH_SHARE, LEAST_AHEAD_M, MOST_AHEAD_M = 0.97, 1.0, 100.0
# The sensor is in its middle if more of the points are behind it.
BEHIND_SHARE = 0.02
LEAST_HEIGHT_M = 0.1
# The colour scale ends where all but this share of the first frame's pixels lie below.
DISPARITY_QUANTILE = 0.995
# Frames tried for one to take the scales from.
FRAMES_TRIED = 5
# A frame is shown at least and at most so long, s: a gap of an hour is no film.
SHORTEST_S, LONGEST_S = 1 / 120, 1.0
# Times after this, s since 1970, are shown as dates.
EARLIEST_DATE_S = 946_684_800


@dataclass(frozen=True)
class Preview:
    """How `preview.mp4` looks.

    Args:
        ahead_m: how far the view from above reaches, m; by default as far as the points of the
            first frame do.
        colour: of its points: photo, or height.
        speed: how many times as fast as recorded.
    """

    ahead_m: float | None = None
    colour: PointColour = "photo"
    speed: float = 1.0

    def __post_init__(self) -> None:
        for name in ("ahead_m", "speed"):
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise UsageError(f"{value:g}", want="a number above 0", where=f"preview.{name}")


@dataclass(frozen=True)
class Scales:
    """Scales that hold for all frames of a preview.

    Args:
        ahead_m: how far the view from above reaches.
        all_round: the sensor is in its middle, and not at its lower edge.
        heights_m: which are blue and red.
        near: disparity that is red, px; where there is none, one over the depth, 1/m.
    """

    ahead_m: float = MOST_AHEAD_M
    all_round: bool = False
    heights_m: tuple[float, float] = (-2.5, 2.5)
    near: float = 64.0

    @classmethod
    def of(cls, converted: Converted) -> Self:
        """As they suit a frame."""
        cloud = converted.forward_cloud
        xyz = cloud.xyz[cloud.valid]
        near = _nearness(converted)
        found = cls()
        if len(xyz):
            reach_m = float(np.quantile(np.hypot(xyz[:, 0], xyz[:, 1]), REACH_SHARE))
            low_m, high_m = np.quantile(xyz[:, 2], (1 - REACH_SHARE, REACH_SHARE))
            found = replace(
                found,
                ahead_m=float(np.clip(round_length(reach_m), LEAST_AHEAD_M, MOST_AHEAD_M)),
                all_round=bool(np.mean(xyz[:, 0] < 0) > BEHIND_SHARE),
                heights_m=(float(low_m), float(max(high_m, low_m + LEAST_HEIGHT_M))),
            )
        if near is not None and np.isfinite(near).any():
            found = replace(found, near=float(np.nanquantile(near, DISPARITY_QUANTILE)))
        return found


@dataclass(frozen=True)
class ScalesOf(Generic[AnyFrame]):
    """Scales that suit a frame: picklable.

    Args:
        convert: makes of it what is drawn.
    """

    convert: Callable[[AnyFrame], Converted]

    def __call__(self, frame: AnyFrame) -> Scales:
        """Convert and measure."""
        return Scales.of(self.convert(frame))


@dataclass(frozen=True)
class PreviewArtist:
    """Draws a frame: pure, picklable.

    Args:
        scales: of all frames.
        colour: of the points from above.
    """

    scales: Scales
    colour: PointColour

    @classmethod
    def of(
        cls,
        preview: Preview,
        source: FrameSequence[AnyFrame],
        convert: Callable[[AnyFrame], Converted],
        *,
        crew: CrewPlan,
    ) -> Self:
        """With scales that suit the first frame that can be converted, the same in every run.

        Args:
            preview: settings.
            source: all frames.
            convert: picklable.
            crew: how frames are done: one that kills its process must not kill the run here.
        """
        mp4_encoder()
        scales = Scales()
        for name in source.ids[:FRAMES_TRIED]:
            others = frozenset(source.ids) - {name}
            found = [
                outcome.value
                for outcome in stream(source, ScalesOf(convert), crew=crew, skip=others)
                if isinstance(outcome, Done)
            ]
            if found:
                (scales,) = found
                break
        if preview.ahead_m is not None:
            scales = replace(scales, ahead_m=preview.ahead_m)
        return cls(scales, preview.colour)

    def draw(self, converted: Converted) -> bytes:
        """The frame's picture as a JPEG."""
        frame, cloud = converted.frame, converted.forward_cloud
        panels = self._panels(converted)
        photo_px = (panels[0].pixels.shape[1], panels[0].pixels.shape[0]) if panels else None
        view = birds_eye(
            cloud,
            side_px=side_of_view(photo_px),
            ahead_m=self.scales.ahead_m,
            all_round=self.scales.all_round,
            colour=self.colour,
            heights_m=self.scales.heights_m,
        )
        count = len(cloud) if cloud.shape is None else int(np.count_nonzero(cloud.valid))
        caption = f"{frame.id}   {_time_text(frame.timestamp_ns)}   {count} points"
        return encode_jpeg(compose(panels, Panel(view, "from above"), caption), JPEG_QUALITY)

    def _panels(self, converted: Converted) -> tuple[Panel, ...]:
        near = _nearness(converted)
        if near is None:
            return ()
        paired = converted.disparity is not None
        red = self.scales.near
        label = f"disparity, red: {red:.0f} px" if paired else f"depth, red: {1 / red:.2g} m"
        photo = Panel(photo_of(converted.frame), "left" if paired else "image")
        return photo, Panel(disparity_picture(near, red), label, exact=True)


def _nearness(converted: Converted) -> Float32 | None:
    """(H, W) disparity, px; where there is none, one over the depth; None without either."""
    if converted.disparity is not None:
        return converted.disparity.values
    if converted.depth is None:
        return None
    with np.errstate(divide="ignore"):
        return np.asarray(1 / converted.depth.values, np.float32)


def preview_name(frame_id: str) -> str:
    """Name of a frame's picture in the output folder."""
    return f"{PREVIEW_FOLDER}/{frame_id}.jpg"


def write_preview(run: Run, source: FrameSequence[Frame], preview: Preview) -> None:
    """Put the pictures of all committed frames together, at the pace of their times.

    Nothing is done where the video of these frames is there, and whole.

    Args:
        run: which has committed the pictures.
        source: knows the times.
        preview: how fast.

    Raises:
        OutputError: the disk is full or gone; then there is no video.
    """

    def picture(name: str) -> UInt8:
        return np.asarray(read_image(inside(run.folder, preview_name(name))).pixels, np.uint8)

    write_film(run, source, PREVIEW_NAME, picture, speed=preview.speed)


def write_film(
    run: Run,
    source: FrameSequence[Frame],
    name: str,
    picture: Callable[[str], UInt8],
    *,
    speed: float = 1.0,
) -> None:
    """Put a picture of each committed frame together, at the pace of their times.

    The film says what it was made of; nothing is done where the film of these frames is there, and
    whole.

    Args:
        run: which has committed the frames.
        source: knows the times.
        name: of the film in the output folder.
        picture: of a frame, by its id.
        speed: how many times as fast as recorded.

    Raises:
        OutputError: the disk is full or gone; then there is no film.
    """
    path = run.folder / name
    result = run.result()
    names = [record.id for record in result.committed]
    if not names:
        return
    times = dict(zip(source.ids, source.timestamps_ns, strict=True))
    steps = steps_ticks([times[name] for name in names], speed)
    made_of = _digest(result.committed, steps)
    if mp4_comment(path) == made_of:
        return
    ticks = np.concatenate([[0], np.cumsum(steps[:-1])]).astype(np.int64)
    with FrameProgress(len(names), what=path.stem) as progress:

        def pictures() -> Iterator[UInt8]:
            for name in names:
                yield picture(name)
                progress.advance()

        shown = _of_one_size(pictures())
        write_mp4(path, shown, ticks.tolist(), last_ticks=int(steps[-1]), comment=made_of)


def _digest(committed: Sequence[FrameRecord], steps: Sequence[int]) -> str:
    """Of what a film is made of: the files of its frames, and for how long each is shown."""
    files = [[record.id, *(file.crc32 for file in record.files)] for record in committed]
    return hashlib.sha256(json.dumps([files, list(steps)]).encode()).hexdigest()


def steps_ticks(stamps_ns: Sequence[int], speed: float) -> list[int]:
    """How long each frame is shown, 1/90000 s: as recorded, within bounds; the last like most."""
    steps_s = np.diff(np.array(stamps_ns, np.int64)).astype(np.float64) / NS_PER_S / speed
    shown_s = np.clip(steps_s, SHORTEST_S, LONGEST_S)
    last_s = float(np.median(shown_s)) if len(shown_s) else LONGEST_S
    ends = np.round(np.cumsum([0.0, *shown_s, last_s]) * TICKS_PER_S).astype(np.int64)
    return [int(step) for step in np.diff(ends)]


def _of_one_size(pictures: Iterator[UInt8]) -> Iterator[UInt8]:
    """All as large as the first: scenes of a data set may differ; smaller ones get a margin."""
    shape: tuple[int, ...] | None = None
    for picture in pictures:
        shape = shape or picture.shape
        if picture.shape == shape:
            yield picture
            continue
        fitted = np.zeros(shape, np.uint8)
        height, width = min(shape[0], picture.shape[0]), min(shape[1], picture.shape[1])
        fitted[:height, :width] = picture[:height, :width]
        yield fitted


def _time_text(timestamp_ns: int) -> str:
    seconds, ns = divmod(timestamp_ns, NS_PER_S)
    if seconds < EARLIEST_DATE_S:
        return f"t = {seconds + ns / NS_PER_S:.3f} s"
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S}.{ns // 10**6:03d} UTC"
