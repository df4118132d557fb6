"""A row correction in a rig file: applied once, by whatever opens a source."""

import pickle

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.rigs.rig_json import read_rig, write_rig
from pseudolidar.geometry.rows import rows_aligned
from pseudolidar.running.journal.identity import calibration_text
from pseudolidar.sources.changed import ChangedSource
from pseudolidar.sources.other_rig import opened_as_taken, opened_with_rig
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import pairs_of
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.correction import RowCorrection

ROWS = RowCorrection(np.array([0.5, 0.2, 0, 0, 1.0, 0, 0, 0, 0]), 0.1, "matches of 3 frames")
WORLD = Synthetic("street", frames=2, width_px=160)


@pytest.fixture
def given(tmp_path):
    """The rig of the world, with a row correction."""
    write_rig(tmp_path / "given.json", WORLD.open().rig.with_rows(ROWS))
    return tmp_path / "given.json"


def folder_of_pairs(folder, rig):
    source = WORLD.open()
    for eye in ("left", "right"):
        (folder / eye).mkdir(parents=True)
        for index, name in enumerate(source.ids):
            picture = encode_png(getattr(source.load(index), eye))
            (folder / eye / f"{name}.png").write_bytes(picture)
    write_rig(folder / "rig.json", rig)
    return folder


def test_a_given_rig_puts_rows_right_and_says_so(given):
    plain, source = WORLD.open(), pairs_of(opened_with_rig(WORLD, given))
    frame = source.load(1)
    assert np.array_equal(frame.right, rows_aligned(plain.load(1).right, ROWS))
    assert np.array_equal(frame.left, plain.load(1).left)
    assert "rows of right pictures put right: matches of 3 frames" in source.summary.notes
    assert np.array_equal(pickle.loads(pickle.dumps(source)).load(1).right, frame.right)


def test_frames_are_not_corrected_twice(given):
    source = pairs_of(opened_with_rig(WORLD, given))
    assert source.rig.rows is not None  # it belongs to the cameras, and to what runs are told by
    assert source.load(0).rig.rows is None
    assert calibration_text(source) != calibration_text(WORLD.open())


@pytest.mark.parametrize("own", [True, False])
def test_folders_too_with_their_own_rig_or_another(tmp_path, given, own):
    rig = WORLD.open().rig
    folder = folder_of_pairs(tmp_path / "pairs", rig.with_rows(ROWS) if own else rig)
    source = pairs_of(opened_with_rig(recognise(str(folder)), None if own else given))
    assert isinstance(source, ChangedSource)
    assert np.array_equal(source.load(0).right, rows_aligned(WORLD.open().load(0).right, ROWS))


def test_pictures_as_they_were_taken(given):
    source = pairs_of(opened_as_taken(WORLD, given))
    frame = source.load(0)
    assert np.array_equal(frame.right, WORLD.open().load(0).right)
    assert frame.rig.rows is not None


def test_a_rig_without_rows_changes_no_picture(tmp_path):
    write_rig(tmp_path / "rig.json", WORLD.open().rig)
    source = pairs_of(opened_with_rig(WORLD, tmp_path / "rig.json"))
    assert np.array_equal(source.load(0).right, WORLD.open().load(0).right)
    assert source.ids == WORLD.open().ids


def test_rows_scale_with_the_pictures(tmp_path, given):
    half = read_rig(given).scaled_to(80, 24)
    whole = read_rig(given)
    ratio = 24 / whole.left.height_px
    assert np.allclose(half.rows.coefficients, ROWS.coefficients * ratio)


def test_info_tells_of_it(tmp_path, capsys):
    folder = folder_of_pairs(tmp_path / "pairs", WORLD.open().rig.with_rows(ROWS))
    assert main(["info", str(folder)]) == 0
    text = capsys.readouterr().out
    assert "with a row correction" in text
    assert "put right: matches of 3 frames" in " ".join(text.split())
