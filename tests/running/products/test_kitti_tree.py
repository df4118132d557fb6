"""Which pictures of a training tree validate: by blocks of time, the same for every seed."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import UsageError
from pseudolidar.running.products.kitti_tree import LEAK_S, KittiTree, numbers_of, split

NS = 1_000_000_000


def times(*drives, hz=10.0):
    """(N,) ns of drives of so many frames, a minute apart."""
    parts = [60 * i + np.arange(frames) / hz for i, frames in enumerate(drives)]
    return np.round(np.concatenate(parts) * NS).astype(np.int64)


@pytest.mark.parametrize("drives", [(1000,), (300, 300, 300), (40,), (2000, 50)])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_training_picture_is_a_neighbour_of_a_validation_picture(drives, seed):
    stamps = times(*drives)
    validation, kept = map(np.array, split(stamps, KittiTree(seed=seed), single=False))
    assert not (validation & kept).any()
    seconds = stamps / NS
    nearest = np.abs(seconds[kept][:, None] - seconds[validation][None]).min()
    span = seconds[-1] - seconds[0]
    assert nearest > min(LEAK_S, 0.2 * span / 5) * 0.9
    # A split is worth something: some of each, and most pictures in one of the two.
    assert 0.1 < validation.mean() < 0.5
    assert (validation | kept).mean() > 0.7


def test_the_seed_decides_and_nothing_else():
    stamps = times(1000)
    one, again = (split(stamps, KittiTree(seed=3), single=False) for _ in range(2))
    assert one == again
    others = [split(stamps, KittiTree(seed=seed), single=False)[0] for seed in range(8)]
    assert any(other != one[0] for other in others)


def test_single_pictures_are_split_one_by_one():
    validation, kept = split(times(100), KittiTree(val_share=0.3), single=True)
    assert sum(validation) == 30
    assert kept == [not chosen for chosen in validation]


def test_no_validation_and_nothing_to_split():
    validation, kept = split(times(50), KittiTree(val_share=0), single=False)
    assert not any(validation)
    assert all(kept)
    assert split(times(50)[:0], KittiTree(), single=False) == ([], [])
    with pytest.raises(UsageError, match="val_share"):
        KittiTree(val_share=1.0)


def test_six_digits_stay_and_other_names_are_counted():
    assert numbers_of(["000013", "000035"]) == {"000013": "000013", "000035": "000035"}
    assert numbers_of(["a", "000035"]) == {"a": "000000", "000035": "000001"}
