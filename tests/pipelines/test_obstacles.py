"""obstacles and evaluate obstacles: from the command line to tables, resumed, and refused."""

from __future__ import annotations

import csv
import json
import shutil

import av
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from pseudolidar.cli import main
from pseudolidar.errors import LabelError, PseudolidarError
from pseudolidar.formats.labels import read_labels, read_tracking_labels
from pseudolidar.formats.obstacle_json import obstacle_fields, obstacle_of
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.formats.rigs.kitti_calibration import FRAME_CAM0
from pseudolidar.running.reports.obstacles_page import pictures_for
from pseudolidar.structures.pose import Pose

FRAMES = ("000000", "000001")


@pytest.fixture(scope="module")
def street(tmp_path_factory) -> str:
    """Two small frames of the street as KITTI data, rendered once."""
    folder = tmp_path_factory.mktemp("street")
    assert (
        main(["synth", str(folder), "--layout", "object", "--frames", "2", "--width-px", "800"])
        == 0
    )
    return str(folder)


@pytest.fixture(scope="module")
def found(tmp_path_factory, street):
    out = tmp_path_factory.mktemp("obstacles")
    assert main(["obstacles", street, str(out), "--detector", "labels"]) == 0
    return out


def lines(out):
    return [json.loads(line) for line in (out / "obstacles.jsonl").read_text().splitlines()]


