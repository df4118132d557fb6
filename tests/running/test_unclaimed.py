"""What somebody else has put into an output folder is not written over."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pseudolidar.errors import UsageError
from pseudolidar.running.journal.journal_file import JOURNAL_NAME, first_line
from pseudolidar.running.unclaimed import check_unclaimed

NAMES = ("left", "right", "rig.json", "valid/left.png")


def journal(folder: Path, products: tuple[str, ...], *files: str) -> None:
    noted = [{"name": name, "size": 1, "crc32": 0} for name in files]
    record = {"id": "0", "index": 0, "files": noted, "figures": {}, "skipped": None}
    lines = (first_line({}, products), record)
    (folder / JOURNAL_NAME).write_text("".join(json.dumps(line) + "\n" for line in lines))


@pytest.mark.parametrize("name", ["left/0.png", "rig.json", "valid/mine.png"])
def test_files_that_no_run_wrote_are_in_the_way(tmp_path: Path, name: str) -> None:
    check_unclaimed(tmp_path / "absent", NAMES, overwrite=False)
    check_unclaimed(tmp_path, NAMES, overwrite=False)
    (tmp_path / "left").mkdir()
    (tmp_path / "other.txt").write_text("mine")
    check_unclaimed(tmp_path, NAMES, overwrite=False)  # empty folders, other names
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    for overwrite in (False, True):
        with pytest.raises(UsageError, match="no run has written it") as caught:
            check_unclaimed(tmp_path, NAMES, overwrite=overwrite)
        assert caught.value.got.startswith(name.split("/")[0])
    journal(tmp_path, ("report.csv",), "pcd/0.pcd")  # a run of another verb
    with pytest.raises(UsageError, match="no run has written it"):
        check_unclaimed(tmp_path, NAMES, overwrite=True)
    journal(tmp_path, ("rig.json", "valid/left.png"), "left/0.png")
    for overwrite in (False, True):
        check_unclaimed(tmp_path, NAMES, overwrite=overwrite)
