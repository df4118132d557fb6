"""Files of somebody else in a run's folder are not written over."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from pseudolidar.errors import OutputSettings, UsageError
from pseudolidar.running.journal.journal_file import JOURNAL_NAME, JournalContent, read_journal


def check_unclaimed(folder: Path, names: Iterable[str], *, overwrite: bool) -> None:
    """Refuse an output folder in which files that no run has noted lie where outputs go.

    Verbs whose outputs have names that folders of pictures have, too, ask this before they write.

    Args:
        folder: output folder.
        names: what is written in it: files, and folders for the files of frames.
        overwrite: whether a run with other settings is replaced.

    Raises:
        UsageError: something lies there.
    """
    content = None
    with contextlib.suppress(OutputSettings):  # an unreadable journal names nothing
        content = read_journal(folder / JOURNAL_NAME)
    if content is not None and not overwrite:
        return  # a run with other settings is refused as such
    noted = set() if content is None else _noted(content)
    for name in sorted({PurePosixPath(name).parts[0] for name in names} - noted):
        place = folder / name
        if place.is_file() or (place.is_dir() and any(place.iterdir())):
            raise UsageError(
                f"{name} lies there already, and no run has written it",
                want="an empty or a new folder",
                fix="Choose another output folder, or move it away.",
                path=folder,
            )


def _noted(content: JournalContent) -> set[str]:
    files = (file.name for record in content.records for file in record.files)
    return {PurePosixPath(name).parts[0] for name in (*files, *content.products)}