def test_every_obstacle_has_a_line_in_both_tables(found) -> None:
    obstacles = lines(found)
    frames = {one["frame"] for one in obstacles}
    assert len(frames) == 2
    for frame in frames:
        mine = [one for one in obstacles if one["frame"] == frame]
        distances = [one["distance_m"] for one in mine]
        assert distances == sorted(distances)
        assert [one["number"] for one in mine] == list(range(1, len(mine) + 1))
    with (found / "obstacles.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(obstacles)
    for row, one in zip(rows, obstacles, strict=True):
        assert row["class"] == one["class"]
        assert float(row["distance_m"]) == pytest.approx(one["distance_m"], rel=1e-8)
        assert float(row["width_m"]) == pytest.approx(one["size_m"][1], rel=1e-8)
    report = json.loads((found / "report.json").read_text())
    assert report["figures"]["obstacles"]["mean"] == len(obstacles) / 2


def test_each_labelled_object_is_told_beside_its_label(street, found, tmp_path, capsys) -> None:
    """In --json and on the page, as `evaluate` has them; on the terminal where they are few."""
    page = (found / "report.html").read_text()
    assert page.count("data:image/jpeg") == pictures_for(len(FRAMES)) == 1
    job = ("obstacles", street, str(found), "--detector", "labels")
    labelled = told(capsys, *job)["labelled"]
    judged = told(capsys, "evaluate", "obstacles", street)
    assert labelled["objects"] == judged["objects"]
    assert labelled["bands"] == judged["bands"]
    one = labelled["objects"][0]
    assert f"{one['label_m']:.2f}" in page
    capsys.readouterr()
    assert main([*job]) == 0
    few = capsys.readouterr().out
    assert main([*job, "--objects"]) == 0
    every = capsys.readouterr().out
    assert len(labelled["objects"]) > 20
    assert "--objects prints each" in few
    assert "usual script" not in few
    assert f"{one['usual_m']:.2f}" in every


def test_an_obstacle_comes_back_from_its_line(found) -> None:
    for one in lines(found):
        obstacle = obstacle_of(one, where="here")
        again = obstacle_fields(
            obstacle, frame=one["frame"], time_s=one["time_s"], number=one["number"]
        )
        assert again | {"points": one["points"]} == one
    with pytest.raises(LabelError, match="here"):
        obstacle_of({"class": "Car"}, where="here")
    broken = lines(found)[0] | {"rotation": [[1, 0, 0], [0, 2, 0], [0, 0, 1]]}
    with pytest.raises(PseudolidarError, match="rotation"):
        obstacle_of(broken, where="here")


def test_the_same_bytes_after_a_part_of_the_run(street, found, tmp_path) -> None:
    job = ["obstacles", street, str(tmp_path), "--detector", "labels"]
    assert main([*job, "--frames", "0:1"]) == 0
    assert main(job) == 2  # another selection is another run
    assert main([*job, "--overwrite", "--workers", "1"]) == 0
    for name in ("obstacles.jsonl", "obstacles.csv"):
        assert (tmp_path / name).read_bytes() == (found / name).read_bytes()
    (tmp_path / "obstacles.csv").unlink()
    assert main(job) == 0  # nothing is left to do but the tables
    assert (tmp_path / "obstacles.csv").read_bytes() == (found / "obstacles.csv").read_bytes()


def test_obstacles_are_followed_where_that_is_asked_for(street, tmp_path) -> None:
    job = ["obstacles", street, str(tmp_path), "--detector", "labels"]
    assert main([*job, "--track", "tracker"]) == 0
    obstacles = lines(tmp_path)
    first, second = (
        {one["track"]: one for one in obstacles if one["frame"] == name} for name in FRAMES
    )
    assert len(first) + len(second) == len(obstacles)  # each is one track, once in a frame
    near = {track for track, one in first.items() if one["distance_m"] < 50}
    same = near & set(second)
    assert len(same) > 0.7 * len(near) > 3
    for track in same:
        assert first[track]["class"] == second[track]["class"]
        assert abs(first[track]["distance_m"] - second[track]["distance_m"]) < 10
    assert main(job) == 2  # without tracks it is another run


def test_followed_obstacles_go_to_clouds_label_files_and_a_film(street, tmp_path) -> None:
    job = ["obstacles", street, str(tmp_path), "--detector", "labels", "--track", "tracker"]
    job += ["--to", "pcd,mcap,kitti", "--video"]
    assert main([*job, "--workers", "1"]) == 0
    obstacles = lines(tmp_path)
    identity = Pose.identity("camera_left", FRAME_CAM0)
    tracked = read_tracking_labels(tmp_path / "tracking.txt", T_left_cam0=identity)
    for number, name in enumerate(FRAMES):
        mine = [one for one in obstacles if one["frame"] == name]
        assert [one.track_id for one in tracked[number]] == [one["track"] for one in mine]
        labels = read_labels(tmp_path / "label_2" / f"{name}.txt", T_left_cam0=identity)
        assert [one.detection.name for one in labels] == [one["class"] for one in mine]
        cloud = read_pcd(tmp_path / "pcd" / f"{name}.pcd")
        counts = np.bincount(cloud.extra["object"].astype(int), minlength=len(mine) + 1)
        assert counts[1:].tolist() == [one["points"] for one in mine]
    with av.open(str(tmp_path / "obstacles.mp4")) as film:
        assert film.streams.video[0].codec_context.name == "h264"
        assert sum(1 for _ in film.decode(video=0)) >= 2
    check_recording(next(tmp_path.glob("*.mcap")), obstacles)
    names = ("obstacles.jsonl", "obstacles.mp4")
    first = [(tmp_path / name).read_bytes() for name in names]
    assert main(job) == 0  # nothing is left to do
    assert [(tmp_path / name).read_bytes() for name in names] == first


def check_recording(path, obstacles) -> None:
    """As the official reader sees it: the obstacles of the table, and all else of the frames."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        messages = [(c.topic, m.sequence, d) for _, c, m, d in reader.iter_decoded_messages()]
    scenes = [d for topic, _, d in messages if topic == "/obstacles"]
    edges = [d for topic, _, d in messages if topic == "/obstacles/edges"]
    for number, (name, scene, points) in enumerate(zip(FRAMES, scenes, edges, strict=True)):
        mine = [one for one in obstacles if one["frame"] == name]
        assert [e.id for e in scene.entities] == [f"track/{one['track']}" for one in mine]
        told = [{p.key: p.value for p in e.metadata} for e in scene.entities]
        assert [p["distance_m"] for p in told] == [f"{one['distance_m']:.3f}" for one in mine]
        assert {e.frame_id for e in scene.entities} == {points.frame_id} == {"camera_left"}
        assert len(points.data) == len(mine) * 12 * 25 * points.point_stride
        topics = {topic for topic, sequence, _ in messages if sequence == number}
        assert {"/frame", "/stereo/points", "/stereo/disparity", "/stereo/depth", "/tf"} < topics
        assert {"/camera/left/image", "/camera/right/image", "/camera/left/annotations"} < topics


def test_a_box_on_the_command_line_measures_what_is_in_it(street, found, tmp_path) -> None:
    one = next(one for one in lines(found) if one["distance_m"] < 30 and not one["truncated"])
    box = ",".join(f"{value:g}" for value in one["box_px"])
    frames = f"--frames={int(one['frame'])}"
    assert main(["obstacles", street, str(tmp_path), frames, "--detector", f"regions:{box}"]) == 0
    (mine,) = lines(tmp_path)
    assert mine["distance_m"] == pytest.approx(one["distance_m"], abs=1.0)
    assert mine["class"] == "region"


def test_a_second_detector_adds_what_the_first_does_not_know(street, found, tmp_path) -> None:
    first = [one for one in lines(found) if one["frame"] == lines(found)[0]["frame"]]
    frames = f"--frames={int(first[0]['frame'])}"
    both = ["--detector", "labels", "--also", "cloud", "--also.farthest", "30"]
    assert main(["obstacles", street, str(tmp_path), frames, *both]) == 0
    mine = lines(tmp_path)
    boxes = [one["box_px"] for one in mine if one["class"] != "thing"]
    assert sorted(boxes) == sorted(one["box_px"] for one in first)
    things = [one for one in mine if one["class"] == "thing"]
    assert len(things) >= 3
    assert max(one["distance_m"] for one in things) < 31


def told(capsys, *args: str, code: int = 0) -> dict:
    capsys.readouterr()
    assert main([*args, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_labels_judge_distances_by_band(street, capsys) -> None:
    found = told(capsys, "evaluate", "obstacles", street, "--detector", "labels")
    bands = found["bands"]
    assert [(b["from_m"], b["to_m"]) for b in bands] == [(0, 15), (15, 30), (30, 50), (50, 90)]
    assert sum(band["missed"] for band in bands) == 0
    assert bands[1]["n"] >= 5
    assert bands[1]["median_abs_m"] < 0.5
    assert bands[1]["median_abs_m"] < found["usual_script"][1]["median_abs_m"]
    assert found["within_1_sigma"] > 0.6
    assert found["cars"]["width_median_abs_m"] < 0.2
    assert len(found["objects"]) >= sum(band["n"] for band in bands)


def test_two_detectors_are_judged_as_one(street, capsys) -> None:
    """What labels leave out, points alone find; recall says nothing where labels take part."""
    job = ("evaluate", "obstacles", street, "--frames", "0:1")
    car = told(capsys, *job, "--detector", "labels", "--detector.classes", "pedestrian")
    both = (*("--detector", "labels", "--detector.classes", "pedestrian"), "--also", "cloud")
    more = told(capsys, *job, *both)
    assert sum(one["measured_m"] is not None for one in car["objects"]) < sum(
        one["measured_m"] is not None for one in more["objects"]
    )
    assert more["recall_2d"] is None
    assert more["subject"].startswith("labels and cloud measured by")


def test_what_has_no_labels_is_refused(drive, capsys, tmp_path) -> None:
    error = told(capsys, "evaluate", "obstacles", str(drive), "--no-check", code=3)["error"]
    assert "no frame has labels" in error["got"]
    job = ("obstacles", str(drive), str(tmp_path), "--no-check", "--on-error", "stop")
    error = told(capsys, *job, code=3)["error"]
    assert "has no labels" in error["got"]
    assert "--detector" in error["fix"]


def test_frames_without_labels_are_named(street, tmp_path, capsys) -> None:
    half = tmp_path / "half"
    shutil.copytree(street, half)
    (half / "training" / "label_2" / "000001.txt").unlink()
    judged = told(capsys, "evaluate", "obstacles", str(half), "--matcher", "bm", code=4)
    assert judged["unlabelled"] == ["000001"]
    assert {one["frame"] for one in judged["objects"]} == {"000000"}


def test_nothing_found_is_a_result_in_every_output(street, tmp_path, capsys) -> None:
    job = ("obstacles", street, str(tmp_path), "--detector", "colour:pink", "--matcher", "bm")
    every = ("--to", "pcd,kitti,mcap", "--video", "--track", "tracker")
    report = told(capsys, *job, "--detector.least-pixels", "100000", *every)
    assert report["figures"]["obstacles"]["max"] == 0
    assert report["labelled"]["objects"][0]["measured_m"] is None
    assert lines(tmp_path) == []
    assert len((tmp_path / "obstacles.csv").read_text().splitlines()) == 1
    identity = Pose.identity("camera_left", FRAME_CAM0)
    for name in FRAMES:
        assert read_labels(tmp_path / "label_2" / f"{name}.txt", T_left_cam0=identity) == ()
        assert not read_pcd(tmp_path / "pcd" / f"{name}.pcd").extra["object"].any()
    assert read_tracking_labels(tmp_path / "tracking.txt", T_left_cam0=identity) == {}
    with av.open(str(tmp_path / "obstacles.mp4")) as film:
        assert sum(1 for _ in film.decode(video=0)) >= 2
    assert len(list(tmp_path.glob("*.mcap"))) == 1
    assert "Nothing was found in 2 frames." in (tmp_path / "report.html").read_text()


def test_points_alone_have_no_picture(street, capsys, tmp_path) -> None:
    clouds, out = tmp_path / "c", str(tmp_path / "o")
    assert main(["convert", street, str(clouds), "--frames", "0:1", "--to", "ply"]) == 0
    job = ("obstacles", str(clouds / "ply"), out, "--detector", "regions:1,2,3,4")
    error = told(capsys, *job, code=3)["error"]
    assert "picture" in error["want"]


def test_a_corridor_stops_a_robot(street, tmp_path, capsys) -> None:
    job = ("obstacles", street, str(tmp_path), "--detector", "none", "--corridor", "6x2x60")
    found = told(capsys, *job, "--near", "15")
    assert "labelled" not in found  # nobody looked for what is labelled
    frames = json.loads((tmp_path / "report.json").read_text())["per_frame"]
    assert not any("labelled_classes" in one for one in frames)
    nearest = found["corridor"]["nearest"]
    assert 2 < nearest["distance_m"] < 60
    rows = list(csv.DictReader((tmp_path / "corridor.csv").open()))
    assert [row["frame"] for row in rows] == ["000000", "000001"]
    assert min(float(row["distance_m"]) for row in rows) == pytest.approx(
        nearest["distance_m"], rel=1e-5
    )
    assert len(list((tmp_path / "near").glob("*.png"))) == 2
    page = (tmp_path / "report.html").read_text()
    assert "nearest thing in the corridor over time" in page
    assert "Something in it in 2 of 2 frames." in page
    assert found["corridor"]["frames"] == {"thing": 2, "free": 0, "unseen": 0, "skipped": 0}
    limit = str(nearest["distance_m"] + 1)
    found = told(capsys, *job, "--near", "15", "--stop-at", limit, code=10)
    assert found["corridor"]["too_near"]["sure"] > 0.5
    anew = ("obstacles", street, str(tmp_path / "anew"), "--detector", "none")
    for passed_now in (1, 0):  # the same command stays stopped where it stopped
        stopped = told(capsys, *anew, "--corridor", "6x2x60", "--stop-at", "60", code=10)
        assert stopped["committed"] == 1
        assert stopped["passed_now"] == passed_now
        assert stopped["ended_early"]
    error = told(capsys, "obstacles", street, str(tmp_path), "--stop-at", "3", code=2)["error"]
    assert "--corridor" in error["fix"]


@pytest.mark.parametrize(
    ("given", "flag"),
    [
        (("--detector", "colour:mauve"), "--detector.hues"),
        (("--also", "range:10-2"), "--also.band"),
        (("--detector", "regions:1,2,3"), "--detector.boxes"),
        (("--corridor", "2x2"), "--corridor"),
    ],
)
def test_errors_name_the_flag_that_there_is(tmp_path, capsys, given, flag) -> None:
    job = ("obstacles", "synthetic:street", str(tmp_path), *given)
    assert told(capsys, *job, code=2)["error"]["where"] == flag


def test_classes_that_are_odd_are_warned_of_once(street, tmp_path, capsys, caplog) -> None:
    data = tmp_path / "data"
    shutil.copytree(street, data)
    for file in data.glob("**/label_2/*.txt"):
        file.write_text(file.read_text().replace("Pedestrian", "Unicorn", 1))
    job = ("obstacles", str(data), str(tmp_path / "out"), "--matcher", "bm", "--no-check")
    caplog.set_level("WARNING")
    found = told(capsys, *job, "--detector.classes", "Cra", "--frames", "0")
    assert found["figures"]["obstacles"]["max"] == 0
    typed, unknown = json.loads((tmp_path / "out" / "report.json").read_text())["warnings"]
    assert "no frame has the class Cra; there are Car" in typed
    assert "does not have: Unicorn" in unknown
    assert [line for line in caplog.messages if line.startswith("labels:")] == [typed, unknown]


def test_labels_of_frames_that_have_no_picture_are_told(street, tmp_path, capsys) -> None:
    data = tmp_path / "data"
    shutil.copytree(street, data)
    (labels,) = data.glob("**/label_2")
    shutil.copy(labels / "000001.txt", labels / "000007.txt")
    job = ("obstacles", str(data), str(tmp_path / "out"), "--detector", "none", "--frames", "0")
    found = told(capsys, *job, code=4)
    assert found["unpaired"] == ["labels without a pair of pictures: 000007.txt"]
    assert json.loads((tmp_path / "out" / "run.json").read_text())["exit_code"] == 4
