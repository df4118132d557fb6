"""Small drives on the disk, and rendered frames that verbs share.

A drive is random texture, the right eye shifted by a known disparity.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar.sources.synthetic import SyntheticSource
from pseudolidar.structures.frame import StereoFrame

FRAMES = 14
WIDTH_PX, HEIGHT_PX = 128, 64
DISPARITY_PX = 9
RIG = {
    "schema": 1,
    "width_px": WIDTH_PX,
    "height_px": HEIGHT_PX,
    "baseline_m": 0.5,
    "left": {"fx": 100.0, "fy": 100.0, "cx": 63.5, "cy": 31.5},
    "right": {"fx": 100.0, "fy": 100.0, "cx": 63.5, "cy": 31.5},
}


def write_drive(folder: Path, frames: int = FRAMES) -> Path:
    rng = np.random.default_rng(7)
    for eye in ("left", "right"):
        (folder / eye).mkdir(parents=True)
    for index in range(frames):
        wide = rng.integers(0, 256, (HEIGHT_PX, WIDTH_PX + DISPARITY_PX, 3), np.uint8)
        pair = {"left": wide[:, :-DISPARITY_PX], "right": wide[:, DISPARITY_PX:]}
        for eye, image in pair.items():
            cv2.imwrite(str(folder / eye / f"{index:06d}.png"), image)
    (folder / "rig.json").write_text(json.dumps(RIG))
    return folder


_render = SyntheticSource.load
# Frames of rendered worlds that are kept, of 1 to 4 MB each.
KEPT_FRAMES = 40


@functools.lru_cache(maxsize=KEPT_FRAMES)
def _rendered(alone: SyntheticSource, index: int) -> StereoFrame:
    return _render(alone, index)


def _load_once(source: SyntheticSource, index: int) -> StereoFrame:
    settings = replace(source.settings, path=source.name, frames=index + 1)
    return _rendered(replace(source, settings=settings), index)


@pytest.fixture(scope="module", autouse=True)
def rendered_once() -> Iterator[None]:
    """Each frame of a rendered world is rendered once for all verbs, of which it is no part.

    A sixth of the processor time of all tests went into the same frames again. A verb that changes
    a frame that it was given changes what the next one is given, and is seen by that.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SyntheticSource, "load", _load_once)
        yield


@pytest.fixture(scope="session")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders left and right with 14 pairs and a rig file; not to be changed."""
    return write_drive(tmp_path_factory.mktemp("drive") / "tiny")


@pytest.fixture(scope="session")
def long_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with 60 pairs: long enough to be stopped on the way."""
    return write_drive(tmp_path_factory.mktemp("drive") / "long", frames=60)


@pytest.fixture
def own_drive(tmp_path: Path) -> Path:
    """The same, for a test that damages it."""
    return write_drive(tmp_path / "tiny", frames=6)
