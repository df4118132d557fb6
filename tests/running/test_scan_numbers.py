import pytest

from pseudolidar.running.scan_numbers import ScanNumbers


@pytest.mark.parametrize(
    ("error_rel", "best"),
    [
        ({-1: 0.05, 0: 0.035, 1: 0.02, 2: 0.014, 3: 0.02}, 2),
        ({-1: 0.013, 0: 0.014, 1: 0.012}, 0),  # a car that stands: all alike
        ({0: 0.014}, 0),
        ({3: 0.014, 5: 0.03}, 3),  # no scan has its picture's number
        ({-2: 0.01, 0: 0.04, 2: 0.01}, -2),
    ],
)
def test_other_numbers_must_fit_clearly_better(error_rel, best):
    assert ScanNumbers(error_rel).best == best
