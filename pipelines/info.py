"""What a path is: frames, rig, times, topics, columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pseudolidar.errors import ALL_DONE, PseudolidarError, SourceUnknown, UsageError
from pseudolidar.running.describing.describe import describe
from pseudolidar.running.describing.description import Description
from pseudolidar.running.field_markers import POSITIONAL


@dataclass(frozen=True)
class Info:
    """Tell what each path is: source, recording, cloud, picture, calibration, trajectory, network.

    Headers and indices are read, the rest only with --deep. What cannot be read is told and stops
    nothing; exit code 3 if there is a path of which nothing at all is known.

        pseudolidar info 2011_09_26/2011_09_26_drive_0002_sync
        pseudolidar info recording.mcap out cloud.ply calib.yaml net.onnx
        pseudolidar info clouds --deep --json

    Args:
        paths: files, folders, synthetic:NAME.
        deep: read every frame: ranges, bounding box, columns with their least and largest value and
            share of NaN, what frames hold, which of them cannot be read.
        workers: frames read at the same time; by default one per core.
    """

    paths: Annotated[tuple[str, ...], POSITIONAL]
    deep: bool = False
    workers: int | None = None


def run(job: Info) -> InfoReport:
    """Describe each path.

    Raises:
        UsageError: no path is given.
        PseudolidarError: the only path there is cannot be looked at.
    """
    if not job.paths:
        raise UsageError("no path", want="pseudolidar info PATH ...")
    found: list[Description | PseudolidarError] = []
    for path in job.paths:
        try:
            found.append(describe(path, deep=job.deep, workers=job.workers))
        except (PseudolidarError, OSError) as error:
            known = error if isinstance(error, PseudolidarError) else _unreadable(path, error)
            if len(job.paths) == 1:
                raise known from error
            found.append(known)
    return InfoReport(tuple(found))


def _unreadable(path: str, error: OSError) -> SourceUnknown:
    return SourceUnknown(error.strerror or str(error), want="something that can be read", path=path)


@dataclass(frozen=True)
class InfoReport:
    """What was found.

    Args:
        found: of each path its description, or why there is none.
    """

    found: tuple[Description | PseudolidarError, ...]

    @property
    def exit_code(self) -> int:
        """0, or 3 where nothing is known of a path."""
        nothing = [f for f in self.found if isinstance(f, PseudolidarError) or f.kind == "unknown"]
        return PseudolidarError.exit_code if nothing else ALL_DONE

    def as_dict(self) -> dict[str, Any]:
        """The object of `--json`: one entry for each path, in order."""
        return {
            "paths": [
                {"path": each.path, "kind": "unknown", "error": each.as_dict()}
                if isinstance(each, PseudolidarError)
                else each.as_dict()
                for each in self.found
            ]
        }

    def text(self) -> str:
        """A table for each path."""
        return "\n\n".join(
            str(each) if isinstance(each, PseudolidarError) else each.text() for each in self.found
        )
