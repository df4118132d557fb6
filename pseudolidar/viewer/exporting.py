"""A scene as one file that opens without a server: a page, viser's recording, a film, a picture."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from pseudolidar.errors import UsageError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.progress import FrameProgress
from pseudolidar.viewer.app import App
from pseudolidar.viewer.filming.film import PICTURE_PX, Film, write_film, write_picture
from pseudolidar.viewer.filming.outlined import FilmedObjects
from pseudolidar.viewer.filming.painted import nothing_seen
from pseudolidar.viewer.objects.scene import ObjectScene
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.stills import is_empty
from pseudolidar.viewer.timeline import LONGEST_WAIT_S

_log = logging.getLogger(__name__)

# Of viser's own kinds of file, and of those that are drawn here.
SCENES, DRAWN = (".html", ".viser"), (".mp4", ".png")


@dataclass
class Hindered:
    """Frames in which nothing could be looked for: said once, for no page says it.

    Args:
        frames: how many.
        why: of the first one.
    """

    frames: int = 0
    why: str = ""

    def see(self, scene: ObjectScene) -> ObjectScene:
        """The objects of the next frame, as they are."""
        if scene.hindered:
            self.frames, self.why = self.frames + 1, self.why or scene.text
        return scene

    def tell(self) -> None:
        """Say how many there were."""
        if self.frames:
            _log.warning("no objects in %d frames: %s", self.frames, self.why)


def check_export(path: Path, paths: Sequence[str]) -> None:
    """Refuse what cannot be exported before there is any work.

    Args:
        path: the file to be written.
        paths: what it is to be made of.

    Raises:
        UsageError: the file's name does not end as one of those that can be written, or there are
            no paths.
    """
    if path.suffix.lower() not in (*SCENES, *DRAWN):
        raise UsageError(
            f"a file named {path.suffix or 'without extension'}",
            want=" or ".join((*SCENES, *DRAWN)),
            path=path,
            where="--export",
        )
    if not paths:
        raise UsageError(
            "no path of what is to be exported",
            want="sources, folders of runs, files of clouds, meshes, trajectories",
            fix=f"pseudolidar view PATH --export {path}",
            where="--export",
        )


def is_drawn(path: Path) -> bool:
    """Whether a file is a film or a picture, for which nothing is served."""
    return path.suffix.lower() in DRAWN


def draw(opened: Opened, path: Path, objects: FilmedObjects) -> None:
    """Write a film of what was opened, or its first picture.

    Args:
        opened: what is looked at.
        path: of the file.
        objects: of the frames of its first sequence.

    Raises:
        CloudEmpty: there is nothing to be seen.
        OutputError: the disk is full or gone.
    """
    hindered = Hindered()
    seen = replace(objects, scenes=lambda moment: hindered.see(objects.scenes(moment)))
    if path.suffix.lower() == ".png":
        write_picture(Film.of(opened, size_px=PICTURE_PX, objects=seen), path)
    else:
        film = Film.of(opened, objects=seen)
        with FrameProgress(film.count, what=path.stem) as progress:
            write_film(film, path, progress.advance)
    hindered.tell()


def export(app: App, path: Path) -> None:
    """Write what an app shows, all frames at the pace of their times.

    Args:
        app: with nothing drawn yet.
        path: of viser's own kinds of file.

    Raises:
        CloudEmpty: there is nothing to be seen in any frame.
        OutputError: the disk is full or gone.
    """
    view = app.view
    seen = any(not is_empty(still) for still in view.stage.every_still)
    serializer = view.server.viser.get_scene_serializer()
    times_s, hindered, fault = view.reel.times_s, Hindered(), ""
    if app.path is not None:
        app.path.wait()
    with FrameProgress(len(times_s)) as progress:
        for index, wait_s in enumerate(waits_s(times_s)):
            moment = view.settled(index)
            seen = seen or any(map(len, moment.clouds.values()))
            fault = fault or moment.fault
            view.show(moment)
            hindered.see(app.objects_shown())
            serializer.insert_sleep(wait_s)
            progress.advance()
    hindered.tell()
    if not seen:
        raise nothing_seen(fault)
    if path.suffix.lower() == ".html":
        write_atomic(path, serializer.as_html(dark_mode=view.dark).encode())
    else:
        write_atomic(path, serializer.serialize())


def waits_s(times_s: Sequence[float]) -> list[float]:
    """How long each frame is shown: the last one as long as the one before, a single one for ever.

    Gaps are waited for no longer than on the page.
    """
    steps = [later - earlier for earlier, later in pairwise(times_s)]
    waits = [min(max(float(step), 0.0), LONGEST_WAIT_S) for step in steps]
    return [*waits, *(waits[-1:] or [0.0])]
