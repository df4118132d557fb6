"""Settings survive JSON, name what is wrong in it, and tell what changes results."""

from __future__ import annotations

import enum
import itertools
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import pytest

from pseudolidar.errors import UsageError
from pseudolidar.mapping.odometry import Fused
from pseudolidar.mapping.visual_odometry import VisualOdometry
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, Recognised
from pseudolidar.running.settings_json import (
    from_json,
    result_settings,
    settings_differences,
    to_json,
)
from pseudolidar.running.settings_schema import described
from pseudolidar.stereo.sgbm import Sgbm


class Colour(enum.Enum):
    RED = 1
    BLUE = 2


@dataclass(frozen=True)
class Formats:
    names: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        return cls(tuple(text.split(",")))

    def __str__(self) -> str:
        return ",".join(self.names)


@dataclass(frozen=True)
class Span:
    start: int
    stop: int

    @classmethod
    def parse(cls, text: str) -> Self:
        return cls(*map(int, text.split(":")))


@dataclass(frozen=True)
class Census:
    quality: Literal["fast", "fine"] = "fast"
    disparities: int | None = None
    workers: Annotated[int, RUN_ONLY] = 1


@dataclass(frozen=True)
class BlockMatch:
    block_size: int = 9


@dataclass(frozen=True)
class Folder:
    path: Path
    gain: float = 1.0


@dataclass(frozen=True)
class KittiRaw:
    path: Path


def recognise(text: str) -> Folder | KittiRaw:
    return Folder(Path(text))


@dataclass(frozen=True)
class Job:
    source: Annotated[Folder | KittiRaw, Recognised(recognise)]
    out: Annotated[Path | None, POSITIONAL] = None
    matcher: Census | BlockMatch = Census()
    check: BlockMatch | None = None
    to: Formats = Formats(("pcd",))
    span: Span | None = None
    nested: BlockMatch = BlockMatch(5)
    colour: Colour = Colour.RED
    limits: tuple[float, float] = (0.0, float("inf"))
    amount: int | Literal["auto"] = "auto"
    workers: Annotated[int, RUN_ONLY] = 2


PLAIN = Job(Folder(Path("a b")))
FULL = Job(
    KittiRaw(Path("/k")),
    out=Path("out"),
    matcher=BlockMatch(7),
    check=BlockMatch(3),
    to=Formats(("pcd", "mcap")),
    span=Span(1, 4),
    nested=BlockMatch(1),
    colour=Colour.BLUE,
    limits=(-1.5, 2),
    amount=3,
    workers=8,
)


@pytest.mark.parametrize("job", [PLAIN, FULL, replace(FULL, matcher=Census("fine", 64))])
def test_settings_survive_json(job: Job) -> None:
    text = json.dumps(to_json(job), allow_nan=False)
    assert from_json(Job, json.loads(text)) == job


def test_json_is_what_a_person_would_write() -> None:
    data = to_json(FULL)
    assert data["matcher"] == {"kind": "block-match", "block_size": 7}
    assert data["source"] == {"kind": "kitti-raw", "path": "/k"}
    assert data["to"] == "pcd,mcap"
    assert data["span"] == {"start": 1, "stop": 4}
    assert from_json(Job, {**data, "span": "1:4"}) == FULL


def test_absent_fields_take_their_defaults() -> None:
    assert from_json(Job, {"source": {"kind": "folder", "path": "a b"}}) == PLAIN


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"speed": 3}, "speed"),
        ({"workers": "many"}, "workers"),
        ({"workers": True}, "workers"),
        ({"matcher": {"kind": "magic"}}, "matcher"),
        ({"matcher": "census"}, "matcher"),
        ({"matcher": {"kind": "census", "quality": "best"}}, "matcher.quality"),
        ({"matcher": {"kind": "census", "depth": 1}}, "matcher.depth"),
        ({"limits": [1.0]}, "limits"),
        ({"source": {"kind": "folder"}}, "source.path"),
        ({"colour": "GREEN"}, "colour"),
    ],
)
def test_wrong_json_is_refused_by_the_name_of_the_field(change: dict[str, Any], where: str) -> None:
    with pytest.raises(UsageError) as caught:
        from_json(Job, {**to_json(PLAIN), **change})
    assert caught.value.where == where


def test_what_changes_results_counts_and_nothing_else() -> None:
    same = replace(PLAIN, workers=7, matcher=Census(workers=4))
    assert result_settings(same) == result_settings(PLAIN)
    others = [
        replace(PLAIN, matcher=Census("fine")),
        replace(PLAIN, matcher=BlockMatch()),
        replace(PLAIN, nested=BlockMatch(6)),
        replace(PLAIN, source=KittiRaw(Path("a b"))),
    ]
    jobs = [result_settings(job) for job in [PLAIN, *others]]
    assert all(a != b for a, b in itertools.combinations(jobs, 2))


def test_differences_give_dotted_names_and_both_values() -> None:
    now = replace(PLAIN, matcher=Census("fine"), workers=3)
    found = settings_differences(to_json(PLAIN), to_json(now))
    assert found == [("matcher.quality", "fast", "fine"), ("workers", 2, 3)]


def test_for_people_only_what_was_chosen_is_named():
    assert described(Fused()) == "fused"
    assert described(Fused(VisualOdometry(reach=2))) == "fused (visual.reach 2)"
    assert described(Sgbm()).startswith("sgbm (")
