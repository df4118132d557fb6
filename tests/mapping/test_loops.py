"""Places that are seen again on a rendered block, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import UsageError
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.projection import project
from pseudolidar.geometry.twists import exp_twist, inverted, log_twist
from pseudolidar.mapping.loop_check import LEAST_COLUMNS, _columns, _off_plane, verified
from pseudolidar.mapping.loops import LoopFinder
from pseudolidar.mapping.place_store import MOST_LOADED, PlaceFile, PlaceStore
from pseudolidar.mapping.words import WordIndex, nearest
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.loop import LoopClosure

# Frames of the first round, and of the second 320 later; every fourth is 3.2 m on.
FIRST, SECOND = range(0, 32, 4), range(330, 342, 4)


@pytest.fixture(scope="module")
def rounds():
    """Frames with exact disparities, and the exact poses of their left cameras."""
    source = Synthetic("block:400", width_px=416).open()
    frames = [source.load(i) for i in (*FIRST, *SECOND)]
    T_base_left = left_in_base_link(source.rig).matrix
    T = np.stack([frame.pose.matrix @ T_base_left for frame in frames])
    return frames, inverted(T[0]) @ T


@pytest.fixture(scope="module")
def search(rounds):
    """The finder that saw both rounds, and the loops that it told."""
    frames, T = rounds
    finder, loops = LoopFinder(apart_m=25.0).start(frames[0].rig), []
    for frame, pose in zip(frames, T, strict=True):
        piece = int(frame.index >= SECOND[0])
        loops += finder.add(frame.index, frame, frame.truth, pose, piece=piece)
    return finder, loops


def test_the_second_round_finds_the_first(rounds, search):
    frames, T = rounds
    _, loops = search
    at = {frame.index: i for i, frame in enumerate(frames)}
    assert {loop.later.index for loop in loops} == set(SECOND)
    for loop in loops:
        exact = inverted(T[at[loop.earlier.index]]) @ T[at[loop.later.index]]
        error = log_twist(inverted(exact) @ loop.T_earlier_later)
        assert np.linalg.norm(error[:3]) < 0.1
        assert np.linalg.norm(error[3:]) < np.deg2rad(0.5)
        assert loop.overlap > 0.9
        assert loop.inliers >= 30
        assert loop.residual_px < 1.5


def test_a_loop_waits_for_a_second_one(rounds):
    frames, T = rounds
    finder = LoopFinder(apart_m=25.0).start(frames[0].rig)
    for i in range(len(FIRST)):
        finder.add(frames[i].index, frames[i], frames[i].truth, T[i])
    again = len(FIRST)
    first = finder.add(frames[again].index, frames[again], frames[again].truth, T[again], piece=1)
    assert first == []
    assert finder.refused["unconfirmed"] == 1


def test_other_depths_are_refused(rounds, search):
    """Where the picture is the same and the depths are not, as on a poster of the place."""
    finder, loops = search
    places = {note.end.index: finder._places.load(note.number) for note in finder._places}
    rig = rounds[0][0].rig
    earlier, later = (places[end.index] for end in (loops[-1].earlier, loops[-1].later))
    assert isinstance(verified(earlier, later, rig), LoopClosure)
    flat = replace(later, depth_cells_m=np.full_like(later.depth_cells_m, 12.0))
    assert verified(earlier, flat, rig) == "overlap"
    nothing = replace(later, uv=later.uv[:5], d=later.d[:5], descriptors=later.descriptors[:5])
    assert verified(earlier, nothing, rig) == "few_matches"


def test_a_road_alone_is_no_place():
    """Points that agree perfectly and lie on one plane, but for those of one narrow thing."""
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(-6, 6, 60), np.full(60, 1.65), rng.uniform(6, 25, 60)])
    car = rng.uniform([-0.8, 0.2, 20.0], [0.8, 1.2, 20.5], (30, 3))
    assert _off_plane(ground).sum() == 0
    off = _off_plane(np.concatenate([ground, car]))
    assert off.sum() == 30
    assert off[60:].all()
    rig = Synthetic("block", width_px=416).open().rig
    uv, _ = project(car, rig.P_left)
    assert _columns(uv, rig) < LEAST_COLUMNS


def test_odometry_is_never_off_by_so_much(rounds):
    frames, T = rounds
    finder, loops = LoopFinder(apart_m=25.0).start(frames[0].rig), []
    far = np.eye(4)
    far[0, 3] = 200.0
    for frame, pose in zip(frames, T, strict=True):
        pose = far @ pose if frame.index >= SECOND[0] else pose
        loops += finder.add(frame.index, frame, frame.truth, pose)
    assert loops == []
    assert finder.refused["drift"] >= len(SECOND)


def test_frames_are_wanted_where_the_camera_went_on(rounds):
    frames, T = rounds
    finder = LoopFinder().start(frames[0].rig)
    assert finder.wants(T[0])
    finder.add(0, frames[0], frames[0].truth, T[0])
    ahead, turned = (exp_twist(np.eye(6)[axis] * by) for axis, by in ((2, 3.1), (4, 0.3)))
    assert not finder.wants(T[0])
    assert finder.wants(T[0] @ ahead)
    assert finder.wants(T[0] @ turned)
    assert finder.wants(T[0], piece=1)


def test_places_come_back_from_disk_and_few_are_in_memory(search, tmp_path):
    first = search[0]._places.load(0)
    store = PlaceStore(PlaceFile(tmp_path / "work" / "places"))
    count = MOST_LOADED + 8
    for i in range(count):
        store.add(replace(first, number=i, d=first.d + np.float32(i)))
    for i in (0, count - 1, *range(count)):
        place = store.load(i)
        assert np.array_equal(place.d, first.d + np.float32(i))
        for name in ("uv", "descriptors", "depth_cells_m", "grey_cells"):
            assert np.array_equal(getattr(place, name), getattr(first, name), equal_nan=True)
    assert len(store._loaded) == MOST_LOADED
    assert (tmp_path / "work" / "places").stat().st_size == store.bytes


def test_a_file_of_places_is_closed(tmp_path):
    with PlaceFile(tmp_path / "places") as file:
        file.write(b"12", 0)
        assert file.read(2, 0) == b"12"
    with pytest.raises(ValueError, match="closed"):
        file.read(2, 0)


def test_what_is_kept_is_small(search):
    finder, _ = search
    assert finder.bytes / finder.places < 30_000


def test_words_tell_the_place_that_is_alike():
    rng = np.random.default_rng(0)
    places = [rng.integers(0, 256, (120, 32), np.uint8) for _ in range(12)]
    index = WordIndex()
    for descriptors in places:
        index.add(descriptors)
    noise = np.packbits(rng.random((120, 256)) < 0.04, axis=1)
    index.add(places[3] ^ noise)
    likeness = index.similar()
    assert likeness.argmax() == 3
    assert likeness[3] > 3 * np.delete(likeness, 3).max()
    bits, rows = nearest(places[3] ^ noise, places[3])
    assert np.array_equal(rows[:, 0], np.arange(120))
    assert np.array_equal(bits[:, 0], np.bitwise_count(noise).sum(axis=1))


def test_nothing_to_see_is_no_place(rounds):
    frame, finder = rounds[0][0], LoopFinder().start(rounds[0][0].rig)
    black = replace(frame, left=np.zeros_like(frame.left), right=np.zeros_like(frame.right))
    for i in range(10):
        assert finder.add(i, black, frame.truth, np.eye(4), piece=i) == []


def test_numbers_that_mean_nothing_are_refused(rounds):
    with pytest.raises(UsageError):
        LoopFinder(candidates=0).start(rounds[0][0].rig)
