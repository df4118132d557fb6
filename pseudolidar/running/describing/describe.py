"""What any path is: a source, a recording, a file that the program reads, a folder that it wrote.

A source is recognised by `sources.recognise`, as everywhere; single files by the readers of their
formats. What cannot be found out is told, and stops nothing.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pseudolidar.errors import PseudolidarError, SourceUnknown
from pseudolidar.formats.limits import DEFAULT_LIMITS
from pseudolidar.formats.pictures.image_kinds import SNIFFED_BYTES, content_kind
from pseudolidar.running.describing.describe_file import FILES, TABLE
from pseudolidar.running.describing.describe_source import (
    deep_facts,
    source_facts,
    time_facts,
    unusable_pairs,
)
from pseudolidar.running.describing.description import READ_AS, Description, is_likely, likelihood
from pseudolidar.running.settings_schema import choice_name
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.names import natural_key
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.synthetic import SYNTHETIC

RUN_FILE = "run.json"
# As many things in a folder are looked at, the rest is counted.
MOST_ENTRIES = 100


def describe(path: str, *, deep: bool = False, workers: int | None = None) -> Description:
    """What `path` is.

    Args:
        path: file, folder, or `synthetic:WORLD`.
        deep: read every frame, not only headers and indices.
        workers: frames read at the same time.

    Returns:
        Its `facts` hold, as far as they apply: `frames`, `times`, `rig`, `topics`, `columns`,
        `first_file`, `run`, `written`, `entries`, and with `deep` `read`, `bad_frames`, `figures`.

    Raises:
        SourceUnknown: there is no such path.
    """
    place = Path(path)
    if not path.startswith(SYNTHETIC) and not os.path.lexists(place):
        recognise(path)  # raises, with the nearest name
    if place.name == RUN_FILE and place.is_file():
        return describe(str(place.parent), deep=deep, workers=workers)
    size, files = disk_usage(place)
    if place.is_dir() and (place / RUN_FILE).is_file():
        return _run_folder(path, size, files, deep=deep, workers=workers)
    try:
        source = recognise(path)
    except PseudolidarError as error:
        return _file(path, size, files, error, deep=deep)
    return _source(path, source, size, files, deep=deep, workers=workers)


def disk_usage(place: Path) -> tuple[int, int]:
    """Bytes and number of the files at or below `place`; links are not followed."""
    if place.is_file():
        return place.stat().st_size, 1
    size = files = 0
    for folder, _, names in os.walk(place):
        for name in names:
            try:
                size += os.lstat(Path(folder) / name).st_size
                files += 1
            except OSError:
                continue
    return size, files


def entries(folder: Path) -> list[dict[str, Any]]:
    """What is in a folder that is nothing as a whole: a row for each folder, and kind of file."""
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    inside = sorted(folder.iterdir(), key=lambda entry: natural_key(entry.name))
    for entry in inside[:MOST_ENTRIES]:
        kind, what = _entry(entry)
        key = (entry.name, "") if entry.is_dir() else (kind, what if kind == "picture" else "")
        row = rows.setdefault(key, _row(entry.name, 0, 0, kind, what))
        if row["things"]:
            row["last"] = entry.name
            row["what"] = what if what == row["what"] else f"files of kind {kind!r}"
        row["things"] += 1
        row["bytes"] += disk_usage(entry)[0]
    left = len(inside) - MOST_ENTRIES
    more = [_row("...", left, None, "unknown", "not looked at")] if left > 0 else []
    return [*rows.values(), *more]


def _row(name: str, things: int, size: int | None, kind: str, what: str) -> dict[str, Any]:
    return {
        "name": name, "last": "", "things": things, "bytes": size, "kind": kind, "what": what,
    }  # fmt: skip


def _entry(place: Path) -> tuple[str, str]:
    """Kind of a thing in a folder, and its line."""
    try:
        source = recognise(str(place))
    except PseudolidarError as error:
        if place.is_dir():
            return "folder", "a folder"
        found = _file(str(place), 0, 0, error, deep=False)
        return found.kind, found.what
    kind = choice_name(type(source))
    try:
        return kind, source.open().summary.line
    except PseudolidarError as error:
        return kind, f"{_seen_as(source)}: {error.code}"


def _seen_as(settings: Source) -> str:
    """What a source that cannot be opened looks like."""
    match settings:
        case Recording():
            return "a recording"
        case Folders():
            return "pictures of two eyes that cannot be used yet"
    return f"looks like {choice_name(type(settings))}, which cannot be used"


def _source(
    path: str, settings: Source, size: int, files: int, *, deep: bool, workers: int | None
) -> Description:
    facts: dict[str, Any] = {}
    unknown: list[dict[str, Any]] = []
    kind = choice_name(type(settings))
    if isinstance(settings, Recording):
        _into(facts, unknown, "topics", lambda: _topics(settings.path))
    try:
        source = opened_with_rig(settings, None)
    except PseudolidarError as error:
        reason = _unknown("frames", error)
        if not any(reason["got"] == other["got"] for other in unknown):
            unknown.append(reason)
        if isinstance(settings, Folders):
            _into(facts, unknown, "pictures", lambda: unusable_pairs(settings))
            rows = entries(Path(path))
            facts |= {"entries": rows} if any(row["kind"] == "folder" for row in rows) else {}
        what = _seen_as(settings)
        return Description(path, kind, what, size, files, facts, unknown=tuple(unknown))
    summary = source.summary
    _into(facts, unknown, "frames", lambda: source_facts(source))
    if deep:
        _into(facts, unknown, "content", lambda: deep_facts(source, workers=workers))
    return Description(
        path, summary.kind, summary.line, size, files, facts, summary.notes, summary.absent,
        tuple(unknown),
    )  # fmt: skip


def _topics(path: str) -> dict[str, Any]:
    """Topics of a recording by its index, with what is known about their messages."""
    from pseudolidar.formats.recordings.recording_store import open_store
    from pseudolidar.sources.recording.topics import Topics

    store = open_store(Path(path))
    topics = Topics.of(store, DEFAULT_LIMITS)
    read = {topic.name for topic in topics.topics}
    rows = []
    for number, channel in enumerate(store.channels):
        times_ns = store.times_ns(number).tolist()
        times = time_facts(times_ns, [str(i) for i in range(len(times_ns))])
        rows.append(
            {
                "topic": channel.topic,
                "type": channel.schema,
                "messages": len(times_ns),
                "rate_hz": times["rate_hz"],
                "first_s": times["first_s"],
                "span_s": times["span_s"],
                "read": "yes" if channel.topic in read else "no",
            }
        )
    rows.sort(key=lambda row: str(row["topic"]))
    stores = {"written_by": store.written_by or None, "damage": list(store.notes)}
    return {**stores, "topics": rows, "not_read": [f"{n}: {why}" for n, why in topics.skipped]}


def _file(
    path: str, size: int, files: int, refusal: PseudolidarError, *, deep: bool
) -> Description:
    """A single file, or something that is none of what is known."""
    place = Path(path)
    if not place.is_file():
        reason = (_unknown("what it is", refusal),)
        if not place.is_dir():
            return Description(
                path, "unknown", "nothing that can be read", size, files, unknown=reason
            )
        rows = entries(place)
        if any(row["kind"] != "unknown" for row in rows):
            what = "a folder of several things" if len(rows) > 1 else f"a folder: {rows[0]['what']}"
            return Description(path, "folder", what, size, files, {"entries": rows})
        what = "a folder of nothing that is known"
        return Description(
            path, "unknown", what, size, files, {"entries": rows} if rows else {}, unknown=reason
        )
    errors: list[dict[str, Any]] = []
    for kind in (*FILES, TABLE):
        if not kind.looks_like(place):
            continue
        try:
            what, facts, notes = kind.describe(place)
            facts |= kind.values(place) if deep else {}
            return Description(path, kind.name, what, size, files, facts, notes)
        except PseudolidarError as error:
            if kind is not TABLE:
                errors.append(_unknown(f"{READ_AS}{kind.name}", error))
    errors.sort(key=likelihood, reverse=True)
    what = _unreadable(place, errors)
    reasons = tuple(errors) or (_unknown("what it is", refusal),)
    return Description(path, "unknown", what, size, files, unknown=reasons)


def _unreadable(place: Path, errors: list[dict[str, Any]]) -> str:
    """What a file is that no reader takes: what it begins as, or by its content."""
    if errors and is_likely(errors[0]):
        return f"a file of kind {errors[0]['what'].removeprefix(READ_AS)!r} that cannot be used"
    found = content_of(place)
    return f"a file that is not read: {found}" if found else "a file of no known kind"


def content_of(place: Path) -> str:
    """Kind of a file's content by its first bytes, "" where they tell nothing."""
    try:
        with place.open("rb") as file:
            return content_kind(file.read(SNIFFED_BYTES))
    except OSError as error:
        return error.strerror or str(error)


