"""Obstacles as they are told, with their tracks: in the order of the source, whoever did what.

Who is who is known only from the frames before. So frames are found in parallel, and told one after
the other as they come; those that an earlier run committed are told again from their files, so that
a run that goes on knows what an uninterrupted one does.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.evaluation.obstacles import JudgedObject
from pseudolidar.formats.obstacle_json import obstacle_fields
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.formats.track_json import track_fields
from pseudolidar.obstacles.coasting import LastSeen
from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.running.products.found import FoundFrame, found_name, parse_found, read_found
from pseudolidar.running.products.product import Product
from pseudolidar.structures.obstacle import Obstacle


@dataclass(frozen=True, eq=False)
class ToldFrame:
    """A frame's obstacles as they are told at the end, with their tracks where they have any.

    Those that are seen come first, from near to far, then those whose tracks are only predicted.

    Args:
        time_ns: of the picture.
        fields: of each, for tables.
        obstacles: the same, without their pixels.
        judged: the labels that count, each beside what was measured of it.
    """

    time_ns: int
    fields: list[dict[str, Any]]
    obstacles: tuple[Obstacle, ...]
    judged: tuple[JudgedObject, ...] = ()


class Telling:
    """Tells frames in their order; `told` has them all.

    Args:
        folder: output folder.
        ids: of all frames, in their order.
        committed: those that are whole from an earlier run and not done again.
        tracker: follows obstacles; None for none.
    """

    def __init__(
        self, folder: Path, ids: Sequence[str], committed: Collection[str], tracker: Tracker | None
    ) -> None:
        self.told: dict[str, ToldFrame] = {}
        self._folder, self._committed = folder, frozenset(committed)
        self._left = iter(ids)
        self._last_seen = LastSeen()
        self._follow = None if tracker is None else tracker.load()

    def __call__(self, name: str, product: Product) -> ToldFrame:
        """The next frame that was done, after all before it that were committed earlier.

        Raises:
            LabelError: a file of an earlier run was changed by somebody.
            SequenceTime: tracks are asked for, and the frame is not later than the one before.
        """
        self._tell_committed(iter(self._left.__next__, name))
        (data,) = (file.data for file in product.files if file.name == found_name(name))
        return self._tell(name, parse_found(data, where=name))

    def finish(self, committed: Collection[str]) -> dict[str, ToldFrame]:
        """All frames by their ids, those that are committed after the last one done too.

        Args:
            committed: all that are whole, also of frames that this run had no need to come to.

        Raises:
            LabelError, SequenceTime: as a frame that was done.
        """
        self._committed = frozenset(committed)
        self._tell_committed(self._left)
        return self.told

    def _tell_committed(self, names: Iterable[str]) -> None:
        for name in names:
            if name in self._committed:
                self._tell(name, read_found(self._folder, name))

    def _tell(self, name: str, frame: FoundFrame) -> ToldFrame:
        seen, unseen = frame.parsed(name), tuple[Obstacle, ...]()
        if self._follow is not None:
            followed = self._follow(seen, frame.time_ns, frame.T_map_camera)
            seen, unseen = followed.obstacles, self._last_seen(followed, frame.camera)
        fields = [
            {**one, **({} if obstacle.track is None else track_fields(obstacle.track))}
            for one, obstacle in zip(frame.obstacles, seen, strict=True)
        ]
        fields += [
            obstacle_fields(one, frame=name, time_s=frame.time_ns / NS_PER_S, number=number)
            for number, one in enumerate(unseen, start=1 + len(seen))
        ]
        self.told[name] = ToldFrame(frame.time_ns, fields, (*seen, *unseen), frame.judged)
        return self.told[name]
