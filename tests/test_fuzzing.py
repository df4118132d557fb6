"""Readers of untrusted files answer any damage in words: a short sweep, and a long one."""

import pytest

from tests.fuzz_targets import READERS
from tests.fuzzing import TARGETS, fuzz, mutated

SHORT, LONG = 1_000, {"mcap": 3_000}
LONG_SWEEP, OTHERS = 20_000, 2_000


def checked(found, count):
    assert "died" not in found, found
    assert found["failures"] == []
    assert found["inputs"] == count
    # A mutator that breaks everything, or nothing, would prove nothing.
    assert 0 < found["refused"] < count
    assert found["slowest_s"] < 5


@pytest.mark.parametrize("name", ["pcd", "ply", "npz", "bin", "labels", "poses"])
def test_a_thousand_damaged_files(name):
    checked(fuzz(name, SHORT), SHORT)


# Texts and maps whose readers are quick; the others with the long sweep.
QUICK = ("npy", "oxts", "tum", "messages", "k-txt")


@pytest.mark.parametrize("name", QUICK)
def test_a_thousand_damaged_files_of_other_kinds(name):
    checked(fuzz(name, SHORT), SHORT)


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_thousands_of_damaged_files_of_other_kinds(name):
    checked(fuzz(name, OTHERS, first=SHORT), OTHERS)


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
def test_many_damaged_files(name):
    count = LONG.get(name, LONG_SWEEP)
    checked(fuzz(name, count, first=SHORT), count)


def test_inputs_come_back_by_their_number():
    corpus = TARGETS["ply"].corpus()
    inputs = [mutated(corpus, number) for number in range(300)]
    assert inputs == [mutated(corpus, number) for number in range(300)]
    assert len({*inputs}) > 280
    assert len({*inputs} & {*corpus}) < 10


def test_a_reader_that_fails_is_found():
    """Of one that raises, and of one that reads at address 0."""
    found = fuzz("broken", 200)
    assert found["failed"] > 0
    assert "ZeroDivisionError" in found["failures"][0]["trace"]
    assert fuzz("crashing", 50)["died"] < 0
