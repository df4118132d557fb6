"""Films that a page asks for: one at a time, in a thread of its own, kept until the next one."""

from __future__ import annotations

import logging
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

from pseudolidar.errors import PseudolidarError, UsageError
from pseudolidar.viewer.filming.film import Film, write_film

_log = logging.getLogger(__name__)
# Pictures of a film that a page asks for; longer ones are made by the command.
MOST_PICTURES = 1500
# How often it is told how far one is, in pictures.
TOLD_EVERY = 10


class GivenUp(Exception):
    """The film is not made."""


class FilmMaker:
    """Makes one film at a time.

    Args:
        film: what is looked at, as a film; called in the maker's thread.
        tell: takes one line about how it goes.
    """

    def __init__(self, film: Callable[[], Film], tell: Callable[[str], None]) -> None:
        self._film, self._tell = film, tell
        self._busy, self._ended = threading.Lock(), threading.Event()
        self._beginning = threading.Lock()
        self._thread: threading.Thread | None = None
        self.made: bytes | None = None

    def ask(self) -> bool:
        """Have a film made; False where one is being made already, or none is made any more."""
        with self._beginning:
            if self._ended.is_set() or not self._busy.acquire(blocking=False):
                return False
            thread = threading.Thread(target=self._make, name="film", daemon=True)
            thread.start()
            self._thread = thread
        return True

    def stop(self) -> None:
        """Make no more films; the one that is being made is given up."""
        with self._beginning:
            self._ended.set()
            thread = self._thread
        if thread is not None:
            thread.join()

    def _make(self) -> None:
        try:
            self._tell("the film is begun ...")
            self.made = self._bytes_of(self._film())
            self._tell("")
        except GivenUp:
            _log.info("the film was given up")
        except PseudolidarError as error:
            self._tell(str(error))
        except Exception:  # a film that fails must not block the next one
            _log.exception("no film")
            self._tell("no film: see the terminal")
        finally:
            self._busy.release()

    def _bytes_of(self, film: Film) -> bytes:
        if film.count > MOST_PICTURES:
            raise UsageError(
                f"a film of {film.count} pictures",
                want=f"at most {MOST_PICTURES}",
                fix="Make it by the command: pseudolidar view PATH --export film.mp4",
            )
        done = 0

        def told() -> None:
            nonlocal done
            if self._ended.is_set():
                raise GivenUp
            done += 1
            if done % TOLD_EVERY == 0:
                self._tell(f"the film is {done / film.count:.0%} made ...")

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "film.mp4"
            write_film(film, path, told)
            return path.read_bytes()
