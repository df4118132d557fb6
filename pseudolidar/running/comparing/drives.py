"""All sources below a folder: drives, sequences, recordings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from pseudolidar.errors import PseudolidarError, SourceEmpty, SourceUnknown
from pseudolidar.running.comparing.second_place import READ_SUFFIXES
from pseudolidar.sources.names import natural_key
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.structures.frame import StereoFrame

# How deep drives lie: data set, split or date, sequences, drive, and one more.
DEEPEST = 5


@dataclass(frozen=True)
class Drives:
    """A folder that holds sources, and is none itself.

    Args:
        path: the folder.
    """

    path: str


@dataclass(frozen=True)
class FoundDrive:
    """A source below a folder.

    Args:
        name: its place there, fit for the name of a folder.
        source: its settings; None where it cannot be opened.
        error: why not.
    """

    name: str
    source: Source | None
    error: PseudolidarError | None = None


def recognise_drives(text: str) -> Source | Drives:
    """What SOURCE is; a folder that is none may hold some, for `--all`."""
    try:
        return recognise(text)
    except SourceUnknown:
        if not Path(text).is_dir():
            raise
        return Drives(text)


def drives_below(given: Source | Drives) -> tuple[FoundDrive, ...]:
    """Every source in a folder, in natural order; nothing in a source is looked at again.

    Args:
        given: the folder, or what it was taken for: its settings hold for drives of its kind.

    Raises:
        SourceEmpty: there is none.
    """
    root = Path(given.path)
    found = tuple(_search(root, root, given, 0))
    if not found:
        raise SourceEmpty("no source in it", want="drives, sequences or recordings", path=root)
    return found


def _search(place: Path, root: Path, given: Source | Drives, depth: int) -> Iterator[FoundDrive]:
    """The place itself, if it can be opened; else what is below it; else why it cannot."""
    name = "_".join(place.relative_to(root).parts) or root.resolve().name
    why: PseudolidarError | None = None
    try:
        source = _settings(place, given)
        if source.open().yields is StereoFrame or isinstance(source, Recording):
            yield FoundDrive(name, source)
        return
    except SourceUnknown:
        pass
    except PseudolidarError as error:
        why = error
    below = list(_below(place, root, given, depth))
    if why is not None and all(each.source is None for each in below):
        yield FoundDrive(name, None, why)
    else:
        yield from below


def _below(place: Path, root: Path, given: Source | Drives, depth: int) -> Iterator[FoundDrive]:
    if not place.is_dir() or depth == DEEPEST:
        return
    for entry in sorted(place.iterdir(), key=lambda entry: natural_key(entry.name)):
        hidden = entry.name.startswith(".") or entry.is_symlink()
        if not hidden and (entry.is_dir() or entry.suffix.lower() in READ_SUFFIXES):
            yield from _search(entry, root, given, depth + 1)


def _settings(place: Path, given: Source | Drives) -> Source:
    found = recognise(str(place))
    if not isinstance(given, Drives) and type(found) is type(given):
        return replace(given, path=str(place))
    return found
