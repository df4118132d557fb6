"""Pairs of cameras as a source: whoever asks for the next frame gets the newest pair."""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Generic, Self, TypeVar

from pseudolidar.errors import CaptureEnded, PseudolidarError
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.sources.capture.cameras import Capture
from pseudolidar.sources.capture.eye_pairing import LARGEST_TOLERANCE_NS
from pseudolidar.sources.capture.shots import ShotPair
from pseudolidar.sources.source import SourceSummary
from pseudolidar.structures.camera import StereoRig

Made = TypeVar("Made", covariant=True)
# Whether a pair is wanted at all: by interval, by key, by what is to be seen in it.
Wanted = Callable[[ShotPair], bool]


class FrameNumbers(tuple[str, ...]):
    """Names `000000`, `000001`, ... of frames of which nobody knows how many there will be.

    As many as were taken so far are in it; the name of any other is known all the same.
    """

    taken: Callable[[], int]

    @classmethod
    def of(cls, taken: Callable[[], int]) -> FrameNumbers:
        """As many as `taken` says at the moment."""
        numbers = cls()
        numbers.taken = taken
        return numbers

    def __len__(self) -> int:
        return self.taken()

    def __iter__(self) -> Iterator[str]:
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: int) -> str:  # type: ignore[override]
        return f"{index:06d}"

    def __bool__(self) -> bool:
        return len(self) > 0


@dataclass(frozen=True, eq=False)
class Taken:
    """A pair that is to become a frame.

    Args:
        shots: its pictures.
        id: name of the frame.
        index: its number.
    """

    shots: ShotPair
    id: str
    index: int


class LivePairs(Generic[Made]):
    """An opened source whose frames are there once: each is loaded when its turn has come.

    Frames are numbered in the order in which they are taken, whichever worker asks first; when
    there are no more, `load` raises what ended it.

    Args:
        capture: the cameras.
        make: a pair to a frame; pure, called outside of any lock.
        yields: what it makes.
        summary: what the source is.
        rig: of the frames.
        most: frames to take; None for no limit.
        wanted: which pairs count; None for all.
    """

    timestamps_ns: tuple[int, ...] = ()  # nobody knows them before
    refused: tuple[tuple[str, PseudolidarError], ...] = ()

    def __init__(
        self,
        capture: Capture,
        make: Callable[[Taken], Made],
        *,
        yields: type[Made],
        summary: SourceSummary,
        rig: StereoRig | None,
        most: int | None = None,
        wanted: Wanted | None = None,
    ) -> None:
        self.summary, self.yields, self.rig = summary, yields, rig
        self.ids = FrameNumbers.of(lambda: self._next)
        self._capture, self._make, self._wanted, self._most = capture, make, wanted, most
        self._first = self._next = 0
        self._turn = threading.Condition()
        self._end: PseudolidarError | None = None
        # With a lock of its own: whose turn it is may wait for the cameras, what is done must not.
        self._taken_ns: dict[int, int] = {}
        self._noting = threading.Lock()

    def called(self, summary: SourceSummary, yields: type[Made], rig: StereoRig | None) -> Self:
        """The same under another name: what it makes is told in other words."""
        self.summary, self.yields, self.rig = summary, yields, rig
        return self

    def go_on_after(self, frames: int) -> None:
        """Number the frames after those that an earlier run has made."""
        self._first = self._next = frames

    @property
    def end(self) -> PseudolidarError | None:
        """What ended it, None while it goes on."""
        return self._end

    def taken_ns(self, index: int) -> int:
        """Monotonic time at which the cameras had taken frame `index`; to be asked once, in order.

        Raises:
            KeyError: it was not taken, or was asked for.
        """
        with self._noting:
            for old in [old for old in self._taken_ns if old < index]:
                del self._taken_ns[old]
            return self._taken_ns.pop(index)

    def specimen(self, *, within_s: float = 0.0) -> tuple[Made, bool]:
        """What a frame would be, and whether both eyes see one moment in it.

        It is made of the last picture of each camera, and where those are of different moments, of
        the newest pair, if there is one in time.

        Args:
            within_s: how long to wait for a pair.

        Raises:
            CaptureEnded, CameraFault: there is no picture.
        """
        shots = self._capture.seen()
        if shots.apart_ns > LARGEST_TOLERANCE_NS:
            shots = self._capture.pair_seen(within_s) or shots
        made = self._make(Taken(shots, self.ids[self._next], self._next))
        return made, shots.apart_ns <= LARGEST_TOLERANCE_NS

    def stop(self) -> None:
        """No further frame is wanted."""
        self._capture.stop()

    def load(self, index: int) -> Made:
        """The newest pair when the turn of `index` has come; waits for it.

        Raises:
            CaptureEnded: there are no more.
            CameraFault, EyesApart: as `Capture.take`.
        """
        with self._turn:
            while self._next != index and self._end is None:
                self._turn.wait()
            shots = self._shots(index)
            with self._noting:
                self._taken_ns[index] = shots.taken_ns
            self._next += 1
            self._turn.notify_all()
        return self._make(Taken(shots, self.ids[index], index))

    def _shots(self, index: int) -> ShotPair:
        try:
            if self._end is not None:
                raise copy.copy(self._end)
            if self._most is not None and index - self._first >= self._most:
                raise CaptureEnded(f"{self._most} frames are taken")
            shots = self._capture.take()
            while self._wanted is not None and not self._wanted(shots):
                shots = self._capture.take()
        except PseudolidarError as error:
            self._end = self._end or error
            self._turn.notify_all()
            raise
        return shots


class EveryInterval:
    """Wants a pair each time so much has passed since the last one that it wanted.

    Args:
        seconds: by the clock of the pairs.
    """

    def __init__(self, seconds: float) -> None:
        self._step_ns, self._due_ns = round(seconds * NS_PER_S), 0

    def __call__(self, shots: ShotPair) -> bool:
        """Whether it is time."""
        if shots.time_ns < self._due_ns:
            return False
        self._due_ns = shots.time_ns + self._step_ns
        return True


class OnRequest:
    """Wants the next pair after each request; a request from any thread."""

    def __init__(self) -> None:
        self._requests = 0
        self._lock = threading.Lock()

    def request(self) -> None:
        """Ask for one more pair."""
        with self._lock:
            self._requests += 1

    def __call__(self, shots: ShotPair) -> bool:  # noqa: ARG002 - any pair will do
        """Whether one was asked for."""
        with self._lock:
            asked = self._requests > 0
            self._requests -= asked
            return asked
