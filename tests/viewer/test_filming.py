"""Films and pictures of what is looked at."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import av
import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.errors import CloudEmpty
from pseudolidar.evaluation.cloud_views import Eye
from pseudolidar.evaluation.pictures import NOTHING
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.formats.points.ply import write_ply
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.colouring import Colouring
from pseudolidar.viewer.filming.film import Film, write_film, write_picture
from pseudolidar.viewer.filming.flights import RATE_HZ, Chase, along, behind, between, turntable
from pseudolidar.viewer.filming.maker import MOST_PICTURES, FilmMaker
from pseudolidar.viewer.filming.moving import pictures_of
from pseudolidar.viewer.filming.painted import MOST_POINTS, Painter, evenly
from pseudolidar.viewer.filming.shot import Shot
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.octree.build import built
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.stage import Look
from pseudolidar.viewer.stills import PATH_COLOUR, StillCloud, StillOctree, StillPath

FAR = np.array([4.5e5, 5.4e6, 100.0])
SMALL = (160, 90)
RED = (255, 0, 0)


def ground(colour: tuple[int, int, int] = RED, at_m: np.ndarray = FAR) -> PointCloud:
    rng = np.random.default_rng(0)
    xyz = at_m + rng.uniform((0, -5, 0), (30, 5, 0.1), (4000, 3))
    return PointCloud(xyz, "map", rgb=np.full((4000, 3), colour, np.uint8))


def path(length_m: float = 20.0) -> StillPath:
    along_x = np.linspace(0, length_m, 9)
    return StillPath("path", FAR + np.stack([along_x, 0 * along_x, 0 * along_x + 1], axis=1))


@dataclass
class Frames:
    """A rig that drives 1 m a frame over red ground."""

    times_s: Sequence[float] = (0.0, 0.2, 0.3)
    name: str = "frames"
    ids: Sequence[str] = ("a", "b", "c")
    fault: int = -1

    def load(self, index: int) -> Moment:
        if index == self.fault:
            return Moment(self.ids[index], index, fault="dark")
        T = np.eye(4)
        T[:3, 3] = np.add(FAR, (index, 0, 1))
        return Moment(
            self.ids[index], index, clouds={"stereo": ground(at_m=np.array([2.0, 0, -1]))},
            T_map_forward=T,
        )  # fmt: skip


def red_share(picture: np.ndarray) -> float:
    return float((picture == RED).all(axis=2).mean())


def test_a_cloud_is_turned_once_and_in_every_picture():
    film = Film.of(Opened(stills=(StillCloud("ground", ground()),)), size_px=SMALL)
    shots = list(film.shots)
    assert len(shots) == film.count == 350
    eyes = np.array([shot.eye.at_m for shot in shots])
    assert np.ptp(np.linalg.norm(eyes[:, :2] - eyes[:, :2].mean(axis=0), axis=1)) < 0.2
    steps = np.linalg.norm(np.diff(np.vstack([eyes, eyes[:1]]), axis=0), axis=1)
    assert np.ptp(steps) < 1e-6  # it ends where it begins
    for shot in shots[::90]:
        assert 0.05 < red_share(shot.drawn()) < 0.9
        assert (shot.drawn() == NOTHING).all(axis=2).mean() > 0.05


def test_a_map_with_its_path_is_flown_along():
    film = Film.of(Opened(stills=(StillCloud("map", ground()), path())), size_px=SMALL)
    shots = list(film.shots)
    eyes = np.array([shot.eye.at_m for shot in shots])
    assert np.allclose(np.diff(eyes[:, 0]), 20 / (len(shots) - 1), rtol=0.02)
    assert np.abs(np.diff(eyes[:, 1:], axis=0)).max() < 1e-6
    picture = shots[0].drawn()
    assert red_share(picture) > 0.1
    assert (picture == PATH_COLOUR).all(axis=2).any()


def test_what_is_hidden_on_the_page_is_in_no_film():
    hidden = {"hidden": Look(visible=False)}
    stills = (StillCloud("seen", ground()), StillCloud("hidden", ground((0, 0, 255))))
    for opened in (Opened(stills=stills), Opened((Frames(),), stills)):
        for looks, blue in (({}, True), (hidden, False)):
            shot = next(Film.of(opened, looks, size_px=SMALL).shots)
            assert (shot.cloud.rgb == (0, 0, 255)).all(axis=1).any() == blue
            assert (shot.cloud.rgb == RED).all(axis=1).any()
    with pytest.raises(CloudEmpty, match="nothing that could be seen"):
        Film.of(Opened(stills=stills[1:]), hidden)


def test_paths_alone_are_turned():
    assert Film.of(Opened(stills=(path(),)), size_px=SMALL).count == 350


@pytest.mark.parametrize("opened", [Opened(), Opened(stills=(StillCloud("none", ground()[:0]),))])
def test_of_nothing_there_is_no_film(opened: Opened):
    with pytest.raises(CloudEmpty, match="nothing that could be seen"):
        Film.of(opened)


def test_frames_are_shown_as_long_as_they_last_and_the_eye_comes_after():
    film = Film.of(Opened((Frames(),)), size_px=SMALL)
    shots = list(film.shots)
    assert pictures_of(Frames()) == [5, 3, 2]  # 0.2, 0.1 and again 0.1 s at 25 a second
    assert len(shots) == film.count == 10
    ahead = np.array([shot.eye.at_m[0] for shot in shots])
    assert (np.diff(ahead) > 0).all()
    assert ahead[-1] - ahead[0] < 2
    assert (shots[0].drawn() != NOTHING).any(axis=2).mean() > 0.1
    assert np.abs(shots[0].cloud.xyz).max() < 40  # relative to the first pose, and float32


@pytest.mark.parametrize(("fault", "at"), [(0, 0), (1, 5), (2, 9)])
def test_a_frame_that_shows_nothing_does_not_end_a_film(fault: int, at: int):
    shots = list(Film.of(Opened((Frames(fault=fault),)), size_px=SMALL).shots)
    assert len(shots) == 10
    assert len(shots[at].cloud) == 0
    eyes = np.array([shot.eye.at_m for shot in shots])
    assert np.ptp(eyes, axis=0).max() < 3  # and the eye stays where the rig is


class Dark(Frames):
    """A sequence of which nothing can be shown."""

    def load(self, index: int) -> Moment:
        return Moment(self.ids[index], index, fault=f"dark {index}")


@pytest.mark.parametrize("write", [write_picture, lambda film, to: write_film(film, to, bool)])
def test_a_sequence_that_shows_nothing_gives_neither_film_nor_picture(
    tmp_path: Path, write: Callable[[Film, Path], None]
):
    film = Film.of(Opened((Dark(),)), size_px=SMALL)
    with pytest.raises(CloudEmpty, match="dark 0"):
        write(film, tmp_path / "a.mp4")
    assert not list(tmp_path.iterdir())


def test_a_picture_is_of_the_first_frame_that_shows_anything(tmp_path: Path):
    write_picture(Film.of(Opened((Frames(fault=0),)), size_px=SMALL), tmp_path / "a.png")
    pixels = read_image(tmp_path / "a.png").pixels
    assert (pixels != NOTHING).any(axis=2).mean() > 0.1


def test_frames_of_a_film_are_made_as_somebody_says():
    film = Film.of(Opened((Dark(),)), size_px=SMALL, load=Frames().load)
    assert all(len(shot.cloud) for shot in film.shots)


def test_times_that_stand_still_or_jump_give_a_film():
    assert pictures_of(Frames((0.0, 0.0, 0.0))) == [1, 1, 1]
    assert pictures_of(Frames((0.0, 1e6, 1e6))) == [25, 1, 1]
    assert pictures_of(Frames((0.0,))) == [25]


def test_colours_are_those_of_the_page_and_stay():
    painter = Painter({"a": Look(Colouring("height")), "b": Look(visible=False)}, np.zeros(3))
    low = PointCloud(np.float32([[0, 0, 0], [0, 0, 10]]), "map")
    turned = replace(low, xyz=low.xyz[::-1].copy())
    first, again = (painter.cloud("a", one) for one in (low, turned))
    assert first.rgb is not None
    assert again.rgb is not None
    assert np.array_equal(first.rgb, again.rgb[::-1])
    assert not painter.visible("b")


def test_of_a_large_cloud_as_much_is_drawn_as_shows():
    xyz = FAR + np.random.default_rng(0).uniform(-30, 30, (60_000, 3))
    tree = built(PointCloud(xyz, "map"))
    assert len(tree.coarsest(1)) < len(tree.nodes)
    drawn = Painter({}, FAR).still(StillOctree("large", tree))
    assert len(drawn) == min(len(tree), MOST_POINTS)


def test_a_point_is_drawn_as_large_as_it_is():
    one = PointCloud(np.float32([[10, 0, 0]]), "map", rgb=np.uint8([RED]))
    eye = Eye((0.0, 0.0, 0.0), (10.0, 0.0, 0.0), *SMALL)
    side_px = eye.focal_px * 0.5 / 10
    assert side_px == pytest.approx(5.7, abs=0.1)
    drawn_px = np.sqrt((Shot(one, eye, 0.5).drawn()[:, :, 0] > 128).sum())
    assert drawn_px == pytest.approx(side_px, abs=1)


def test_places_are_even_and_bends_are_rounded():
    corner = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0]], float)
    assert np.allclose(np.linalg.norm(np.diff(evenly(corner, 21), axis=0), axis=1), 1.0)
    towards = np.array([np.subtract(eye.towards_m, eye.at_m) for eye in along(corner)])
    turns = np.degrees(np.abs(np.diff(np.arctan2(towards[:, 1], towards[:, 0]))))
    assert turns.max() < 3  # not 90 degrees at once
    assert turns.sum() == pytest.approx(90, abs=1)


def test_an_eye_that_has_time_arrives():
    here = behind(np.zeros(3), np.array([1.0, 0.0, 0.0]))
    there = behind(np.ones(3), np.array([0.0, 1.0, 0.0]))
    assert between(here, there, 1.0) == there
    chase = Chase()
    assert chase.follow(here, 1.0) == here
    assert np.linalg.norm(np.subtract(chase.follow(there, 20.0).at_m, there.at_m)) < 1e-6
    assert turntable(np.zeros((1, 3), np.float32))  # of one point, too


def test_a_film_is_written_whole_or_not_at_all(tmp_path: Path):
    told: list[int] = []
    film = Film.of(Opened((Frames(),)), size_px=SMALL)
    write_film(film, tmp_path / "a.mp4", lambda: told.append(1))
    with av.open(str(tmp_path / "a.mp4")) as container:
        frames = list(container.decode(video=0))
    assert len(frames) == len(told) == 10
    assert (frames[0].width, frames[0].height) == SMALL
    assert frames[-1].time == pytest.approx(9 / RATE_HZ)

    def stopped() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_film(Film.of(Opened((Frames(),)), size_px=SMALL), tmp_path / "b.mp4", stopped)
    assert [file.name for file in tmp_path.iterdir()] == ["a.mp4"]


def test_the_command_writes_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    write_ply(tmp_path / "a.ply", ground())
    assert main(["view", str(tmp_path / "a.ply"), "--export", str(tmp_path / "a.png")]) == 0
    assert str(tmp_path / "a.png") in capsys.readouterr().out
    pixels = read_image(tmp_path / "a.png").pixels
    assert pixels.shape == (1080, 1920, 3)
    assert red_share(pixels) > 0.05


def test_one_film_is_made_at_a_time_and_a_fault_blocks_no_other():
    told, go_on, ended = list[str](), threading.Event(), threading.Semaphore(0)

    def tell(said: str) -> None:
        told.append(said)
        if not said.endswith("..."):
            ended.release()

    def film() -> Film:
        go_on.wait(60)
        if not told[0]:
            raise CloudEmpty("nothing there")
        return Film.of(Opened((Frames(),)), size_px=SMALL)

    maker = FilmMaker(film, tell)
    assert maker.ask()
    assert not maker.ask()
    go_on.set()
    assert ended.acquire(timeout=60)
    assert maker.made is not None
    assert maker.made[4:8] == b"ftyp"
    long = FilmMaker(lambda: Film(MOST_PICTURES + 1, iter(())), tell)
    for _ in range(2):
        assert long.ask()
        assert ended.acquire(timeout=60)
        long._busy.acquire()
        long._busy.release()
        assert "pseudolidar view PATH --export" in told[-1]


def test_films_can_be_stopped_while_one_begins(slow_starts: threading.Event):
    maker = FilmMaker(lambda: Film.of(Opened((Frames(),)), size_px=SMALL), lambda _said: None)
    asking = threading.Thread(target=maker.ask)
    asking.start()
    assert slow_starts.wait(60)
    maker.stop()
    asking.join()
    assert not [thread for thread in threading.enumerate() if thread.name == "film"]
    assert not maker.ask()


def test_a_film_that_nobody_waits_for_is_given_up(caplog: pytest.LogCaptureFixture):
    begun = threading.Event()

    def endless() -> Iterator[Shot]:
        (first, *_) = Film.of(Opened((Frames(),)), size_px=SMALL).shots
        while True:
            begun.set()
            yield first

    maker = FilmMaker(lambda: Film(MOST_PICTURES, endless()), lambda _said: None)
    assert maker.ask()
    assert begun.wait(60)
    maker.stop()
    assert maker._thread is not None
    assert not maker._thread.is_alive()
    assert maker.made is None
    assert not maker.ask()
    assert not [record for record in caplog.records if record.levelname == "ERROR"]
