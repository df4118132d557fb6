"""What the results of a run are decided by; the same identity means the same bytes."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pseudolidar import __version__
from pseudolidar.formats.onnx.model import read_onnx
from pseudolidar.obstacles.regions import Boxes
from pseudolidar.running.networks import deciding
from pseudolidar.running.settings_json import CHOICE_KEY, result_settings
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.recorded import Frame

if TYPE_CHECKING:
    from pseudolidar.formats.mcap.prolog import McapProlog

SYNTHETIC_TIME = "time: synthetic"
# Settings of sources that are paths; files of calibration and of times count by their content.
TIMES_FILES = ("times", "right_times")
SOURCE_PLACES = ("path", "right", "rig", *TIMES_FILES)
# Files of matchers and detectors count by their content, too: networks, and others.
WITH_FILES = ("matcher", "detector", "also")
NETWORK, NETWORK_FILE, OTHER_FILES, BOXES = "onnx", "path", ("names", "image"), "boxes"
# Settings of `convert` that are folders of maps in place of a matcher.
GIVEN_MAPS = ("disparity", "depth")
_UNFIT_FOR_A_NAME = re.compile(r"[^\w.+-]+")


def identity(
    job: Any,
    source: FrameSequence[Frame],
    networks: Mapping[str, Mapping[str, Any]] | None = None,
) -> dict[str, Any]:
    """Settings, version, source and calibration of a run, plain JSON values.

    Paths are resolved, so that it does not matter where the command is called from; of the
    calibration, of files of times, networks, template pictures and drawn regions the content
    counts, and not which file it came from.

    Args:
        job: settings of the run.
        source: where the frames come from.
        networks: those that are used, as `networks_of` has them.
    """
    wanted = result_settings(job)
    settings = without_places(wanted)
    given = wanted.get("source", {})
    files = {name: file for name in TIMES_FILES if (file := given.get(name))}
    return {
        "version": __version__,
        "source_path": _resolved(source.summary.path),
        "source_right": _resolved(wanted.get("source", {}).get("right") or ""),
        **{f"given_{name}": _resolved(wanted.get(name) or "") for name in GIVEN_MAPS},
        "calibration": hashlib.sha256(calibration_text(source).encode()).hexdigest(),
        **{f"source_{name}": _digest(Path(file)) for name, file in files.items()},
        **({"networks": deciding(networks)} if networks else {}),
        **settings,
    }


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _by_content(choice: dict[str, Any]) -> dict[str, Any]:
    """Settings of a matcher or a detector, its files named by their hash."""
    files = {name: choice[name] for name in OTHER_FILES if choice.get(name)}
    if BOXES in choice and (drawn := Boxes.parse(choice[BOXES]).path) is not None:
        files[BOXES] = str(drawn)
    named = {name: _digest(Path(file)) for name, file in files.items()}
    if choice.get(CHOICE_KEY) == NETWORK:
        named[NETWORK_FILE] = read_onnx(Path(choice[NETWORK_FILE])).sha256()
    return choice | {name: f"sha256:{digest}" for name, digest in named.items()}


def _resolved(place: str) -> str:
    path = Path(place)
    return str(path.resolve()) if place and path.exists() else place


def without_places(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings without what says only where things lie: a recording must not tell."""
    given = settings.get("source", {})
    source = {key: value for key, value in given.items() if key not in SOURCE_PLACES}
    files = {name: _by_content(settings[name]) for name in WITH_FILES if settings.get(name)}
    settings = settings | files
    for name in GIVEN_MAPS:
        if settings.get(name):
            settings = settings | {"matcher": {"kind": f"given-{name}"}}
    places = ("rig", *GIVEN_MAPS)
    return {key: value for key, value in settings.items() if key not in places} | {"source": source}


def calibration_text(source: FrameSequence[Frame]) -> str:
    """The rig as JSON, without the words about its origin, which may name files.

    Without one what the source says of its camera, or "".
    """
    from pseudolidar.formats.rigs.rig_json import rig_text

    if source.rig is None:
        return source.summary.camera
    return rig_text(replace(source.rig, origin=""))


def source_name(source: FrameSequence[Frame]) -> str:
    """Short name of a source, fit for a recording: the last part of its path."""
    path = source.summary.path
    last = Path(path).resolve().name if Path(path).exists() else path.rpartition("/")[2]
    name = last.rpartition(":")[2].removesuffix(".mcap")
    return _UNFIT_FOR_A_NAME.sub("-", name).strip(".-") or source.summary.kind


def prologue(job: Any, source: FrameSequence[Frame]) -> McapProlog:
    """What a recording of this run says about itself; nothing that changes from run to run."""
    from pseudolidar.formats.mcap.prolog import describe_recording

    settings = without_places(result_settings(job))
    synthetic = any(SYNTHETIC_TIME in note for note in source.summary.notes)
    return describe_recording(
        version=__version__,
        settings=json.dumps(settings, sort_keys=True),
        calibration=calibration_text(source),
        matcher=json.dumps(settings.get("matcher"), sort_keys=True),
        source=f"{source.summary.kind} {source_name(source)}",
        time="synthetic" if synthetic else "recorded",
        poses="of the source where it has them; else map, odom and base_link coincide",
        content=job.mcap,
    )