def _run_folder(
    path: str, size: int, files: int, *, deep: bool, workers: int | None
) -> Description:
    """A folder that a run has written: how it went, and what is in it."""
    place = Path(path)
    facts: dict[str, Any] = {}
    unknown: list[dict[str, Any]] = []
    _into(facts, unknown, "run", lambda: {"run": _run(place)})
    folders = sorted(entry for entry in place.iterdir() if entry.is_dir() and entry.name[0] != ".")
    written = []
    for part in (*folders, *sorted(place.glob("*.mcap"))):
        part_size, count = disk_usage(part)
        written.append({"name": part.name, "files": count, "bytes": part_size})
    facts["written"] = written
    run = facts.get("run", {})
    what = f"output of {run.get('verb', 'a run')}"
    if run:
        what += f": {run['committed']} of {run['frames']} frames, {run['skipped']} skipped"
        what += " (ended early, the same command continues)" if run["ended_early"] else ""
    try:
        inner = _source(path, recognise(path), size, files, deep=deep, workers=workers)
        facts |= inner.facts
        unknown += inner.unknown
    except PseudolidarError:
        pass  # a run need not have written clouds
    return Description(path, "run", what, size, files, facts, unknown=tuple(unknown))


def _run(place: Path) -> dict[str, Any]:
    try:
        data = json.loads((place / RUN_FILE).read_bytes())
        names = ("verb", "version", "frames", "committed", "skipped", "ended_early", "exit_code")
        return {name: data[name] for name in names} | {"source": data["source"]["line"]}
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise SourceUnknown(
            f"a {RUN_FILE} that cannot be read ({error})",
            want="one that a run wrote",
            path=place / RUN_FILE,
        ) from error


def _into(
    facts: dict[str, Any],
    unknown: list[dict[str, Any]],
    what: str,
    find: Callable[[], dict[str, Any]],
) -> None:
    try:
        facts |= find()
    except PseudolidarError as error:
        unknown.append(_unknown(what, error))


def _unknown(what: str, error: PseudolidarError) -> dict[str, Any]:
    return {"what": what, **error.as_dict()}
