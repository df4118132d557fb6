"""Convert the synthetic street to clouds, maps and a recording, and say what to open."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

# The package path of pipelines/ is made at run time; mypy checks the file itself.
from pseudolidar.pipelines.convert import Convert  # type: ignore[import-untyped]
from pseudolidar.pipelines.convert import run as convert

from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, THIS_TIME
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.running.rehearsal import Rehearsal
from pseudolidar.running.reports.conversion_report import ConvertReport
from pseudolidar.sources.synthetic import Synthetic


@dataclass(frozen=True)
class Demo:
    """Everything at once, without any data: a rendered drive through a street.

        pseudolidar demo
        pseudolidar demo out/room --world room --frames 5

    Args:
        out: output folder.
        world: street, room or flight.
        frames: how many frames.
        overwrite: start anew, even where OUT holds a run with other settings.
    """

    out: Annotated[Path, POSITIONAL, RUN_ONLY] = Path("out/demo")
    world: str = "street"
    frames: int = 10
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False


def run(job: Demo) -> DemoReport:
    """The conversion with the settings that show most."""
    converted = convert(
        Convert(
            source=Synthetic(job.world, frames=job.frames),
            out=job.out,
            to=Outputs.parse("pcd,ply,depth,disparity,mcap"),
            overwrite=job.overwrite,
        )
    )
    return DemoReport(converted, job.out / f"{job.world}.mcap")


@dataclass(frozen=True)
class DemoReport:
    """How the conversion went, and how to look at what it left.

    Args:
        converted: what it reports.
        recording: everything in one file.
    """

    converted: ConvertReport | Rehearsal
    recording: Path

    @property
    def exit_code(self) -> int:
        """That of the conversion."""
        return self.converted.exit_code

    def as_dict(self) -> dict[str, Any]:
        """The same as `convert` says."""
        return self.converted.as_dict()

    def text(self) -> str:
        """The same, and the command that shows it all in a browser."""
        look = f"\nlook at it in a browser:\n  pseudolidar view {self.recording}"
        return self.converted.text() + (look if self.recording.exists() else "")
