"""Write a rendered world as KITTI data: pictures, scans, calibration, times, poses, labels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pseudolidar.running.bad_frames import OnError
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, THIS_TIME
from pseudolidar.running.products.kitti_layouts import Drive, EncodeFrame, KittiLayout, write_shared
from pseudolidar.running.results import RunResult
from pseudolidar.running.run import Run
from pseudolidar.running.stream import stream
from pseudolidar.sources.synthetic import Synthetic, WorldName


@dataclass(frozen=True)
class Synth:
    """Render a world and write it to OUT as KITTI data.

    raw and odometry have scans, times and poses; object has scans and labels; stereo has scans and
    exact disparity. The other verbs read OUT like any KITTI data.

        pseudolidar synth out/street --frames 100
        pseudolidar synth out/flight --world flight --layout odometry

    Args:
        out: output folder.
        world: street, room or flight.
        layout: which of KITTI's data sets it looks like.
        frames: how many frames.
        seed: which street, which noise.
        width_px: image width; the world's own by default (street: 1242).
        height_px: image height; in proportion by default.
        rate_hz: frames per second.
        workers: frames rendered at the same time; by default one per core.
        on_error: skip a frame that cannot be written in this layout, or stop.
        overwrite: start anew, even where OUT holds a run with other settings.
    """

    out: Annotated[Path, POSITIONAL, RUN_ONLY]
    world: WorldName = "street"
    layout: KittiLayout = "raw"
    frames: int = 20
    seed: int = 0
    width_px: int | None = None
    height_px: int | None = None
    rate_hz: float = 10.0
    workers: Annotated[int | None, RUN_ONLY] = None
    on_error: Annotated[OnError, RUN_ONLY] = "skip"
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False

    @property
    def source(self) -> Synthetic:
        """The world."""
        return Synthetic(
            self.world,
            frames=self.frames,
            seed=self.seed,
            width_px=self.width_px,
            height_px=self.height_px,
            rate_hz=self.rate_hz,
        )


def run(job: Synth) -> SynthReport:
    """Render every frame, encode it in the layout, commit it in order."""
    source = job.source.open()
    poses = tuple(source.pose(index) for index in range(job.frames))
    drive = Drive(source.rig, source.timestamps_ns, poses, job.seed)
    encode = EncodeFrame(job.layout, drive.raw_folder)
    with Run.open(job.out, job, source) as run:
        write_shared(job.layout, job.out, drive)
        settled = run.settled(source.ids)
        for frame in run.good(stream(source, encode, crew=CrewPlan(job.workers), skip=settled)):
            run.commit(frame)
    return SynthReport(run.result(), job.out, job.layout)


@dataclass(frozen=True)
class SynthReport:
    """How it went.

    Args:
        result: counts and times.
        out: output folder.
        layout: what was written.
    """

    result: RunResult
    out: Path
    layout: KittiLayout

    @property
    def exit_code(self) -> int:
        """0 all done, 4 some frames skipped."""
        return self.result.exit_code

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return {"layout": self.layout, "out": str(self.out), **self.result.as_dict()}

    def text(self) -> str:
        """For people."""
        done = f"KITTI {self.layout} data in {self.out}: read it with any verb"
        return f"{self.result.text()}\n  {done}"
