"""A file by a name of the user's: replaced when asked, when of its kind; tried before any work."""

from __future__ import annotations

from pathlib import Path

import pytest

from pseudolidar.errors import OutputError, UsageError
from pseudolidar.running.new_file import check_kind, check_new_file, is_text
from pseudolidar.running.rig_output import check_rig_place


def test_a_file_is_replaced_when_asked_and_of_its_kind(tmp_path: Path) -> None:
    path = tmp_path / "a.json"

    def check(*, overwrite: bool) -> None:
        check_new_file(path, overwrite=overwrite)
        check_kind(path, is_text, "text")

    check(overwrite=False)
    path.write_text("{}")
    check(overwrite=True)
    with pytest.raises(UsageError, match="pass --overwrite"):
        check(overwrite=False)
    for data in (b"\x89PNG\r\n\x1a\n\x00\x00", b"\xff\xd8\xff\xe0", b"%PDF-1.7"):
        path.write_bytes(data)
        with pytest.raises(UsageError, match="a file that is no text"):
            check(overwrite=True)
    path.unlink()
    path.mkdir()
    with pytest.raises(UsageError, match="a folder"):
        check(overwrite=True)


@pytest.mark.parametrize("place", ["/proc/rig.json", "file/rig.json"])
def test_a_place_that_cannot_be_written_is_refused_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_bytes(b"")
    with pytest.raises(OutputError):
        check_rig_place(Path(place), overwrite=False)
    with pytest.raises(OutputError):
        check_new_file(Path(place), overwrite=False)
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_a_rig_has_a_name_that_other_verbs_know(tmp_path: Path) -> None:
    check_rig_place(tmp_path / "rig.JSON", overwrite=False)
    with pytest.raises(UsageError, match=r"Pass --out .*mine\.json"):
        check_rig_place(tmp_path / "mine", overwrite=False)
