"""Video files: every frame by number as plain decoding gives it, times, colours, damage."""

from __future__ import annotations

import pickle
import threading
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from pseudolidar.errors import LimitError, PseudolidarError, VideoDamaged, VideoUnreadable
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.video.file import VideoFile
from pseudolidar.formats.video.kind import video_kind
from pseudolidar.formats.video.pixels import to_pixels
from tests.videos import H264, LOSSLESS, decoded, pictures, turned, without_packets, write_video

FRAMES = 40
OPEN_GOP = {"x264-params": "open-gop=1:bframes=3:keyint=12:b-pyramid=normal"}
QUIET = {"x265-params": "log-level=none"}
MADE = {
    "h264.mp4": H264,
    "h264.mkv": H264,
    "h264.mov": H264,
    "h264.ts": H264,
    "h264.avi": H264,  # packets say when they are decoded, and not when they are shown
    "h264 open.mkv": H264 | {"options": OPEN_GOP},
    "h264 open.mp4": H264 | {"options": OPEN_GOP},
    "h264 intra.mp4": H264 | {"gop": 1},
    "hevc.mp4": {"codec": "libx265", "pix_fmt": "yuv420p", "options": QUIET},
    "hevc.mkv": {"codec": "libx265", "pix_fmt": "yuv420p", "options": QUIET},
    "ffv1.mkv": LOSSLESS,
    "ffv1.avi": LOSSLESS,
    "mjpeg.avi": {"codec": "mjpeg", "pix_fmt": "yuvj420p"},
    "vp9.webm": {"codec": "libvpx-vp9", "pix_fmt": "yuv420p"},
    "mpeg4.avi": {"codec": "mpeg4", "pix_fmt": "yuv420p"},
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("videos")
    shown = pictures(FRAMES)
    return {name: write_video(folder / name, shown, **how) for name, how in MADE.items()}


# --- exactness -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", MADE)
def test_any_order_gives_the_pixels_of_plain_decoding(made: dict[str, Path], name: str) -> None:
    want = [to_pixels(frame, rotated=True).pixels for frame in decoded(made[name])]
    assert len({picture.tobytes() for picture in want}) == FRAMES
    video = VideoFile.open(made[name])
    assert len(video) == FRAMES
    order = np.random.default_rng(1).integers(0, FRAMES, 60).tolist()
    for number in [*range(FRAMES), *order, *reversed(range(FRAMES))]:
        assert np.array_equal(video.picture(number).pixels, want[number]), number


@pytest.mark.parametrize("name", ["h264 open.mkv", "hevc.mp4"])
def test_a_key_frame_with_frames_before_it_is_approached_from_the_one_before(made, name) -> None:
    """Else the decoder complains about frames that it cannot have, as if they were damaged."""
    index = VideoFile.open(made[name]).index
    assert index.key_open[1:3].all()  # the last group has no frame before its key
    assert index.start_of(int(index.key_frame[2])) == 1
    assert index.start_of(0) == 0


@pytest.mark.parametrize("name", ["ffv1.mkv", "ffv1.avi"])
def test_lossless_video_gives_the_pictures_that_were_put_in(made, name) -> None:
    video = VideoFile.open(made[name])
    for number, picture in enumerate(pictures(FRAMES)):
        assert np.array_equal(video.picture(number).pixels, picture)


@pytest.mark.parametrize("name", ["h264.mp4", "h264 open.mkv", "hevc.mkv", "ffv1.mkv"])
def test_threads_get_what_one_thread_gets(made: dict[str, Path], name: str) -> None:
    one = VideoFile.open(made[name])
    want = [one.picture(number).pixels for number in range(FRAMES)]
    many = VideoFile.open(made[name])
    order = np.random.default_rng(2).permutation(np.tile(np.arange(FRAMES), 4)).tolist()
    with ThreadPoolExecutor(6) as crew:
        for number, picture in zip(order, crew.map(many.picture, order), strict=True):
            assert np.array_equal(picture.pixels, want[number])


def test_frames_in_order_are_decoded_once_each_whoever_asks(made: dict[str, Path]) -> None:
    video = VideoFile.open(made["h264.mp4"])
    following = iter(range(FRAMES))
    turn = threading.Lock()

    def work() -> None:
        while True:
            with turn:
                number = next(following, None)
            if number is None:
                return
            video.picture(number)

    crew = [threading.Thread(target=work) for _ in range(4)]
    for thread in crew:
        thread.start()
    for thread in crew:
        thread.join()
    # A thread may come so late that it has to begin anew, rarely.
    assert video.packets_decoded < 1.5 * FRAMES


def test_only_what_key_frames_force_is_decoded(tmp_path: Path) -> None:
    path = write_video(tmp_path / "long.mp4", pictures(120), **H264, gop=30)
    video = VideoFile.open(path)
    for number in (31, 91, 93):
        video.picture(number)
    # Two packets from each key frame on, and what the decoder holds back to bring into order.
    assert video.packets_decoded < 30


def test_a_pickled_video_is_small_and_gives_the_same(made: dict[str, Path]) -> None:
    video = VideoFile.open(made["h264.mkv"])
    want = video.picture(17).pixels
    data = pickle.dumps(video)
    assert len(data) < 10_000
    assert np.array_equal(pickle.loads(data).picture(17).pixels, want)


# --- times ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "how"),
    [("a.mp4", H264), ("a.mov", H264), ("a.mp4", LOSSLESS)],
    ids=["mp4", "mov", "lossless mp4"],
)
def test_variable_rate_keeps_every_time(tmp_path: Path, name: str, how: dict) -> None:
    ticks = np.cumsum([0, *np.random.default_rng(0).integers(100, 9000, 19)]).tolist()
    base = Fraction(1, 90_000)
    path = write_video(tmp_path / name, pictures(20), ticks=ticks, time_base=base, **how)
    got = VideoFile.open(path).timestamps_ns
    assert got == tuple(round(tick * base * 10**9) for tick in ticks)


