import numpy as np
import pytest

from pseudolidar.errors import ImageFormat, ImageMissing, ImageUnreadable, LimitError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.pictures.disparity_npy import read_disparity_npy

VALUES = np.array([[1.5, np.nan, 3.25], [40.0, 5.0, np.nan]], np.float32)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64, ">f4"])
def test_what_is_not_finite_and_positive_is_none(tmp_path, kind):
    given = np.array([[1.5, np.inf, 3.25], [40.0, 5.0, -1.0]], kind)
    for order in "CF":
        np.save(tmp_path / "a.npy", np.asarray(given, order=order))
        read = read_disparity_npy(tmp_path / "a.npy").values
        assert read.dtype == np.float32
        np.testing.assert_array_equal(read, VALUES)


def test_broken_numpy_files_are_refused(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, VALUES)
    whole = path.read_bytes()
    for length in (0, 5, 60, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(ImageUnreadable) as caught:
            read_disparity_npy(path)
        assert caught.value.path == str(path)
    # Brackets that do not close, and an archive of arrays under this name.
    for damaged in (whole.replace(b")", b"(", 1), b"PK\x03\x04" + whole):
        path.write_bytes(damaged)
        with pytest.raises(ImageUnreadable):
            read_disparity_npy(path)
    np.save(path, np.array([[object()]]), allow_pickle=True)
    with pytest.raises(ImageUnreadable):
        read_disparity_npy(path)
    np.save(path, VALUES[0])
    with pytest.raises(ImageFormat):
        read_disparity_npy(path)
    np.save(path, VALUES)
    with pytest.raises(LimitError):
        read_disparity_npy(path, limits=Limits(pixels=5))
    with pytest.raises(ImageMissing):
        read_disparity_npy(tmp_path / "b.npy")
