"""compare on KITTI: the stock rig's bias by range, as measured before the verb existed."""

from __future__ import annotations

import json

import pytest

from pseudolidar.cli import main

# Median relative error by range that a first trial had, stock rig, every disparity kept.
TRIAL = (0.0086, 0.0148, 0.0373, 0.0728, 0.1138)


def compared(capsys, *args: object) -> dict:
    capsys.readouterr()
    assert main(["compare", *map(str, args), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.real
def test_the_stock_rig_is_as_wrong_as_it_is_known_to_be(real_data, capsys):
    told = compared(capsys, real_data / "kitti_stereo2015", "--clean", "none")
    assert (told["frames"], told["reference"]) == (22, "LiDAR scans")
    for each, trial in zip(told["bins"], TRIAL, strict=True):
        assert 0.7 * trial < each["median_rel"] < 1.05 * trial
        low, high = each["intervals"]["median_rel"]
        assert low < each["median_rel"] < high
        assert each["density"] > 0.9
    # too far from 20 m on, by more the farther; near it is right
    biases = [each["bias_rel"] for each in told["bins"]]
    assert abs(biases[0]) < 0.005
    assert biases[1] < biases[2] < biases[3] < biases[4]
    assert 0.08 < biases[4] < 0.11
    # half a pixel of it: disparities too small where they are small
    bands = {band["from_px"]: band["median_px"] for band in told["by_disparity"]}
    assert -0.7 < bands[6] < -0.3
    assert told["diagnosis"]["systematic_px"] > 0.25


@pytest.mark.real
def test_cleaning_takes_errors_away_and_density_with_them(real_data, capsys):
    kept, cleaned = (
        compared(capsys, real_data / "kitti_stereo2015", "--frames", "0::8", "--clean", clean)
        for clean in ("none", "clean")
    )
    assert cleaned["rmse_m"] < 0.6 * kept["rmse_m"]
    assert cleaned["density"] < kept["density"]


@pytest.mark.real
def test_frames_without_a_scan_are_counted(real_data, capsys):
    told = compared(capsys, real_data / "kitti_object")
    assert (told["frames"], told["without_reference"], told["skipped"]) == (1, 10, [])


@pytest.mark.real
def test_a_drive(real_data, capsys):
    told = compared(capsys, real_data / "kitti_raw", "--frames", "0::3")
    assert told["frames"] == 4
    assert told["density"] > 0.9
    assert told["bins"][1]["median_rel"] < 0.015
    assert told["time_offset"]["late_s"] is None  # at one speed
    assert "speeds" in told["time_offset"]["reason"]
