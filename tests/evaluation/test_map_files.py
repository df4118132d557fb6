import numpy as np
import pytest

from pseudolidar.errors import ImageFormat, ReferenceMissing, SourceEmpty
from pseudolidar.evaluation.map_files import is_maps, paired_maps, read_map
from pseudolidar.formats.pictures.disparity_png import write_disparity_png
from pseudolidar.formats.pictures.pfm import write_pfm
from pseudolidar.structures.disparity import DisparityMap

VALUES = np.array([[1.5, np.nan, 3.25], [40.0, 5.0, np.nan]], np.float32)


def test_the_same_map_from_every_format(tmp_path):
    write_disparity_png(tmp_path / "a.png", DisparityMap(VALUES))
    write_pfm(tmp_path / "a.pfm", DisparityMap(VALUES))
    np.save(tmp_path / "a.npy", np.nan_to_num(VALUES.astype(np.float64), nan=np.inf))
    for suffix in ("png", "pfm", "npy"):
        np.testing.assert_array_equal(read_map(tmp_path / f"a.{suffix}").values, VALUES)
    with pytest.raises(ImageFormat):
        read_map(tmp_path / "a.tif")


def test_maps_are_paired_by_name(tmp_path):
    mine, theirs = tmp_path / "mine", tmp_path / "theirs"
    for folder, names in ((mine, "ab"), (theirs, "abc")):
        folder.mkdir()
        for name in names:
            write_pfm(folder / f"{name}.pfm", DisparityMap(VALUES))
    (theirs / "notes.txt").write_text("not a map")
    pairs = paired_maps(mine, theirs)
    assert pairs == [(n, mine / f"{n}.pfm", theirs / f"{n}.pfm") for n in "ab"]
    assert paired_maps(mine / "a.pfm", theirs / "c.pfm") == [
        ("a", mine / "a.pfm", theirs / "c.pfm")
    ]
    assert paired_maps(mine / "b.pfm", theirs) == [("b", mine / "b.pfm", theirs / "b.pfm")]
    with pytest.raises(ReferenceMissing, match="'c'"):
        paired_maps(theirs, mine)
    with pytest.raises(SourceEmpty):
        paired_maps(tmp_path / "nothing", theirs)
    with pytest.raises(ReferenceMissing):
        paired_maps(mine, tmp_path / "nothing")
    assert is_maps(mine)
    assert not is_maps(tmp_path)
