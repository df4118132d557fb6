"""`report.html` of `obstacles`: what was found, how far and how sure, and how it looks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.evaluation.obstacles import JudgedObject
from pseudolidar.evaluation.page import KeyFigure, Picture, PictureRow, Section, render_page
from pseudolidar.evaluation.preview_picture import Panel, resized
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.obstacle_words import distance_text, name_text, speed_text, unseen_text
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.obstacles.corridor import StopRule
from pseudolidar.running.products.corridor_table import Watched
from pseudolidar.running.products.obstacle_film import FILM_FOLDER, FILM_NAME, read_picture
from pseudolidar.running.products.told import ToldFrame
from pseudolidar.running.reports.conversion_page import REPORT_NAME, rig_rows
from pseudolidar.running.reports.numbers import counted
from pseudolidar.running.reports.obstacle_objects import objects_sections
from pseudolidar.running.reports.obstacle_plots import (
    above_plot,
    corridor_plot,
    count_plot,
    distance_plot,
    sightings,
)
from pseudolidar.running.reports.obstacles_report import states_text
from pseudolidar.running.reports.run_sections import notes_section, skips_section
from pseudolidar.running.results import RunResult
from pseudolidar.structures.arrays import UInt8
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.obstacle import Obstacle

# Pictures of a page, and how wide they are, px.
MOST_PICTURES, PICTURE_PX = 6, 1500
# A picture takes a third of the time of a frame.
FRAMES_PER_PICTURE = 5
# Rows of a page: the nearest of each frame first.
MOST_ROWS = 200
NONE = "-"
CLASS_HEADER = (
    "class", "obstacles", "in frames", "tracks", "nearest", "median distance", "median sigma",
    "by size alone",
)  # fmt: skip


def write_obstacles_page(
    folder: Path,
    result: RunResult,
    told: Mapping[str, ToldFrame],
    *,
    rig: StereoRig | None,
    settings: Mapping[str, str],
    corridor: Sequence[Watched] | None = None,
    stop: StopRule | None = None,
) -> Path:
    """Write `report.html`, self-contained but for the film, from what a run left in its folder.

    Args:
        folder: output folder.
        result: how the run ended.
        told: its frames with their obstacles.
        rig: of the frames, where there is one.
        settings: what was chosen, by name, for the reader.
        corridor: the nearest thing in it, frame by frame; None where none was watched.
        stop: what may not be in the corridor.

    Returns:
        Path of the page.

    Raises:
        OutputError: the disk is full or gone, or a picture was changed by somebody.
    """
    frames = {name: frame.obstacles for name, frame in told.items()}
    judged = [one for frame in told.values() for one in frame.judged]
    start_ns = next((frame.time_ns for frame in told.values()), 0)
    times_s = {name: (frame.time_ns - start_ns) / NS_PER_S for name, frame in told.items()}
    sections = [
        *classes_section(frames),
        *_plots(frames, times_s),
        *corridor_section(corridor, stop),
        *([Section("Film", video=FILM_NAME)] if (folder / FILM_NAME).exists() else []),
        *pictures_section(folder, frames, times_s),
        *objects_sections(judged),
        *listed_section(frames),
        *skips_section(result),
        *notes_section(result),
        Section("How it was made", table=_overview(result, rig, settings)),
    ]
    page = render_page(
        result.source.line,
        "distances are those of the nearest face; sigma is one standard deviation (68 %)",
        sections,
        lead=_lead(frames),
        keys=_keys(result, frames, judged),
    )
    path = folder / REPORT_NAME
    write_atomic(path, page)
    return path


def classes_section(frames: Mapping[str, Sequence[Obstacle]]) -> list[Section]:
    """How many of each class were found, how near and how sure; none where nothing was."""
    names = list(dict.fromkeys(one.detection.name for one in _seen(frames)))
    rows = [_class_row(name, frames) for name in names]
    rows.sort(key=lambda row: -int(row[1].replace(",", "")))
    text = "By size alone: without points of their own, as far as their size and footing say."
    return [Section("What was found", text, rows, header=CLASS_HEADER)] if rows else []


def corridor_section(corridor: Sequence[Watched] | None, stop: StopRule | None) -> list[Section]:
    """The corridor over time; none where none was watched."""
    if corridor is None:
        return []
    text = f"{states_text(corridor).capitalize()}. Each frame is in corridor.csv."
    limit_m = None if stop is None else stop.limit_m
    seen = any(one.ahead is not None for one in corridor)
    return [Section("Corridor", text, plots=[corridor_plot(corridor, limit_m)] if seen else [])]


def pictures_section(
    folder: Path, frames: Mapping[str, Sequence[Obstacle]], times_s: Mapping[str, float]
) -> list[Section]:
    """A few frames with their obstacles drawn in, of those that the run made pictures of."""
    there = {name for name in frames if (folder / FILM_FOLDER / f"{name}.json").exists()}
    chosen = _spread([name for name in frames if name in there], frames)
    rows = [
        PictureRow((Picture.photo(_small(picture), f"{name}, {times_s[name]:.2f} s"),))
        for name in chosen
        for picture in [read_picture(folder, name, frames[name], time_s=times_s[name])]
    ]
    text = (
        "Photo with boxes, disparity, depth, and the view from above: its white bars are one "
        "standard deviation each way from the nearest face; dashed boxes are only predicted."
    )
    return [Section("Frames", text, pictures=rows)] if rows else []


def listed_section(frames: Mapping[str, Sequence[Obstacle]]) -> list[Section]:
    """What was found, the nearest of each frame first; none where nothing was."""
    rows = [
        (frame, name_text(one), distance_text(one), _size(one), _how(one))
        for frame, found in frames.items()
        for one in found
    ]
    left_out = len(rows) - MOST_ROWS
    section = Section(
        "Obstacle by obstacle",
        f"and {left_out} more, in obstacles.csv" if left_out > 0 else "",
        table=rows[:MOST_ROWS],
        header=("frame", "obstacle", "distance", "length x width x height", "more"),
        cells="words",
    )
    return [section] if rows else []


def _plots(frames: Mapping[str, Sequence[Obstacle]], times_s: Mapping[str, float]) -> list[Section]:
    seen = sightings(frames, times_s)
    if not seen:
        return []
    plots = [distance_plot(seen), above_plot(seen), count_plot(seen, list(times_s.values()))]
    text = "Numbers are identities of tracks; white dashes where one is only predicted."
    tracked = any(one.track_id is not None for one in seen)
    return [Section("Over time", text if tracked else "", plots=plots)]


def _lead(frames: Mapping[str, Sequence[Obstacle]]) -> str:
    seen = list(_seen(frames))
    if not seen:
        return f"Nothing was found in {counted(len(frames), 'frame')}."
    nearest, where = _nearest(frames)
    return (
        f"{counted(len(seen), 'obstacle')} in {counted(len(frames), 'frame')}; the nearest, "
        f"{name_text(nearest)}, at {distance_text(nearest)} in frame {where}."
    )


def _keys(
    result: RunResult, frames: Mapping[str, Sequence[Obstacle]], judged: Sequence[JudgedObject]
) -> list[KeyFigure]:
    seen = list(_seen(frames))
    skipped = f"{len(result.skipped)} skipped" if result.skipped else "none skipped"
    keys = [
        KeyFigure("frames", f"{len(result.committed)} of {result.total}", skipped),
        KeyFigure("obstacles", f"{len(seen) / max(1, len(frames)):.1f}", "a frame"),
    ]
    tracks = {one.track.track_id for one in seen if one.track is not None}
    if tracks:
        keys.append(KeyFigure("tracks", f"{len(tracks):,}", "things that were followed"))
    if seen:
        nearest, where = _nearest(frames)
        keys.append(KeyFigure("nearest", distance_text(nearest), f"{name_text(nearest)}, {where}"))
    off = [abs(one.measured_m - one.true_m) for one in judged if one.measured_m is not None]
    if judged:
        found = f"{len(off)} of {counted(len(judged), 'labelled object')} found"
        keys.append(KeyFigure("off the labels", f"{np.median(off):.2f} m" if off else NONE, found))
    return keys


def _overview(
    result: RunResult, rig: StereoRig | None, settings: Mapping[str, str]
) -> list[tuple[str, str]]:
    rows = list(settings.items())
    for name, network in result.figures_of_run.get("networks", {}).items():
        words = f"{network['file']}, sha256 {network['sha256']}, licence: {network['licence']}"
        if "median_ms" in network:
            words += f"; {network['median_ms']:.1f} ms a frame on {network['provider']} (median)"
        rows.append((f"network of the {name}", words))
    if rig is not None:
        rows += rig_rows(rig)
    if (density := result.figures.get("density")) is not None:
        rows.append(("density", f"{density['mean']:.1%} of the pixels have a depth"))
    return rows


def _class_row(name: str, frames: Mapping[str, Sequence[Obstacle]]) -> tuple[str, ...]:
    mine = [one for one in _seen(frames) if one.detection.name == name]
    shown_in = sum(
        any(one.detection.name == name and not one.coasts for one in found)
        for found in frames.values()
    )
    tracks = {one.track.track_id for one in mine if one.track is not None}
    return (
        name,
        f"{len(mine):,}",
        f"{shown_in:,}",
        f"{len(tracks):,}" if tracks else NONE,
        distance_text(min(mine, key=lambda one: one.distance_m)),
        f"{np.median([one.distance_m for one in mine]):.1f} m",
        f"{np.median([one.sigma_distance_m for one in mine]):.2f} m",
        f"{sum(one.measured_by == 'size' for one in mine):,}",
    )


def _seen(frames: Mapping[str, Sequence[Obstacle]]) -> list[Obstacle]:
    """All but those that are only predicted."""
    return [one for found in frames.values() for one in found if not one.coasts]


def pictures_for(frames: int) -> int:
    """How many of so many frames are shown."""
    return min(MOST_PICTURES, max(1, frames // FRAMES_PER_PICTURE))


def _nearest(frames: Mapping[str, Sequence[Obstacle]]) -> tuple[Obstacle, str]:
    """The nearest of all, and its frame."""
    every = [(one, name) for name, found in frames.items() for one in found if not one.coasts]
    return min(every, key=lambda pair: pair[0].distance_m)


def _spread(names: Sequence[str], frames: Mapping[str, Sequence[Any]]) -> list[str]:
    """A few of the frames in which something was found, evenly over the sequence."""
    with_some = [name for name in names if frames[name]] or list(names)
    count = min(len(with_some), MOST_PICTURES)
    return [with_some[i * len(with_some) // count] for i in range(count)]


def _small(pixels: UInt8) -> UInt8:
    height, width = pixels.shape[:2]
    wide = min(width, PICTURE_PX)
    return resized(Panel(pixels, ""), (wide, round(height * wide / width)))


def _size(obstacle: Obstacle) -> str:
    box = obstacle.box
    return f"{box.length_m:.1f} x {box.width_m:.1f} x {box.height_m:.1f} m"


def _how(obstacle: Obstacle) -> str:
    """Speed, and what to be careful about."""
    said = [speed_text(obstacle), unseen_text(obstacle)]
    said += ["by its size alone"] * (obstacle.measured_by == "size")
    said += ["cut by the border"] * obstacle.truncated + ["partly hidden"] * obstacle.occluded
    said += ["or nearer"] * obstacle.bound
    return ", ".join(part for part in said if part) or NONE
