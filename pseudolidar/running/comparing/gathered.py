"""What has come of the frames of a comparison, whether it was kept in a folder or not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.errors import PseudolidarError, ReferenceMissing
from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.running.comparing.references import WORDS
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.products.compared_file import read_compared
from pseudolidar.running.products.product import Product
from pseudolidar.running.results import RunResult
from pseudolidar.sources.source import SourceSummary

# Name of the figure that says what a frame was compared with; None without a reference.
AGAINST = "against"


@dataclass(frozen=True, eq=False)
class Judged:
    """What a worker hands back of a frame.

    Args:
        against: what it was compared with: "scan" or "truth"; None without a reference.
        compared: its reference points; None without, and where they are in the product's files.
        product: what is written of it.
    """

    against: str | None
    compared: ComparedFrame | None
    product: Product


@dataclass(frozen=True, eq=False)
class Gathered:
    """All frames that are done with.

    Args:
        frames: those with a reference, in order.
        result: how the run ended; the figure `AGAINST` of a record says what its frame was compared
            with.
    """

    frames: tuple[ComparedFrame, ...]
    result: RunResult

    @classmethod
    def read(cls, folder: Path, result: RunResult) -> Gathered:
        """From the output folder of a run."""
        empty = bare(result.records)
        known = [record.id for record in result.committed if record.id not in empty]
        return cls(tuple(read_compared(folder, name) for name in known), result)

    @property
    def against(self) -> Counter[str]:
        """Frames by what they were compared with."""
        found = (record.figures[AGAINST] for record in self.result.committed)
        return Counter(kind for kind in found if kind is not None)

    @property
    def without(self) -> int:
        """Frames without a reference."""
        return len(bare(self.result.records))

    @property
    def words(self) -> str:
        """What the frames were compared with."""
        if len(self.against) == 1:
            return WORDS[next(iter(self.against))]
        return ", ".join(f"{WORDS[kind]} ({count} frames)" for kind, count in self.against.items())


def bare(records: Sequence[FrameRecord]) -> frozenset[str]:
    """Ids of frames that are done and have nothing to be compared with."""
    return frozenset(r.id for r in records if r.skipped is None and r.figures[AGAINST] is None)


def nothing_in_common(source: SourceSummary, got: str) -> PseudolidarError:
    """What to raise where there are references, and no point of them can be compared."""
    return ReferenceMissing(
        f"{source.line}: {got}",
        want="two sensors that look the same way",
        fix="Check the calibration between both, and the frame that the reference is in.",
        path=source.path,
    )


class Missing:
    """Watches for a source without any reference, so that not all of it is read in vain.

    Args:
        line: what the source is.
        path: where.
        tried: after so many frames without one it is given up.
        want: what it could have.
    """

    def __init__(
        self,
        line: str,
        path: str,
        *,
        tried: int,
        want: str = "LiDAR scans or ground-truth disparities",
    ) -> None:
        self._line, self._path, self._tried, self._want = line, path, tried, want
        self._without, self._found = 0, False

    def see(self, against: str | None) -> None:
        """One more frame.

        Raises:
            ReferenceMissing: none of the first frames has one.
        """
        self._found |= against is not None
        self._without += against is None
        if not self._found and self._without >= self._tried:
            raise self.error(f"none of its first {self._without} frames has a reference")

    def error(self, got: str = "no frame has a reference") -> PseudolidarError:
        """What to raise when there is none."""
        return ReferenceMissing(
            f"{self._line}: {got}",
            want=self._want,
            fix="Take another source, or compare with one: --reference B.",
            path=self._path,
        )
