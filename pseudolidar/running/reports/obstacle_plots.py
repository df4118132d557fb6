"""Plots of what was found over time: how many, how far with error bars, and where from above."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.evaluation.page import Picture
from pseudolidar.running.products.corridor_table import Watched
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.obstacle import Obstacle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Classes with a colour of their own, the most frequent ones; the others share one.
COLOURED, OTHERS, GREY = 7, "others", "0.6"
COLOURS = tuple(f"tab:{name}" for name in ("blue", "orange", "green", "red", "purple", "brown"))
COLOURS = (*COLOURS, "tab:pink")
# Tracks with a line of their own: those seen most often. Obstacles that were not followed are dots,
# at most so many, evenly over the sequence.
MOST_TRACKS, MOST_DOTS = 30, 1500
# So many frames or fewer are bars.
BARS = 60
# Sizes of the plots, inches: two side by side on a page, one below.
BESIDE, SQUARE, BELOW = (9.2, 4.9), (5.4, 4.9), (9.2, 2.4)
# Distances that differ by more than this are drawn in even ratios.
EVEN_RATIOS = 6.0
# The view from above reaches this much beyond where all but this share of the obstacles are.
FAR_SHARE, BEYOND = 0.03, 1.3


@dataclass(frozen=True, eq=False)
class Sighting:
    """One obstacle in one frame.

    Args:
        time_s: since the first frame.
        name: its class, or `OTHERS`.
        obstacle: as it was told.
    """

    time_s: float
    name: str
    obstacle: Obstacle

    @property
    def track_id(self) -> int | None:
        """Whom it was taken for, where it was followed."""
        return None if self.obstacle.track is None else self.obstacle.track.track_id


def sightings(
    frames: Mapping[str, Sequence[Obstacle]], times_s: Mapping[str, float]
) -> list[Sighting]:
    """All obstacles in the order of the frames, classes beyond the most frequent ones as one."""
    counts: dict[str, int] = {}
    for one in (one for found in frames.values() for one in found):
        counts[one.detection.name] = counts.get(one.detection.name, 0) + 1
    frequent = sorted(counts, key=lambda name: (-counts[name], name))
    named = set(frequent if len(frequent) <= COLOURED else frequent[: COLOURED - 1])
    return [
        Sighting(times_s[frame], name if name in named else OTHERS, one)
        for frame, found in frames.items()
        for one in found
        for name in [one.detection.name]
    ]


def count_plot(seen: Sequence[Sighting], times_s: Sequence[float]) -> Picture:
    """How many obstacles of each class each frame shows, on top of one another."""
    figure, axes = _axes("Obstacles in view", ("time, s", "obstacles"), BELOW)
    at = {time: i for i, time in enumerate(times_s)}
    below = np.zeros(len(times_s))
    bars = len(times_s) <= BARS
    width = 0.8 * (np.diff(times_s).min() if len(times_s) > 1 else 1.0)
    for name, colour in colours_of(seen).items():
        count = np.zeros(len(times_s))
        for one in seen:
            count[at[one.time_s]] += one.name == name and not one.obstacle.coasts
        if bars:
            axes.bar(times_s, count, width, bottom=below, color=colour, label=name)
        else:
            axes.fill_between(times_s, below, below + count, color=colour, label=name, step="mid")
        below += count
    axes.set_ylim(0, max(1.0, 1.1 * below.max(initial=0.0)))
    axes.yaxis.get_major_locator().set_params(integer=True)
    _legend(axes)
    return Picture.plot(figure, "obstacles in view by class, over time")


def distance_plot(seen: Sequence[Sighting]) -> Picture:
    """How far each obstacle is over time: a line for each track, with one standard deviation."""
    title = "Distance of the nearest face, with one standard deviation"
    figure, axes = _axes(title, ("time, s", "distance, m"), BESIDE)
    colours = colours_of(seen)
    for track, mine in tracks_of(seen).items():
        times, far, sigma = _columns(mine)
        colour = colours[mine[0].name]
        least = np.maximum(far - sigma, 0.02 * far)
        axes.fill_between(times, least, far + sigma, color=colour, alpha=0.18, linewidth=0)
        axes.plot(times, far, color=colour, linewidth=1.2, marker="." if len(mine) < 40 else "")
        for coasting in _runs(mine):
            axes.plot(*_columns(coasting)[:2], color="white", linewidth=1.6, linestyle=(0, (2, 3)))
        axes.annotate(f"{track}", (times[-1], far[-1]), (3, 0), textcoords="offset points",
                      fontsize=7, color=colour, va="center")  # fmt: skip
    for name, mine in dots_of(seen).items():
        times, far, sigma = _columns(mine)
        below = np.minimum(sigma, 0.98 * far)
        bars = {"fmt": ".", "color": colours[name], "elinewidth": 0.7, "alpha": 0.7}
        axes.errorbar(times, far, (below, sigma), **bars)
    _limits(axes, seen)
    _legend(axes, colours)
    return Picture.plot(figure, "distance of each obstacle over time, with its error bar")


def above_plot(seen: Sequence[Sighting]) -> Picture:
    """Where each obstacle was seen from the left camera, with one standard deviation ahead."""
    figure, axes = _axes("From above, from the left camera", ("right, m", "ahead, m"), SQUARE)
    colours = colours_of(seen)
    for track, mine in tracks_of(seen).items():
        right, ahead, sigma = _places(mine)
        colour = colours[mine[0].name]
        axes.errorbar(right, ahead, sigma, color=colour, linewidth=1.0, elinewidth=0.5, alpha=0.8)
        axes.plot(right[-1:], ahead[-1:], "o", markersize=4, color=colour)
        axes.annotate(f"{track}", (right[-1], ahead[-1]), (4, 2), textcoords="offset points",
                      fontsize=7, color=colour)  # fmt: skip
    for name, mine in dots_of(seen).items():
        right, ahead, sigma = _places(mine)
        axes.errorbar(right, ahead, sigma, fmt=".", color=colours[name], elinewidth=0.7, alpha=0.7)
    axes.plot([0], [0], marker="^", color="black", markersize=8)
    reach_m = BEYOND * float(np.quantile(_places(seen)[1], 1 - FAR_SHARE))
    axes.set(ylim=(-0.02 * reach_m, reach_m), xlim=(-0.55 * reach_m, 0.55 * reach_m))
    axes.set_aspect("equal")
    beyond = int(np.count_nonzero(_places(seen)[1] > reach_m))
    if beyond:
        axes.set_title(f"From above, from the left camera; {beyond} farther off", fontsize="medium")
    return Picture.plot(figure, "where obstacles were, from above; the camera is the triangle")


def corridor_plot(watched: Sequence[Watched], stop_at_m: float | None) -> Picture:
    """How far the nearest thing in the corridor is over time, with one standard deviation."""
    title = "Nearest thing in the corridor, with one standard deviation"
    figure, axes = _axes(title, ("time, s", "distance, m"), BELOW)
    timed = [(one.time_s, one.ahead) for one in watched if one.time_s is not None]
    rows = [(time_s, one.distance_m, one.sigma_m) for time_s, one in timed if one is not None]
    times, far, sigma = np.array(rows, np.float64).reshape(-1, 3).T
    start_s = timed[0][0] if timed else 0.0
    axes.errorbar(times - start_s, far, sigma, fmt=".-", elinewidth=0.7, linewidth=1.0)
    if stop_at_m is not None:
        axes.axhline(stop_at_m, color="tab:red", linestyle="--", linewidth=1.0)
    axes.set_ylim(bottom=0)
    return Picture.plot(figure, "nearest thing in the corridor over time; red: where to stop")


def colours_of(seen: Iterable[Sighting]) -> dict[str, str]:
    """A colour for each class, in the order that they are first seen in."""
    names = list(dict.fromkeys(one.name for one in seen))
    own = [name for name in names if name != OTHERS]
    colours = dict(zip(own, COLOURS, strict=False))
    return colours | ({OTHERS: GREY} if OTHERS in names else {})


def tracks_of(seen: Sequence[Sighting]) -> dict[int, list[Sighting]]:
    """The sightings of those that were followed most often, by identity."""
    by_track: dict[int, list[Sighting]] = {}
    for one in seen:
        if one.track_id is not None:
            by_track.setdefault(one.track_id, []).append(one)
    often = sorted(by_track, key=lambda track: (-len(by_track[track]), track))[:MOST_TRACKS]
    return {track: by_track[track] for track in sorted(often)}


def dots_of(seen: Sequence[Sighting]) -> dict[str, list[Sighting]]:
    """Those that were not followed, by class, thinned evenly."""
    alone = [one for one in seen if one.track_id is None]
    kept = alone[:: max(1, -(-len(alone) // MOST_DOTS))]
    return {name: [one for one in kept if one.name == name] for name in colours_of(kept)}


def _columns(mine: Sequence[Sighting]) -> tuple[Float64, Float64, Float64]:
    """Times, distances, sigmas."""
    rows = [(one.time_s, one.obstacle.distance_m, one.obstacle.sigma_distance_m) for one in mine]
    times, far, sigma = np.array(rows, np.float64).T
    return times, far, sigma


def _places(mine: Sequence[Sighting]) -> tuple[Float64, Float64, Float64]:
    """Right and ahead of the middles of boxes, and sigma of the distance."""
    middles = np.array([one.obstacle.box.pose.translation_m for one in mine])
    return middles[:, 0], middles[:, 2], _columns(mine)[2]


def _runs(mine: Sequence[Sighting]) -> list[list[Sighting]]:
    """Stretches in which a track is only predicted."""
    parts = groupby(mine, key=lambda one: one.obstacle.coasts)
    return [list(part) for coasts, part in parts if coasts]


def _axes(title: str, labels: tuple[str, str], size: tuple[float, float]) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    axes.set_title(title, fontsize="medium")
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.grid(visible=True, alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _limits(axes: Any, seen: Sequence[Sighting]) -> None:
    """A little around what there is; error bars of far things may leave the plot."""
    distances_m = [one.obstacle.distance_m for one in seen]
    nearest_m, farthest_m = min(distances_m), max(distances_m)
    if farthest_m < EVEN_RATIOS * nearest_m:
        axes.set_ylim(0, 1.1 * farthest_m)
        return
    axes.set_yscale("log")
    axes.set_ylim(nearest_m / 1.3, 1.2 * farthest_m)
    steps = (factor * 10.0**power for power in range(-2, 4) for factor in (1, 2, 5))
    shown = [step for step in steps if nearest_m / 1.3 <= step <= 1.2 * farthest_m]
    axes.set_yticks(shown, [f"{step:g}" for step in shown])
    axes.minorticks_off()


def _legend(axes: Any, colours: Mapping[str, str] | None = None) -> None:
    from matplotlib.patches import Patch

    patches = {"handles": [Patch(color=c, label=n) for n, c in (colours or {}).items()]}
    if colours or axes.get_legend_handles_labels()[0]:
        axes.legend(
            **(patches if colours else {}), fontsize=8, frameon=False, loc="center left",
            bbox_to_anchor=(1.0, 0.5),
        )  # fmt: skip
