"""MP4 for browsers: what it holds, its times, its colours, its bytes."""

from __future__ import annotations

import av
import numpy as np
import pytest

from pseudolidar.errors import OutputError, StructureError
from pseudolidar.formats.video.mp4 import ENCODERS, TICKS_PER_S, mp4_comment, mp4_encoder, write_mp4
from tests.videos import decoded, pictures


def test_it_is_what_browsers_play(tmp_path):
    path = tmp_path / "a.mp4"
    write_mp4(path, pictures(5, 64, 48), range(0, 5 * 9000, 9000), last_ticks=9000)
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat"), "it must play before it is there whole"
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.codec.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert "creation_time" not in container.metadata | stream.metadata
        assert container.duration == 500_000
    assert next(iter(ENCODERS)) == mp4_encoder(), "the wheels of PyAV have libx264"


def test_times_are_kept_and_the_last_frame_lasts(tmp_path):
    ticks = [0, 3000, 3750, 30_000, 120_000]
    write_mp4(tmp_path / "a.mp4", pictures(5, 64, 48), ticks, last_ticks=45_000)
    got = [frame.pts * frame.time_base * TICKS_PER_S for frame in decoded(tmp_path / "a.mp4")]
    assert got == ticks
    with av.open(str(tmp_path / "a.mp4")) as container:
        assert container.duration == pytest.approx(165_000 / TICKS_PER_S * 1e6, abs=1000)


def test_colours_are_right_to_a_player(tmp_path):
    colours = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [90, 60, 20]])
    picture = np.repeat(np.repeat(colours[None], 64, axis=0), 32, axis=1).astype(np.uint8)
    write_mp4(tmp_path / "a.mp4", [picture] * 3, [0, 900, 1800], last_ticks=900)
    frame = decoded(tmp_path / "a.mp4")[1]
    assert (frame.colorspace, frame.color_range) == (1, 1), "BT.709, limited"
    y, u, v = (np.asarray(plane)[32, 16::32] for plane in planes(frame))
    want = 16 + 219 * (colours / 255) @ (0.2126, 0.7152, 0.0722)  # ITU-T H.273, BT.709
    assert np.abs(y - want).max() < 3
    assert u[2] > 230
    assert v[0] > 230


def planes(frame):
    halved = (slice(None), slice(None))
    for plane, scale in zip(frame.planes, (1, 2, 2), strict=True):
        rows = np.frombuffer(plane, np.uint8).reshape(plane.height, -1)[:, : plane.width]
        yield rows[halved].repeat(scale, axis=0).repeat(scale, axis=1)


def test_the_same_pictures_are_the_same_bytes(tmp_path):
    for name in ("a.mp4", "b.mp4"):
        write_mp4(tmp_path / name, pictures(9, 320, 240), range(0, 8100, 900), last_ticks=900)
    data = (tmp_path / "a.mp4").read_bytes()
    assert data == (tmp_path / "b.mp4").read_bytes()
    # With it 1 film in 70 was of other bytes, by what the memory had held: seldom enough to be
    # missed here (docs/decisions.md).
    assert b" mbtree=0 " in data


def test_sizes_that_h264_cannot_have_are_refused(tmp_path):
    with pytest.raises(StructureError, match="63x48"):
        write_mp4(tmp_path / "a.mp4", pictures(2, 63, 48), [0, 900], last_ticks=900)
    mixed = [*pictures(1, 64, 48), *pictures(1, 32, 48)]
    with pytest.raises(StructureError, match="32x48"):
        write_mp4(tmp_path / "a.mp4", mixed, [0, 900], last_ticks=900)
    assert list(tmp_path.iterdir()) == []


def test_a_failure_leaves_nothing(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OutputError):
        write_mp4(tmp_path / "file" / "a.mp4", pictures(2, 64, 48), [0, 900], last_ticks=900)

    def stopped():
        yield pictures(1, 64, 48)[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_mp4(tmp_path / "a.mp4", stopped(), [0, 900], last_ticks=900)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_comment_is_told_of_a_whole_file_alone(tmp_path):
    path = tmp_path / "a.mp4"
    write_mp4(path, pictures(3, 64, 48), [0, 900, 1800], last_ticks=900, comment="of three")
    whole = path.read_bytes()
    assert mp4_comment(path) == "of three"
    for broken in (whole[:-1], whole[: len(whole) // 2], whole[:7], b"", whole + b"\0", b"\0" * 64):
        path.write_bytes(broken)
        assert mp4_comment(path) == ""
    assert mp4_comment(tmp_path / "none.mp4") == ""
    write_mp4(path, pictures(3, 64, 48), [0, 900, 1800], last_ticks=900)
    assert mp4_comment(path) == ""
