"""The journal of a search: what was judged is never judged again, in this run or the next."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pseudolidar.errors import OutputSettings
from pseudolidar.evaluation.matching_loss import Judgement
from pseudolidar.formats.atomic import output_error, write_atomic
from pseudolidar.running.journal.journal_file import check_same
from pseudolidar.running.settings_json import to_json
from pseudolidar.running.tuning.space import Candidate

SCHEMA = 1
# Of settings that cannot be matched with.
FAILED = Judgement(math.inf, 0.0)


def key_of(candidate: Candidate) -> str:
    """The same for the same settings."""
    text = json.dumps(to_json(candidate), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Trial:
    """One candidate on one frame.

    Args:
        key: of the candidate.
        frame: id of the judged frame.
        judgement: how good it is.
        seconds: that a map of it took.
    """

    key: str
    frame: str
    judgement: Judgement
    seconds: float


@dataclass
class Trials:
    """All that was judged, in a file that survives the run.

    Args:
        path: the file, JSON lines.
        known: what was judged, by candidate and frame.
        restored: how many of them an earlier run did.
    """

    path: Path
    known: dict[tuple[str, str], Trial] = field(default_factory=dict)
    restored: int = 0

    @classmethod
    def opened(cls, path: Path, identity: Mapping[str, Any], *, anew: bool) -> Trials:
        """Go on with the file where it belongs to this search; else begin it.

        Args:
            path: the file.
            identity: of the search, plain JSON values.
            anew: begin it in any case.

        Raises:
            OutputSettings: it belongs to another search.
            OutputError: it cannot be written.
        """
        first = {"schema": SCHEMA, "search": dict(identity)}
        lines = [] if anew or not path.exists() else path.read_bytes().splitlines(keepends=True)
        if not lines or not lines[0].endswith(b"\n"):
            write_atomic(path, (json.dumps(first) + "\n").encode())
            return cls(path)
        _check_same(path, lines[0], first)
        trials = cls(path)
        for line in lines[1:]:
            with contextlib.suppress(ValueError, KeyError, TypeError):  # cut off by a kill
                trials._keep(_trial(json.loads(line)))
        trials.restored = len(trials.known)
        if not lines[-1].endswith(b"\n"):
            trials._append(b"\n")
        return trials

    def add(self, candidate: Candidate, trial: Trial) -> None:
        """Keep a trial, and write it down."""
        self._keep(trial)
        judged = asdict(trial.judgement)
        judged["loss"] = judged["loss"] if math.isfinite(judged["loss"]) else None
        seconds = trial.seconds if math.isfinite(trial.seconds) else None
        record = {"key": trial.key, "frame": trial.frame, **judged, "seconds": seconds}
        self._append((json.dumps({**record, "settings": to_json(candidate)}) + "\n").encode())

    def _keep(self, trial: Trial) -> None:
        self.known[trial.key, trial.frame] = trial

    def _append(self, data: bytes) -> None:
        try:
            with self.path.open("ab") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise output_error(self.path, error) from error


def _trial(record: dict[str, Any]) -> Trial:
    shares = (record[name] for name in ("d1_est", "d1_filled"))
    d1_est, d1_filled = (None if share is None else float(share) for share in shares)
    loss = _or_infinite(record["loss"])
    judgement = Judgement(loss, float(record["density"]), d1_est=d1_est, d1_filled=d1_filled)
    key, frame = str(record["key"]), str(record["frame"])
    return Trial(key, frame, judgement, _or_infinite(record["seconds"]))


def _or_infinite(value: Any) -> float:
    """The number, or infinity where it was not finite, which JSON cannot say."""
    return math.inf if value is None else float(value)


def _check_same(path: Path, line: bytes, first: dict[str, Any]) -> None:
    fix = "Choose another --out, or pass --overwrite to start anew."
    try:
        found = json.loads(line)
        before, schema = dict(found["search"]), found["schema"]
    except (ValueError, KeyError, TypeError) as error:
        raise OutputSettings(
            "no journal of trials", want="one of this version", fix=fix, path=path
        ) from error
    now = {"schema": SCHEMA, **first["search"]}
    check_same({"schema": schema, **before}, now, path, holds="the file holds a search", fix=fix)
