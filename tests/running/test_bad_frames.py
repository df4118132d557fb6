import pytest

from pseudolidar.errors import (
    CalibrationSizeMismatch,
    ImageMissing,
    ImageUnreadable,
    MissingDependency,
    StereoConfig,
    TooManyBadFrames,
)
from pseudolidar.running.bad_frames import good_frames
from pseudolidar.running.crew.attempt import Done, Skipped


def outcomes(pattern, error=ImageMissing):
    """One outcome a letter: g passed, b bad, u of another kind, r refused at opening."""
    for index, letter in enumerate(pattern):
        name = f"{index:03d}"
        match letter:
            case "g":
                yield Done(name, index, letter)
            case "r":
                yield Skipped(name, None, error("x"))
            case "u":
                yield Skipped(name, index, ImageUnreadable("x"))
            case _:
                yield Skipped(name, index, error("x"))


def sift(pattern, *, frames=None, on_error="skip", error=ImageMissing):
    skipped = []
    total = len(pattern.replace("r", "")) if frames is None else frames
    good = good_frames(
        outcomes(pattern, error), frames=total, on_error=on_error, skipped=skipped.append
    )
    return [frame.index for frame in good], [frame.id for frame in skipped]


def test_few_bad_frames_are_left_out():
    good, skipped = sift("ggbggbg")
    assert good == [0, 1, 3, 4, 6]
    assert skipped == ["002", "005"]


def test_more_than_5_percent_stop():
    assert len(sift("gb" * 5 + "g" * 90)[0]) == 95
    with pytest.raises(TooManyBadFrames, match="6 of 12 frames"):
        sift("gb" * 6 + "g" * 88)


def test_a_short_sequence_needs_five():
    assert sift("gbgbgbgb" + "g" * 4)[0]
    with pytest.raises(TooManyBadFrames):
        sift("gbgbgbgbgb" + "g" * 4)


def test_twenty_in_a_row_stop():
    assert sift("g" + "b" * 19 + "g", frames=10_000)[0] == [0, 20]
    with pytest.raises(TooManyBadFrames, match="20 of 21"):
        sift("g" + "b" * 20 + "g", frames=10_000)


def test_frames_refused_at_opening_stop_nothing():
    good, skipped = sift("r" * 30 + "g")
    assert good == [30]
    assert len(skipped) == 30


def test_a_source_that_refuses_all_of_its_frames_is_an_error():
    with pytest.raises(ImageMissing):
        sift("r" * 30)
    assert sift("") == ([], [])


def test_when_all_fail_alike_the_reason_is_the_error():
    with pytest.raises(CalibrationSizeMismatch):
        sift("bbb", error=CalibrationSizeMismatch)


def test_when_all_fail_differently_that_is_said():
    with pytest.raises(TooManyBadFrames, match="3 of 3"):
        sift("bub")


def test_stop_raises_the_first_error():
    with pytest.raises(ImageMissing):
        sift("gggbg", on_error="stop")


@pytest.mark.parametrize("error", [StereoConfig, MissingDependency])
def test_what_is_not_the_frames_fault_stops_at_once(error):
    with pytest.raises(error):
        sift("gbg", error=error)
