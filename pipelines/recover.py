"""Save what is whole of a damaged or truncated MCAP recording, as a complete one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pseudolidar.errors import ALL_DONE, SOME_SKIPPED, OutputError, RecordingError, UsageError
from pseudolidar.running.field_markers import POSITIONAL
from pseudolidar.running.progress import ByteProgress
from pseudolidar.running.table import table_text
from pseudolidar.sources.recognise import refuse_special

if TYPE_CHECKING:
    from pseudolidar.formats.mcap.findings import Findings

PART_SUFFIX = ".part"
# Damaged places that are shown; --json has more.
SHOWN = 10


@dataclass(frozen=True)
class Recover:
    """Save what is whole of a damaged or truncated MCAP recording, as a complete one.

    Any MCAP, of ROS 2, Foxglove or others: chunks that fail their CRC are left out and told by
    byte and topic, reading goes on at the next sound record. The damaged file is never changed.
    What was written is read back before it takes its name. An intact file is only said to be so.

        pseudolidar recover drive.mcap
        pseudolidar recover drive.mcap.part saved.mcap --json

    Args:
        path: the damaged recording.
        out: the new one; by default NAME_recovered.mcap beside it.
        keep_damaged: of chunks that fail their CRC save the whole messages up to the damage; they
            may not be what they were.
        overwrite: replace OUT.
    """

    path: Annotated[Path, POSITIONAL]
    out: Annotated[Path | None, POSITIONAL] = None
    keep_damaged: bool = False
    overwrite: bool = False


def run(job: Recover) -> RecoverReport:
    """Look at all of it, and where it is damaged write what is whole.

    Raises:
        UsageError: OUT is the damaged file itself, or is there already.
        RecordingError: nothing can be saved.
        SourceUnknown: it is a pipe or a device.
        OutputError: the new file cannot be written.
    """
    from pseudolidar.formats.mcap.recover import inspect_recording, recover_recording

    out = job.out or recovered_name(job.path)
    check_places(job.path, out, overwrite=job.overwrite)
    if job.path.exists():
        refuse_special(job.path)
    size = job.path.stat().st_size if job.path.is_file() else 0
    with ByteProgress(size, "looking") as progress:
        findings, known, compression = inspect_recording(
            job.path, keep_damaged=job.keep_damaged, progress=progress.reached
        )
    if findings.intact:
        return RecoverReport(job.path, None, findings)
    if not findings.saved and not known.channels:
        raise RecordingError(
            f"nothing that can be saved: {findings.losses[0].reason}",
            want="an MCAP recording",
            path=job.path,
            where=f"byte {findings.losses[0].offset}",
        )
    with ByteProgress(size, "saving") as progress:
        findings = recover_recording(
            job.path,
            out,
            known=known,
            compression=compression,
            keep_damaged=job.keep_damaged,
            progress=progress.reached,
        )
    return RecoverReport(job.path, out, findings)


def recovered_name(path: Path) -> Path:
    """`drive_recovered.mcap` of `drive.mcap` or `drive.mcap.part`."""
    whole = path.with_suffix("") if path.suffix == PART_SUFFIX else path
    return whole.with_name(f"{whole.stem}_recovered{whole.suffix or '.mcap'}")


def check_places(path: Path, out: Path, *, overwrite: bool) -> None:
    """Raise `UsageError` where the damaged file or another would be written over."""
    if not out.exists():
        return
    if path.exists() and out.samefile(path):
        raise UsageError(
            "the damaged recording itself",
            want="another name for what is saved",
            fix="Leave OUT out, or name another file.",
            path=out,
        )
    if out.is_dir():
        raise OutputError("a folder", want="the name of a file", path=out)
    if not overwrite:
        raise UsageError(
            "there is such a file already",
            want="a new name",
            fix="Name another file, or pass --overwrite.",
            path=out,
        )


@dataclass(frozen=True)
class RecoverReport:
    """What was saved and what was not.

    Args:
        path: the damaged recording.
        out: the new one; None where there was nothing to be done.
        findings: what was saved.
    """

    path: Path
    out: Path | None
    findings: Findings

    @property
    def exit_code(self) -> int:
        """0 intact, or saved without a message lost; 4 some are lost."""
        return ALL_DONE if self.findings.complete else SOME_SKIPPED

    def as_dict(self) -> dict[str, Any]:
        """Counts by topic, and every damaged place by byte."""
        found = self.findings
        topics = sorted({*found.saved, *found.lost})
        return {
            "path": str(self.path),
            "out": None if self.out is None else str(self.out),
            "intact": found.intact,
            "messages": found.saved.total(),
            "unchecked": found.unchecked,
            "topics": {
                topic: {"recovered": found.saved[topic], "lost": found.lost[topic]}
                for topic in topics
            },
            "lost_known": not found.unknown,
            "lost_bytes": found.lost_bytes,
            "attachments": found.attachments,
            "metadata": found.metadata,
            "damaged_places": found.places,
            "damage": [
                {
                    "byte": loss.offset,
                    "bytes": loss.nbytes,
                    "reason": loss.reason,
                    "messages": None if loss.messages is None else dict(loss.messages),
                }
                for loss in found.losses
            ],
        }

    def text(self) -> str:
        """The same for people."""
        found = self.findings
        if found.intact:
            return f"intact: {found.saved.total()} messages, every check sum is right; {self.path}"
        rows = [
            (topic, str(found.saved[topic]), _count(found.lost[topic], unknown=found.unknown))
            for topic in sorted({*found.saved, *found.lost})
        ]
        lines = [table_text(rows, header=("topic", "recovered", "lost"))]
        for loss in found.losses[:SHOWN]:
            size = f", {loss.nbytes} bytes" if loss.nbytes else ""
            lines.append(f"byte {loss.offset}{size}: {loss.reason}")
        if found.places > SHOWN:
            lines.append(f"... and {found.places - SHOWN} more places (--json lists them)")
        unchecked = f", {found.unchecked} of them unchecked" if found.unchecked else ""
        lost = f"{found.lost.total()} lost" if not found.unknown else "an unknown number lost"
        recovered = f"{found.saved.total()} messages recovered{unchecked}, {lost}"
        lines.append(f"{recovered}; read back, all alike")
        return "\n".join([*lines, f"  {self.out}"])


def _count(lost: int, *, unknown: bool) -> str:
    if unknown:
        return f"{lost} or more" if lost else "unknown"
    return str(lost)
