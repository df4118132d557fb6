"""What is read is neither written over nor removed."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from pathlib import Path, PurePosixPath

from pseudolidar.errors import UsageError
from pseudolidar.formats.recordings.kinds import METADATA_FILE, recordings_in
from pseudolidar.sources.cloud_files import CloudFiles, cloud_files_of
from pseudolidar.sources.recognise import Source
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.sources.tum_depth import TumDepth
from pseudolidar.sources.video.videos import Video

# Folder of depths in the layouts of pictures with depth; that of our own depth maps, too.
DEPTH_FOLDER = "depth"
RECORDING = ".mcap"


def check_apart(
    folder: Path, read: Iterable[Path], written: Collection[str], *, overwrite: bool
) -> None:
    """Refuse an output folder in which a run would destroy its own source.

    Args:
        folder: output folder.
        read: what the run reads.
        written: names in the folder that it writes, with /.
        overwrite: whether it removes first what an earlier run left there.

    Raises:
        UsageError: what is read lies where it would be written over, or removed.
    """
    place = folder.resolve()
    names = {PurePosixPath(name).parts[0] for name in written}
    for path in read:
        inner = path.resolve()
        if place not in inner.parents:
            continue
        parts = inner.relative_to(place).parts
        # An earlier run may have left folders and recordings, but no file of another kind.
        removable = len(parts) > 1 or inner.is_dir() or inner.suffix == RECORDING
        if parts[0] in names or (overwrite and removable):
            raise UsageError(
                f"an output folder that holds what is read: {path}",
                want="another one: the source would be written over",
                fix="Choose another output folder.",
                path=folder,
            )


def paths_read(source: Source, *others: Path | None) -> Iterator[Path]:
    """The files and folders that a run reads: of its source, and others besides."""
    yield from (path for path in others if path is not None)
    if isinstance(source, Synthetic):
        return
    place = Path(source.path)
    yield place
    match source:
        case CloudFiles():
            yield from cloud_files_of(place)
        case TumDepth():
            yield place / DEPTH_FOLDER
        case Recording():
            yield place / METADATA_FILE
            yield from recordings_in(place)
        case Video(right=str(right)):
            yield Path(right)