def test_times_are_rounded_from_exact_fractions(tmp_path: Path) -> None:
    ntsc = Fraction(30_000, 1001)
    path = write_video(tmp_path / "a.mp4", pictures(31), rate=ntsc, **H264)
    got = VideoFile.open(path).timestamps_ns
    assert got == tuple(round(k / ntsc * 10**9) for k in range(31))
    assert got[30] == 1_001_000_000


def test_frames_of_one_time_are_left_out_and_told(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    shown = pictures(40)
    # 4000 frames a second: Matroska counts milliseconds.
    write_video(path, shown, ticks=range(40), time_base=Fraction(1, 4000), **LOSSLESS)
    video = VideoFile.open(path)
    assert np.diff(video.timestamps_ns).min() > 0
    assert len(video) < 40
    assert any("with the time of another one" in note for note in video.notes)
    pts = [frame.pts for frame in decoded(path)]
    firsts = [pts.index(stamp) for stamp in sorted(set(pts))]
    for number in [*range(len(video)), *range(len(video)), 3, 8, 2, 5]:
        assert np.array_equal(video.picture(number).pixels, shown[firsts[number]]), number


@pytest.mark.parametrize("how", [LOSSLESS, H264], ids=["ffv1", "h264 with reordering"])
def test_empty_packets_of_an_avi_are_no_frames(tmp_path: Path, how: dict) -> None:
    """AVI has one packet for each tick; where no frame is shown, an empty one."""
    ticks = [0, 1, 4, 5, 9, 10, 11, 20, *range(25, 50)]
    path = write_video(tmp_path / "a.avi", pictures(len(ticks)), ticks=ticks, **how)
    want = [to_pixels(frame, rotated=True).pixels for frame in decoded(path)]
    video = VideoFile.open(path)
    assert len(video) == len(ticks)
    if how is LOSSLESS:
        assert video.timestamps_ns == tuple(tick * 10**8 for tick in ticks)
    for number in np.random.default_rng(4).permutation(len(ticks)).tolist():
        assert np.array_equal(video.picture(number).pixels, want[number]), number


# --- colours, depth, shape -----------------------------------------------------------------

MATRIX = {5: (0.299, 0.114), 6: (0.299, 0.114), 1: (0.2126, 0.0722), 9: (0.2627, 0.0593)}
PATCHES = np.array(
    [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [0, 0, 0], [128, 128, 128],
     [200, 30, 90], [17, 160, 220], [255, 255, 0], [90, 90, 10]],
    np.float64,
)  # fmt: skip


def yuv(rgb: np.ndarray, matrix: int, *, full: bool, bits: int = 8) -> np.ndarray:
    """(3, N) Y, Cb, Cr of (N, 3) RGB 0-255. Source: ITU-T H.273, equations 8-3."""
    kr, kb = MATRIX[matrix]
    r, g, b = (rgb / 255).T
    y = kr * r + (1 - kr - kb) * g + kb * b
    cb, cr = (b - y) / (2 * (1 - kb)), (r - y) / (2 * (1 - kr))
    scale, half = 2 ** (bits - 8), 2 ** (bits - 1)
    if full:
        top = 2**bits - 1
        values = np.stack([top * y, top * cb + half, top * cr + half])
    else:
        values = np.stack(
            [scale * (219 * y + 16), scale * 224 * cb + half, scale * 224 * cr + half]
        )
    return np.clip(np.round(values), 0, 2**bits - 1)


@pytest.mark.parametrize("full", [False, True], ids=["limited", "full"])
@pytest.mark.parametrize("matrix", [5, 1, 9], ids=["BT.601", "BT.709", "BT.2020"])
def test_colours_come_back_whatever_matrix_and_range(tmp_path, matrix: int, full: bool) -> None:
    planes = yuv(PATCHES, matrix, full=full).astype(np.uint8)
    picture = np.repeat(np.repeat(planes[:, None, :], 48, axis=1), 8, axis=2)
    how = {"codec": "ffv1", "pix_fmt": "yuv444p", "form": "yuv444p"}
    path = write_video(
        tmp_path / "a.mkv", [picture], colorspace=matrix, color_range=2 if full else 1, **how
    )
    video = VideoFile.open(path)
    got = video.picture(0).pixels[24, 4::8].astype(int)
    # Rounding to 8 bits of Y, Cb and Cr is worth up to 2 levels, conversion back another.
    assert np.abs(got - PATCHES).max() <= 2
    name = {5: "BT.601", 1: "BT.709", 9: "BT.2020"}[matrix]
    assert video.notes == (f"colours: {name}, {'full' if full else 'limited'} range",)


@pytest.mark.parametrize(("height", "matrix"), [(576, 5), (578, 1)])
def test_an_unnamed_matrix_follows_from_the_size(tmp_path, height: int, matrix: int) -> None:
    planes = yuv(PATCHES, matrix, full=False).astype(np.uint8)
    picture = np.repeat(np.repeat(planes[:, None, :], height, axis=1), 8, axis=2)
    how = {"codec": "ffv1", "pix_fmt": "yuv444p", "form": "yuv444p"}
    video = VideoFile.open(write_video(tmp_path / "a.mkv", [picture], **how))
    assert np.abs(video.picture(0).pixels[24, 4::8].astype(int) - PATCHES).max() <= 2
    assert "assumed from the size" in video.notes[0]


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.mov"])
def test_colours_survive_h264(tmp_path: Path, name: str) -> None:
    picture = np.repeat(np.repeat(PATCHES.astype(np.uint8)[None], 48, axis=0), 16, axis=1)
    how = H264 | {"options": {"crf": "1"}, "colorspace": 6, "color_range": 1}
    video = VideoFile.open(write_video(tmp_path / name, [picture] * 3, **how))
    assert np.abs(video.picture(1).pixels[24, 8::16].astype(int) - PATCHES).max() <= 4


def test_ten_bits_become_sixteen_with_white_at_the_top(tmp_path: Path) -> None:
    planes = yuv(PATCHES, 1, full=False, bits=10).astype(np.uint16)
    picture = np.repeat(np.repeat(planes[:, None, :], 48, axis=1), 8, axis=2)
    how = {"codec": "ffv1", "pix_fmt": "yuv444p10le", "form": "yuv444p10le"}
    path = write_video(tmp_path / "a.mkv", [picture], colorspace=1, color_range=1, **how)
    video = VideoFile.open(path)
    pixels = video.picture(0).pixels
    assert pixels.dtype == np.uint16
    got = pixels[24, 4::8] / 65535 * 255
    # swscale's coefficients are good to 4 of 1023 levels here; 8 bits would be off by twice that.
    assert np.abs(got - PATCHES).max() < 1.3
    assert len(np.unique(pixels % 257)) > 1
    assert "10 bits to 16-bit RGB" in video.notes[0]


@pytest.mark.parametrize(
    ("pix_fmt", "dtype"), [("gray", np.uint8), ("gray10le", np.uint16), ("gray16le", np.uint16)]
)
def test_grey_keeps_its_values(tmp_path: Path, pix_fmt: str, dtype: type) -> None:
    top = {"gray": 255, "gray10le": 1023, "gray16le": 65535}[pix_fmt]
    rng = np.random.default_rng(0)
    shown = [rng.integers(0, top + 1, (47, 61)).astype(dtype) for _ in range(3)]
    path = write_video(tmp_path / "a.mkv", shown, pix_fmt=pix_fmt, form=pix_fmt)
    video = VideoFile.open(path)
    for number, picture in enumerate(shown):
        assert np.array_equal(video.picture(number).pixels, picture)
        assert video.picture(number).pixels.dtype == dtype


@pytest.mark.parametrize("size", [(65, 47), (63, 48), (64, 49)])
def test_odd_sizes(tmp_path: Path, size: tuple[int, int]) -> None:
    width, height = size
    shown = pictures(3, width, height)
    lossless = VideoFile.open(write_video(tmp_path / "a.mkv", shown))
    assert lossless.size_px == size
    assert np.array_equal(lossless.picture(2).pixels, shown[2])
    halved = VideoFile.open(write_video(tmp_path / "b.mkv", shown, pix_fmt="yuv420p"))
    assert halved.picture(1).pixels.shape == (height, width, 3)


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_pictures_are_turned_as_players_turn_them(tmp_path: Path, quarters: int) -> None:
    import cv2

    path = turned(write_video(tmp_path / "a.mp4", pictures(2), **H264), quarters)
    shown = cv2.VideoCapture(str(path))
    shown.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
    done, want = shown.read()
    assert done
    video = VideoFile.open(path)
    got = video.picture(0)
    assert got.pixels.shape == want.shape
    assert video.size_px == (want.shape[1], want.shape[0])
    # Its colours are converted with less care, so the other way up is compared with as well.
    apart, over = (
        np.abs(a[:, :, ::-1].astype(int) - want).mean()
        for a in (got.pixels, np.rot90(got.pixels, 2))
    )
    assert apart < over / 4
    assert bool(got.notes) == bool(quarters)
    stored = VideoFile.open(path, rotated=False).picture(0).pixels
    assert stored.shape == (48, 64, 3)


def test_pixels_that_are_not_square_are_told(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", pictures(2), aspect=Fraction(2), **H264)
    video = VideoFile.open(path)
    assert video.size_px == (64, 48)
    assert any(note.startswith("pixels are 2 times as wide") for note in video.notes)


# --- broken files --------------------------------------------------------------------------


def test_a_recording_without_its_directory_is_named(made: dict[str, Path], tmp_path: Path) -> None:
    path = tmp_path / "cut.mp4"
    path.write_bytes(made["h264.mp4"].read_bytes()[:6000])
    assert video_kind(path) == "MP4"
    with pytest.raises(VideoUnreadable, match="without its directory") as caught:
        VideoFile.open(path)
    assert caught.value.exit_code == 3
    assert "MKV" in caught.value.fix


@pytest.mark.parametrize("content", [b"", b"no video at all" * 50, b"\x1aE\xdf\xa3" + bytes(500)])
def test_what_is_no_video_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mkv"
    path.write_bytes(content)
    with pytest.raises(VideoUnreadable):
        VideoFile.open(path)
    with pytest.raises(VideoUnreadable, match="no such file"):
        VideoFile.open(tmp_path / "nowhere.mkv")


def test_sound_alone_and_nothing_at_all_are_refused(tmp_path: Path) -> None:
    sound, empty = tmp_path / "a.mka", tmp_path / "b.mkv"
    with av.open(str(sound), "w", format="matroska") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), "s16", "mono")
        frame.rate = 8000
        container.mux(stream.encode(frame))
    with pytest.raises(VideoUnreadable, match="only audio"):
        VideoFile.open(sound)
    with av.open(str(empty), "w") as container:
        stream = container.add_stream("ffv1", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        container.start_encoding()
    with pytest.raises(VideoUnreadable, match=r"without a frame|none of|End of file"):
        VideoFile.open(empty)


@pytest.mark.parametrize("name", ["ffv1.mkv", "h264.mkv", "h264.ts", "mjpeg.avi"])
def test_cut_anywhere_whole_frames_are_exact_and_the_rest_is_refused(made, tmp_path, name) -> None:
    data, whole = made[name].read_bytes(), VideoFile.open(made[name])
    want = {whole.timestamps_ns[n]: whole.picture(n).pixels for n in range(FRAMES)}
    path = tmp_path / f"cut{made[name].suffix}"
    for share in np.linspace(0.3, 0.99, 9):
        path.write_bytes(data[: round(share * len(data))])
        video = VideoFile.open(path)
        good = 0
        for number in range(len(video)):
            try:
                picture = video.picture(number).pixels
            except VideoDamaged:
                continue
            assert np.array_equal(picture, want[video.timestamps_ns[number]]), number
            good += 1
        assert len(video) - good <= 4
        assert 0 < good <= round(share * FRAMES) + 1


def test_a_cut_mp4_with_its_directory_in_front_tells_what_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    shown = pictures(FRAMES)
    write_video(path, shown, **LOSSLESS)
    with (
        av.open(str(path)) as old,
        av.open(str(tmp_path / "b.mp4"), "w", options={"movflags": "faststart"}) as new,
    ):
        stream = new.add_stream_from_template(old.streams.video[0])
        for packet in old.demux(video=0):
            if packet.size:
                packet.stream = stream
                new.mux(packet)
    data = (tmp_path / "b.mp4").read_bytes()
    path.write_bytes(data[: len(data) // 2])
    video = VideoFile.open(path)
    assert video.index.promised == FRAMES
    assert video.index.packets < FRAMES
    assert any(f"of {FRAMES} frames are not in it" in note for note in video.notes)
    assert np.array_equal(video.picture(5).pixels, shown[5])


def test_an_avi_with_moments_that_have_no_frame_does_not_end_early(tmp_path: Path) -> None:
    """AVI counts moments: a recorder that dropped frames left some of them empty."""
    path = tmp_path / "a.avi"
    ticks = [62 * n + (n > 4) for n in range(FRAMES)]
    settings = {"codec": "mjpeg", "pix_fmt": "yuvj420p", "ticks": ticks}
    write_video(path, pictures(FRAMES), time_base=Fraction(1, 600), rate=600, **settings)
    video = VideoFile.open(path)
    assert len(video) == FRAMES
    assert not [note for note in video.notes if "ends early" in note]
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 4])
    assert [note for note in VideoFile.open(path).notes if "ends early" in note]


@pytest.mark.parametrize("name", ["h264.mkv", "hevc.mkv", "h264.ts"])
def test_what_a_lost_key_frame_leaves_grey_is_refused(made, tmp_path, name) -> None:
    """Decoders fill in what they miss with grey, and go on as if nothing had happened."""
    whole = VideoFile.open(made[name])
    key = int(whole.index.key_packet[1])
    path = without_packets(made[name], tmp_path / f"lost{made[name].suffix}", [key])
    want = {whole.timestamps_ns[n]: whole.picture(n).pixels for n in range(FRAMES)}
    video = VideoFile.open(path)
    refused = []
    for number in range(len(video)):
        try:
            assert np.array_equal(
                video.picture(number).pixels, want[video.timestamps_ns[number]]
            ), number
        except VideoDamaged:
            refused.append(number)
    following = int(whole.index.key_frame[2] - whole.index.key_frame[1])
    assert len(refused) >= following - 4
    assert np.array_equal(video.picture(3).pixels, whole.picture(3).pixels)


def test_damaged_bytes_never_reach_the_pixels_of_a_format_with_checksums(made, tmp_path) -> None:
    data = made["ffv1.mkv"].read_bytes()
    shown = pictures(FRAMES)
    rng = np.random.default_rng(0)
    refused = 0
    for trial in range(12):
        broken = bytearray(data)
        place = int(rng.integers(2000, len(data) - 2000))
        broken[place] ^= 0xFF
        path = tmp_path / f"{trial}.mkv"
        path.write_bytes(broken)
        video = VideoFile.open(path)
        for number in range(0, len(video), 3):
            at = round(video.timestamps_ns[number] / 10**8)
            try:
                assert np.array_equal(video.picture(number).pixels, shown[at])
            except VideoDamaged:
                refused += 1
    assert refused > 10


def test_damage_costs_the_same_frames_in_any_order(made: dict[str, Path], tmp_path: Path) -> None:
    data = bytearray(made["h264.mkv"].read_bytes())
    for share in (0.3, 0.4, 0.6):
        place = round(share * len(data))
        data[place : place + 60] = np.random.default_rng(0).bytes(60)
    path = tmp_path / "a.mkv"
    path.write_bytes(data)

    def state(video: VideoFile, number: int) -> bytes | None:
        try:
            return video.picture(number).pixels.tobytes()
        except VideoDamaged:
            return None

    in_order = VideoFile.open(path)
    want = [state(in_order, number) for number in range(len(in_order))]
    assert None in want
    mixed = VideoFile.open(path)
    for number in np.random.default_rng(3).integers(0, len(mixed), 60).tolist():
        assert state(mixed, number) == want[number]


def test_nothing_but_typed_errors_whatever_the_bytes(made: dict[str, Path], tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    outcomes = set()
    for name in ("h264.mp4", "h264.mkv", "hevc.mkv", "vp9.webm", "mjpeg.avi", "h264.ts"):
        data = made[name].read_bytes()
        for trial in range(12):
            broken = bytearray(data)
            for place in rng.integers(0, len(data), 20):
                broken[place] = int(rng.integers(0, 256))
            path = tmp_path / f"{trial}{made[name].suffix}"
            path.write_bytes(broken)
            try:
                video = VideoFile.open(path)
                for number in range(0, len(video), 5):
                    video.picture(number)
                outcomes.add("read")
            except PseudolidarError as error:
                outcomes.add(error.code)
    assert {"read", "VideoDamaged"} <= outcomes


def test_a_size_beyond_the_cap_is_refused_before_decoding(made: dict[str, Path]) -> None:
    with pytest.raises(LimitError, match="64x48"):
        VideoFile.open(made["h264.mp4"], limits=Limits(pixels=1000))


def test_a_file_that_changes_is_told(made: dict[str, Path], tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    path.write_bytes(made["ffv1.mkv"].read_bytes())
    video = pickle.loads(pickle.dumps(VideoFile.open(path)))
    path.write_bytes(path.read_bytes() + b"more")
    with pytest.raises(VideoUnreadable, match="when it was opened"):
        video.picture(0)


@pytest.mark.parametrize("name", MADE)
def test_videos_are_known_by_their_first_bytes(made: dict[str, Path], name: str, tmp_path) -> None:
    path = tmp_path / "no extension"
    path.write_bytes(made[name].read_bytes()[:2000])
    assert video_kind(path) is not None
