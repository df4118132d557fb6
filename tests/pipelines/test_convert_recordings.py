"""Recordings of a conversion: profiles, two files, and clouds that go in and come out again."""

from __future__ import annotations

import json
import random
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from pseudolidar.pipelines.convert import Convert, run
from rosbags.highlevel import AnyReader

from pseudolidar.cli import main
from pseudolidar.formats.mcap.check import check_mcap
from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.points.pcd import read_pcd, write_pcd
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.synthetic import Synthetic
from tests.formats.mcap.test_messages import full_cloud
from tests.pipelines.test_convert_interrupted import killed_on_the_way, tree
from tests.sources.test_tum_depth import tum


def job(source, out, content, *, to="mcap", **options):
    outputs = Outputs.parse(to)
    return Convert(recognise(str(source)), out, to=outputs, mcap=content, workers=2, **options)


@pytest.mark.parametrize("flags", [["--mcap-profile", "ros2"], ["--mcap.profile=ros2"]])
def test_the_flag_makes_a_bag(drive, tmp_path, flags):
    points = ["--mcap-max-points", "100"]
    arguments = ["convert", str(drive), str(tmp_path), "--to", "mcap", "--frames", "0:3"]
    assert main([*arguments, *flags, *points]) == 0
    with (tmp_path / "tiny.mcap").open("rb") as file:
        assert make_reader(file).get_header().profile == "ros2"
    with AnyReader([tmp_path]) as bag:
        clouds = [c for c in bag.connections if c.topic == "/stereo/points"]
        messages = [bag.deserialize(raw, c.msgtype) for c, _, raw in bag.messages(clouds)]
    assert [message.width for message in messages] == [100, 100, 100]


def test_two_files_killed_and_continued_are_the_same(long_drive, tmp_path):
    content = McapContent(profile="ros2", split="images,clouds")
    whole, out = tmp_path / "whole", tmp_path / "out"
    run(job(long_drive, whole, content))
    names = {"long_images.mcap", "long_clouds.mcap", "metadata.yaml"}
    assert names < set(tree(whole))
    chance = random.Random(5)
    for _ in range(2):
        killed_on_the_way(job(long_drive, out, content), chance)
    report = run(job(long_drive, out, content))
    assert report.result.passed_now < 60
    assert tree(out) == tree(whole)
    for name in ("long_images.mcap", "long_clouds.mcap"):
        assert check_mcap(out / name).frames == 60
    with AnyReader([out]) as bag:
        assert {"/stereo/points", "/camera/left/camera_info"} < set(bag.topics)
        assert bag.topics["/tf"].msgcount == 120


def test_a_bag_of_somebody_else_is_left_alone(drive, tmp_path, capsys):
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    arguments = ["convert", str(drive), str(tmp_path), "--to", "mcap", "--mcap-profile", "ros2"]
    assert main(arguments) == 5
    assert "a ROS 2 bag of other recordings" in capsys.readouterr().err
    assert (tmp_path / "metadata.yaml").read_text() == "rosbag2_bagfile_information: {}\n"


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
def test_clouds_go_into_a_recording_and_come_out_with_all_columns(tmp_path, profile):
    cloud = full_cloud(700)
    kept = {name: cloud.extra[name] for name in ("ring", "height_m")}
    cloud = replace(cloud, extra=kept)
    later = replace(cloud, timestamp_ns=cloud.timestamp_ns + 1)
    write_pcd(tmp_path / "pcd" / "a.pcd", cloud)
    write_pcd(tmp_path / "pcd" / "b.pcd", later)
    content = McapContent(profile=profile, pixels=True)
    run(job(tmp_path / "pcd", tmp_path / "there", content))
    (recording,) = (tmp_path / "there").glob("*.mcap")
    run(job(recording, tmp_path / "back", content, to="pcd"))
    files = sorted((tmp_path / "back" / "pcd").iterdir())
    assert len(files) == 2
    found = read_pcd(files[0])
    np.testing.assert_array_equal(found.xyz, cloud.xyz)
    for column in ("rgb", "intensity", "sigma_m", "uv"):
        np.testing.assert_array_equal(getattr(found, column), getattr(cloud, column))
    assert found.extra.keys() == cloud.extra.keys()
    for name, values in cloud.extra.items():
        np.testing.assert_array_equal(found.extra[name], values)


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
def test_pictures_with_depth_become_recordings(tmp_path, profile):
    source = Synthetic("room", frames=2, width_px=160).open()
    folder = tum(tmp_path / "tum", [source.load(index) for index in range(2)])
    run(job(folder, tmp_path / "out", McapContent(profile=profile)))
    (recording,) = (tmp_path / "out").glob("*.mcap")
    summary = check_mcap(recording)
    assert summary.frames >= 1
    wanted = {"/camera/depth", "/points", "/tf", "/frame"}
    assert {topic for topic in wanted if summary.messages[topic] == summary.frames} == wanted


def test_a_recording_that_lost_frames_is_not_all_done(drive, tmp_path, capsys):
    """What is left is converted; what the cut took is told, and by the exit code too."""
    assert main(["convert", str(drive), str(tmp_path / "whole"), "--to", "mcap"]) == 0
    whole = next((tmp_path / "whole").glob("*.mcap")).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: round(0.7 * len(whole))])
    (tmp_path / "unfinished.mcap").write_bytes(whole[:-30])
    capsys.readouterr()
    for _ in range(2):  # the second time nothing is left to be done, and as much is lost
        args = ["convert", str(tmp_path / "cut.mcap"), str(tmp_path / "out"), "--json"]
        assert main(args) == 4
        report = json.loads(capsys.readouterr().out)
        assert 0 < report["committed"] < len(recognise(str(drive)).open().ids)
        assert report["skipped"] == 0
    (lost,) = report["lost"]
    assert lost.startswith("lost: the last ")
    assert json.loads((tmp_path / "out" / "report.json").read_text())["lost"] == [lost]
    assert main([*args[:-1]]) == 4
    assert lost in capsys.readouterr().out
    # only the index was lost, and no message
    assert main(["convert", str(tmp_path / "unfinished.mcap"), str(tmp_path / "all")]) == 0
