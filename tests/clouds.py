"""Fixtures: clouds with everything that a careless reader or writer loses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.structures.cloud import PointCloud

# Values that a careless writer loses: the extremes of each dtype.
EXTRA_DTYPES = (
    "bool", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
    "float16", "float32", "float64",
)  # fmt: skip


OWN_COLUMNS = ("xyz", "rgb", "intensity", "sigma_m", "uv")


def _extra(dtype: str, n: int, rng: np.random.Generator) -> np.ndarray:
    if dtype == "bool":
        return rng.random(n) > 0.5
    if dtype.startswith("float"):
        values = rng.normal(size=n) * 10.0 ** rng.integers(-3, 4, n)
        return values.astype(dtype)
    limits = np.iinfo(dtype)
    column = rng.integers(limits.min, limits.max, n, dtype=dtype, endpoint=True)
    column[:2] = (limits.min, limits.max)[: min(n, 2)]
    return column


@pytest.fixture(scope="session")
def make_cloud() -> Callable[..., PointCloud]:
    """A cloud of `n` points with every column and an extra one of every dtype."""

    def make(n: int = 60, *, shape: tuple[int, int] | None = None, wide: bool = False):
        rng = np.random.default_rng(7)
        kind = np.float64 if wide else np.float32
        xyz = rng.normal(size=(n, 3)).astype(kind) * 30
        sigma_m = rng.random(n, np.float32)
        if shape is not None:
            holes = rng.random(n) < 0.3
            xyz[holes], sigma_m[holes] = np.nan, np.nan
        return PointCloud(
            xyz,
            "camera_left",
            1_317_384_506_123_456_789,
            rgb=rng.integers(0, 256, (n, 3), dtype=np.uint8),
            intensity=rng.random(n, np.float32),
            sigma_m=sigma_m,
            uv=rng.random((n, 2), np.float32) * 1242,
            extra={f"of_{dtype}": _extra(dtype, n, rng) for dtype in EXTRA_DTYPES},
            shape=shape,
        )

    return make


@pytest.fixture(scope="session")
def assert_same_cloud() -> Callable[[PointCloud, PointCloud], None]:
    """Every column bit for bit, with dtype; frame, time and shape."""

    def check(got: PointCloud, want: PointCloud) -> None:
        assert (got.frame, got.timestamp_ns, got.shape) == (
            want.frame,
            want.timestamp_ns,
            want.shape,
        )
        assert list(got.extra) == list(want.extra)
        columns = {name: getattr(want, name) for name in OWN_COLUMNS}
        for name, column in {**columns, **want.extra}.items():
            read = got.extra[name] if name in want.extra else getattr(got, name)
            if column is None:
                assert read is None, name
                continue
            assert read.dtype == column.dtype, name
            assert read.flags.writeable, name
            np.testing.assert_array_equal(read, column, err_msg=name)

    return check


@pytest.fixture(scope="session")
def without_columns() -> Callable[[PointCloud], PointCloud]:
    """The cloud with its points alone."""

    def strip(cloud: PointCloud) -> PointCloud:
        return replace(cloud, rgb=None, intensity=None, sigma_m=None, uv=None, extra={})

    return strip
