"""Other sequences beside the first one: their clouds in the same scene, aligned in time."""

from __future__ import annotations

import re
import threading
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np

from pseudolidar.errors import SourceEmpty
from pseudolidar.geometry.frame_chain import chain
from pseudolidar.geometry.twists import inverted
from pseudolidar.running.comparing.partners import partners_of
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose
from pseudolidar.viewer.moment import VELODYNE, Moment
from pseudolidar.viewer.opening import RUN_FILE
from pseudolidar.viewer.reel import Reel, SourceReel

# What names of nodes and clouds do not hold, and their longest.
ODD, LONGEST = re.compile(r"[^\w .:()+-]+"), 40


@dataclass(frozen=True)
class Companion:
    """A sequence that is shown with another.

    Args:
        label: what it is called in the scene.
        reel: its frames.
        partners: its index by the index in the first sequence.
        how: they were paired, in words.
    """

    label: str
    reel: Reel
    partners: Mapping[int, int]
    how: str

    @classmethod
    def of(cls, label: str, reel: Reel, first: Reel) -> Self:
        """Frames by name, by number or by the nearest time, as for `compare`; else by place.

        Args:
            label: what it is called.
            reel: the sequence.
            first: the one that it is shown with.
        """
        if isinstance(reel, SourceReel) and isinstance(first, SourceReel):
            try:
                found = partners_of(first.source, reel.source)
            except SourceEmpty:  # neither names nor times in common
                pass
            else:
                place = {name: index for index, name in enumerate(first.ids)}
                pairs = {place[name]: index for name, index in found.indices.items()}
                return cls(label, reel, pairs, found.how)
        count = min(len(first.ids), len(reel.ids))
        return cls(label, reel, {i: i for i in range(count)}, f"{count} frames by their place")

    def name(self, cloud: str) -> str:
        """What one of its clouds is called in the scene."""
        return f"{self.label}: {cloud}"


class Companions:
    """Adds the clouds of other sequences to frames of the first one.

    May be changed while frames are made; those made before know nothing of it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._every: tuple[Companion, ...] = ()

    @property
    def every(self) -> tuple[Companion, ...]:
        """In the order that they were added."""
        return self._every

    def add(self, companion: Companion) -> None:
        """Show it from now on, in place of any of that label."""
        with self._lock:
            others = (one for one in self._every if one.label != companion.label)
            self._every = (*others, companion)

    def __call__(self, moment: Moment) -> Moment:
        """The frame with those of all others that belong to it."""
        for companion in self._every:
            index = companion.partners.get(moment.index)
            if index is not None:
                moment = beside(moment, companion.reel.load(index), companion)
        return moment


def beside(moment: Moment, other: Moment, companion: Companion) -> Moment:
    """A frame with the clouds of another one; a scan that both have is shown once."""
    if other.fault:
        said = (moment.fault, f"{companion.label}: {other.fault}")
        return replace(moment, fault="; ".join(filter(None, said)))
    clouds, makings = dict(moment.clouds), dict(moment.makings)
    for name, cloud in other.clouds.items():
        if name == VELODYNE and name in moment.clouds:
            continue
        clouds[companion.name(name)] = _placed(cloud, other, moment)
        if name in other.makings:
            makings[companion.name(name)] = other.makings[name]
    return replace(moment, clouds=clouds, makings=makings)


def _placed(cloud: PointCloud, other: Moment, moment: Moment) -> PointCloud:
    """A cloud in the frame of a moment's clouds: by the rig's calibration, else by both poses."""
    frame = next((each.frame for each in moment.clouds.values()), cloud.frame)
    if cloud.frame == frame:
        return cloud
    tree = () if moment.converted is None else moment.converted.tree
    T = chain(tree, frame, cloud.frame)
    if T is None and moment.T_map_forward is not None and other.T_map_forward is not None:
        matrix = inverted(moment.T_map_forward) @ other.T_map_forward
        T = Pose(frame, cloud.frame, np.asarray(matrix))
    return cloud if T is None else cloud.transformed(T)


def label_of(reel: Reel, taken: Collection[str]) -> str:
    """A short name of a sequence: of its folder, or of the run that wrote that; none of `taken`."""
    name = reel.name
    if isinstance(reel, SourceReel):
        place = Path(reel.source.summary.path)
        run = place.parent if (place.parent / RUN_FILE).is_file() else place
        name = run.name or name
    short = ODD.sub("_", name)[:LONGEST].strip(" _") or "other"
    number = 2
    label = short
    while label in taken:
        label, number = f"{short} ({number})", number + 1
    return label
