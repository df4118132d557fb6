"""What is read is neither written over nor removed."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path, PurePosixPath

from pseudolidar.errors import OutputSettings, UsageError
from pseudolidar.formats.recordings.kinds import METADATA_FILE, recordings_in
from pseudolidar.running.journal.journal_file import JOURNAL_NAME, read_journal
from pseudolidar.running.products.compared_outputs import TOGETHER
from pseudolidar.running.products.outputs import KINDS, MAPS, folder_of
from pseudolidar.sources.body import Body, pair_folders
from pseudolidar.sources.cloud_files import CloudFiles, cloud_files_of
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.folder_layout import list_pictures
from pseudolidar.sources.recognise import Source
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.sources.tum_depth import TumDepth
from pseudolidar.sources.video.videos import Video

# Folder of depths in the layouts of pictures with depth; that of our own depth maps, too.
DEPTH_FOLDER = "depth"
RECORDING = ".mcap"
# What runs derive from a source, and no source that is the folder around it reads as its own.
DERIVED = frozenset({*map(folder_of, (*KINDS, *MAPS)), TOGETHER, METADATA_FILE})
DERIVED_FILES = frozenset({RECORDING, ".mp4", ".csv", ".json", ".html"})


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
        if inner == place or inner in place.parents:
            if overwrite and (name := _data_of_an_earlier_run(place)):
                raise _holds_what_is_read(folder, place / name)
            continue
        if place not in inner.parents:
            continue
        parts = inner.relative_to(place).parts
        # An earlier run may have left folders and recordings, but no file of another kind.
        removable = len(parts) > 1 or inner.is_dir() or inner.suffix == RECORDING
        if parts[0] in names or (overwrite and removable):
            raise _holds_what_is_read(folder, path)


def check_elsewhere(folder: Path, source: Source) -> None:
    """Refuse an output folder that is the source's own, where outputs have the names of inputs.

    Raises:
        UsageError: it is the folder of the source, or that in which the source and its rig lie, or
            one of its folders of pictures.
    """
    if isinstance(source, Synthetic):
        return
    place = Path(source.path).resolve()
    if folder.resolve() == place or (place.is_file() and folder.resolve() == place.parent):
        raise _holds_what_is_read(folder, place)
    if place in folder.resolve().parents and not (folder / JOURNAL_NAME).exists():
        for picture in list_pictures(folder) if folder.is_dir() else ():
            raise _holds_what_is_read(folder, picture)


def _holds_what_is_read(folder: Path, path: Path) -> UsageError:
    return UsageError(
        f"an output folder that holds what is read: {path}",
        want="another one: the source would be written over",
        fix="Choose another output folder.",
        path=folder,
    )


def _data_of_an_earlier_run(place: Path) -> str | None:
    """A file that an earlier run left in `place` and that may be the source's own, as of `synth`.

    Clouds, maps and recordings are none: a source that is the folder itself does not read them, or
    they are looked at one by one.
    """
    content = None
    with contextlib.suppress(OutputSettings):  # an unreadable journal names nothing
        content = read_journal(place / JOURNAL_NAME)
    if content is None:
        return None
    files = (file.name for record in content.records for file in record.files)
    return next((name for name in (*files, *content.products) if not _is_derived(name)), None)


def _is_derived(name: str) -> bool:
    first = PurePosixPath(name).parts[0]
    return first in DERIVED or first.startswith(".") or PurePosixPath(name).suffix in DERIVED_FILES


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
        case Body():
            yield source.rig_file
            yield from (place / name for name in pair_folders(source))
        case Video(right=str(right)) | Folders(right=str(right)):
            yield Path(right)
