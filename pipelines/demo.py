"""Convert the synthetic street to clouds, maps and a recording, and say what to open."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

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


def run(job: Demo) -> ConvertReport | Rehearsal:
    """The conversion with the settings that show most."""
    report: ConvertReport | Rehearsal = convert(
        Convert(
            source=Synthetic(job.world, frames=job.frames),
            out=job.out,
            to=Outputs.parse("pcd,ply,depth,disparity,mcap"),
            overwrite=job.overwrite,
        )
    )
    return report
