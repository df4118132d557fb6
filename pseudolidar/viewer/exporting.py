"""A scene as one file that opens without a server: a page, viser's recording, a film, a picture."""

from __future__ import annotations

from pathlib import Path

from pseudolidar.errors import UsageError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.progress import FrameProgress
from pseudolidar.viewer.app import App
from pseudolidar.viewer.filming.film import PICTURE_PX, Film, write_film, write_picture
from pseudolidar.viewer.filming.outlined import FilmedObjects
from pseudolidar.viewer.opening import Opened

# Of viser's own kinds of file, and of those that are drawn here.
SCENES, DRAWN = (".html", ".viser"), (".mp4", ".png")


def check_export(path: Path) -> None:
    """Refuse a name of neither kind, before there is any work.

    Raises:
        UsageError: it ends otherwise.
    """
    if path.suffix.lower() not in (*SCENES, *DRAWN):
        raise UsageError(
            f"a file named {path.suffix or 'without extension'}",
            want=" or ".join((*SCENES, *DRAWN)),
            path=path,
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
    if path.suffix.lower() == ".png":
        write_picture(Film.of(opened, size_px=PICTURE_PX, objects=objects), path)
        return
    film = Film.of(opened, objects=objects)
    with FrameProgress(film.count, what=path.stem) as progress:
        write_film(film, path, progress.advance)


def export(app: App, path: Path) -> None:
    """Write what an app shows, all frames at the pace of their times.

    Args:
        app: with nothing drawn yet.
        path: of viser's own kinds of file.

    Raises:
        OutputError: the disk is full or gone.
    """
    view = app.view
    serializer = view.server.viser.get_scene_serializer()
    times_s = view.reel.times_s
    if app.path is not None:
        app.path.wait()
    with FrameProgress(len(times_s)) as progress:
        for index, time_s in enumerate(times_s):
            view.show(view.settled(index))
            following_s = times_s[min(index + 1, len(times_s) - 1)]
            serializer.insert_sleep(max(float(following_s - time_s), 0.0))
            progress.advance()
    if path.suffix.lower() == ".html":
        write_atomic(path, serializer.as_html(dark_mode=view.dark).encode())
    else:
        write_atomic(path, serializer.serialize())
