"""The recording of a run: each frame appended once, whatever interruptions there were."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pseudolidar.errors import OutputError
from pseudolidar.running.journal.identity import prologue, source_name
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.recorded import Frame

if TYPE_CHECKING:
    from pseudolidar.formats.mcap.frame import FramePart
    from pseudolidar.formats.mcap.log import McapLog
    from pseudolidar.formats.mcap.prolog import McapProlog

# What makes a folder of recordings a ROS 2 bag.
BAG_METADATA = "metadata.yaml"


@dataclass(frozen=True)
class RecordingPlan:
    """What recording a run will make.

    Args:
        files: names of its files by what tells them apart; none for no recording.
        prolog: what each says about itself.
    """

    files: Mapping[str, str] = field(default_factory=dict)
    prolog: McapProlog | None = None

    @classmethod
    def of(cls, job: Any, source: FrameSequence[Frame], *, wanted: bool) -> Self:
        """A recording that has the source's name, or none unless it is `wanted`."""
        if not wanted:
            return cls()
        from pseudolidar.formats.mcap.split import split_endings

        name = source_name(source)
        files = {
            ending: f"{name}_{ending}.mcap" if ending else f"{name}.mcap"
            for ending in split_endings(job.mcap.split)
        }
        return cls(files, prologue(job, source))

    @property
    def names(self) -> tuple[str, ...]:
        """Files that it can leave, finished or not."""
        if not self.files:
            return ()
        bag = (BAG_METADATA,) if self.prolog is not None and self.prolog.profile == "ros2" else ()
        return (*(n for name in self.files.values() for n in (name, f"{name}.part")), *bag)

    @contextlib.contextmanager
    def open(self, folder: Path, frames: Sequence[str]) -> Iterator[Recording]:
        """Begin or continue the recording; complete when the block ends without an error.

        A recording of an earlier run keeps its whole frames as far as they are the ones that this
        run will have, in order; everything after that is cut off. One of the ROS 2 profile gets a
        `metadata.yaml` beside it, which makes the folder a bag.

        Args:
            folder: output folder.
            frames: names of the frames that it is to hold, in order.

        Raises:
            OutputError: it cannot be written.
            RecordingError: it does not read back as it should.
        """
        if self.prolog is None:
            yield Recording({}, frames)
            return
        from pseudolidar.formats.mcap.log import McapLog

        if self.prolog.profile == "ros2":
            check_no_other_bag(folder / BAG_METADATA, self.files.values())
        with contextlib.ExitStack() as opened:
            logs = {
                ending: opened.enter_context(McapLog(folder / name, self.prolog, committed=frames))
                for ending, name in self.files.items()
            }
            yield Recording(logs, frames)
        if self.prolog.profile == "ros2":
            from pseudolidar.formats.ros.ros2_bag import write_bag_metadata

            write_bag_metadata(
                folder / BAG_METADATA, [folder / name for name in self.files.values()]
            )


def check_no_other_bag(metadata: Path, names: Iterable[str]) -> None:
    """Raise `OutputError` where the folder is a bag of other recordings than these."""
    if not metadata.exists():
        return
    text = metadata.read_text(errors="replace")
    if not all(name in text for name in names):
        raise OutputError(
            "a ROS 2 bag of other recordings is in this folder",
            want="one bag in a folder",
            fix="Choose another output folder.",
            path=metadata,
        )


class Recording:
    """A recording in progress, or nothing where none is wanted.

    Args:
        logs: what frames are appended to, by what tells the files apart.
        frames: names of all frames.
    """

    def __init__(self, logs: Mapping[str, McapLog], frames: Sequence[str]) -> None:
        self._logs = logs
        self._held = {ending: frozenset(log.held) for ending, log in logs.items()}
        # Frames that need not be appended to any file.
        self.held = frozenset(frames).intersection(*self._held.values())

    def append(self, name: str, parts: Mapping[str, FramePart]) -> None:
        """Make a frame durable in every file that does not hold it already."""
        for ending, part in parts.items():
            if name not in self._held[ending]:
                self._logs[ending].append(part)
