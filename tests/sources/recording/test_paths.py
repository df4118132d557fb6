"""Recordings of where a robot went, and of nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from pseudolidar.errors import SourceEmpty
from pseudolidar.sources.recording.paths import paths_alone
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.viewer.opening import Opening
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.stills import StillPath
from tests.recordings import FoxgloveWriter, fox_cloud, scan_records, small_drive

START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 100_000_000


def pose(frame: str, x: float) -> PoseInFrame:
    message = PoseInFrame(frame_id=frame)
    message.pose.position.x = x
    message.pose.orientation.w = 1.0
    return message


def recorded(path: Path, *, clouds: int = 0) -> Path:
    with FoxgloveWriter(path) as writer:
        for index in range(5):
            time_ns = START_NS + index * PERIOD_NS
            writer.write(
                "/robot/odom", pose("odom", float("nan") if index == 3 else index), time_ns
            )
            # A filter begins anew in another frame: its poses do not go on with those before.
            writer.write("/wheels", pose("odom" if index < 4 else "map", -index), time_ns)
            if index < 2:
                writer.write("/amcl", pose("map", 100.0), time_ns)
            if index < clouds:
                scan = small_drive(1)[0].scan
                assert scan is not None
                writer.write("/lidar", fox_cloud(scan_records(scan), time_ns), time_ns)
    return path


def opening() -> Opening:
    def reel_of(source: Recording) -> NoFrames:
        source.open()
        return NoFrames("frames")

    return Opening(reel_of)  # type: ignore[arg-type]


def test_poses_that_are_all_there_is_are_paths(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = recorded(tmp_path / "a.mcap")
    found = paths_alone(Recording(str(path)))
    assert {(one.topic, one.frame) for one in found} == {
        ("/robot/odom", "odom"),
        ("/wheels", "odom"),
        ("/amcl", "map"),
    }
    opened = opening().all_of([str(path)])
    assert opened.reels == ()
    shown = {one.name: one.places_m for one in opened.stills if isinstance(one, StillPath)}
    assert set(shown) == {"a.mcap robot.odom", "a.mcap wheels"}
    # A place that is none is left out.
    np.testing.assert_array_equal(shown["a.mcap robot.odom"][:, 0], [0, 1, 2, 4])
    np.testing.assert_array_equal(shown["a.mcap wheels"][:, 0], [0, -1, -2, -3])
    assert "/amcl is not shown: it is in map, and not in odom" in caplog.text


def test_a_recording_with_clouds_is_its_frames(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap", clouds=1)
    assert paths_alone(Recording(str(path))) == ()
    assert opening().all_of([str(path)]).stills == ()


def test_a_recording_without_anything_stays_refused(tmp_path: Path) -> None:
    with FoxgloveWriter(tmp_path / "a.mcap") as writer:
        writer.write_bytes("/odd", "my.Type", b"", b"\x01", START_NS, encoding="cbor")
    with pytest.raises(SourceEmpty, match="/odd"):
        opening().all_of([str(tmp_path / "a.mcap")])


@pytest.mark.real
def test_the_way_of_a_robot_of_others(real_data: Path) -> None:
    opened = opening().all_of([str(real_data / "mcap" / "nav2_turtlebot.mcap")])
    (way,) = opened.stills
    assert isinstance(way, StillPath)
    assert way.places_m.shape == (2639, 3)
    assert way.length_m == pytest.approx(34.3, abs=0.1)
