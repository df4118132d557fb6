"""Pictures: what is read, and what is refused before a decoder invents something."""

from __future__ import annotations

import io
import os
import struct
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as Pillow

from pseudolidar.errors import (
    ImageFormat,
    ImageMissing,
    ImageTruncated,
    ImageUnreadable,
    LimitError,
    PseudolidarError,
    StructureError,
)
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.pictures.image import (
    decode_image,
    encode_jpeg,
    encode_png,
    read_image,
    read_size,
)

RGB = np.random.default_rng(1).integers(0, 256, (37, 53, 3), dtype=np.uint8)
GREY = RGB[:, :, 0].copy()


def smooth_rgb() -> np.ndarray:
    """A picture that compresses like a photo."""
    y, x = np.mgrid[0:240, 0:320].astype(np.float32)
    waves = [np.sin(x / 17 + k) * np.cos(y / (11 + k)) * 100 + 128 for k in range(3)]
    noise = np.random.default_rng(2).normal(0, 6, (240, 320, 3))
    return np.clip(np.stack(waves, axis=2) + noise, 0, 255).astype(np.uint8)


def pillow_bytes(image: Pillow.Image, kind: str, **settings: object) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **settings)
    return file.getvalue()


def encoded(pixels: np.ndarray, extension: str) -> bytes:
    bgr = pixels if pixels.ndim == 2 else np.ascontiguousarray(pixels[:, :, ::-1])
    return cv2.imencode(extension, bgr)[1].tobytes()


def refusal(data: bytes, path: str, kind: type[PseudolidarError], **settings: Limits):
    with pytest.raises(kind) as caught:
        decode_image(data, path, **settings)
    assert type(caught.value) is kind
    assert caught.value.path == path
    return caught.value


@pytest.fixture
def quiet_stderr(capfd: pytest.CaptureFixture[str]):
    """Nothing may reach the process's stderr, native code included."""
    yield
    assert capfd.readouterr().err == ""


# --- what is read --------------------------------------------------------------------------


@pytest.mark.parametrize("extension", [".png", ".tiff", ".bmp"])
@pytest.mark.parametrize("pixels", [RGB, GREY], ids=["rgb", "grey"])
def test_lossless_formats_give_the_pixels_back(extension: str, pixels: np.ndarray) -> None:
    image = decode_image(encoded(pixels, extension), f"a{extension}")
    assert image.pixels.dtype == np.uint8
    assert np.array_equal(image.pixels, pixels)
    assert image.notes == ()


@pytest.mark.parametrize(("extension", "pixels"), [(".pgm", GREY), (".ppm", RGB)])
@pytest.mark.parametrize("binary", [1, 0])
def test_netpbm_binary_and_ascii(extension: str, pixels: np.ndarray, binary: int) -> None:
    bgr = pixels if pixels.ndim == 2 else np.ascontiguousarray(pixels[:, :, ::-1])
    data = cv2.imencode(extension, bgr, [cv2.IMWRITE_PXM_BINARY, binary])[1].tobytes()
    assert np.array_equal(decode_image(data, f"a{extension}").pixels, pixels)


def test_jpeg_and_webp_are_rgb() -> None:
    red = np.zeros((16, 16, 3), np.uint8)
    red[:, :, 0] = 200
    for data, name in (
        (encode_jpeg(red, 95), "a.jpg"),
        (pillow_bytes(Pillow.fromarray(red), "WebP"), "a.webp"),
    ):
        pixels = decode_image(data, name).pixels.astype(int)
        assert np.abs(pixels - red).max() < 8  # both are lossy


@pytest.mark.parametrize("extension", [".png", ".tiff"])
def test_16_bits_stay_16_bits(extension: str) -> None:
    for pixels in (GREY.astype(np.uint16) * 257 + 3, RGB.astype(np.uint16) * 200 + 7):
        image = decode_image(encoded(pixels, extension), f"a{extension}")
        assert image.pixels.dtype == np.uint16
        assert np.array_equal(image.pixels, pixels)


def test_pgm_of_12_bits_keeps_its_values_and_says_so() -> None:
    values = (np.arange(6) * 800).astype(">u2")
    data = b"P5\n# a comment\n3 2\n4095\n" + values.tobytes()
    image = decode_image(data, "a.pgm")
    assert image.pixels.ravel().tolist() == values.tolist()
    assert image.notes == ("values up to 4095 kept as they are",)


def test_alpha_is_dropped_and_noted() -> None:
    alpha = np.full(GREY.shape, 0, np.uint8)
    rgba = np.dstack([RGB, alpha])
    grey_alpha = np.dstack([GREY, alpha])
    for pixels, mode, want in ((rgba, "RGBA", RGB), (grey_alpha, "LA", GREY)):
        image = decode_image(pillow_bytes(Pillow.fromarray(pixels, mode), "PNG"), "a.png")
        assert np.array_equal(image.pixels, want)
        assert image.notes == ("alpha channel dropped",)


def test_palette_becomes_its_colours() -> None:
    palette = Pillow.fromarray(RGB).quantize(16)
    want = np.asarray(palette.convert("RGB"))
    assert np.array_equal(decode_image(pillow_bytes(palette, "PNG"), "a.png").pixels, want)


def test_exif_rotation_is_ignored() -> None:
    exif = Pillow.Exif()
    exif[0x0112] = 6  # shown turned by 90 degrees
    data = pillow_bytes(Pillow.fromarray(RGB), "JPEG", exif=exif.tobytes())
    assert decode_image(data, "a.jpg").pixels.shape == RGB.shape


@pytest.mark.parametrize(
    "mode",
    [
        {},
        {"progressive": True},
        {"restart_marker_rows": 1},
        {"restart_marker_blocks": 7},
        {"optimize": True},
        {"subsampling": 0},
        {"subsampling": 1},
        {"subsampling": 2, "restart_marker_blocks": 3},
    ],
)
@pytest.mark.parametrize("size", [(240, 320), (239, 319), (17, 9), (1, 1)])
def test_jpegs_of_other_encoders(mode: dict[str, object], size: tuple[int, int]) -> None:
    photo = smooth_rgb()[: size[0], : size[1]]
    for pixels in (photo, np.ascontiguousarray(photo[:, :, 1])):
        data = pillow_bytes(Pillow.fromarray(pixels), "JPEG", quality=90, **mode)
        assert decode_image(data + b"trailing bytes", "a.JPEG").pixels.shape == pixels.shape


def test_encoders_round_trip() -> None:
    deep = RGB.astype(np.uint16) * 257
    for pixels in (RGB, GREY, deep):
        assert np.array_equal(decode_image(encode_png(pixels, 3), "a.png").pixels, pixels)
    photo = smooth_rgb()
    error = decode_image(encode_jpeg(photo, 98), "a.jpg").pixels.astype(int) - photo
    assert np.abs(error).mean() < 4  # lossy; a swap of red and blue would give far more
    with pytest.raises(StructureError):
        encode_jpeg(deep, 90)


def test_read_size_is_that_of_the_pixels(tmp_path: Path) -> None:
    for extension in (".png", ".jpg", ".tiff", ".bmp", ".ppm", ".webp"):
        path = tmp_path / f"a{extension}"
        path.write_bytes(encoded(RGB, extension))
        assert read_size(path) == (53, 37)


@pytest.mark.real
def test_real_pictures_are_what_opencv_reads(real_data: Path) -> None:
    for name, flag in (
        ("kitti_stereo2015/training/image_2/000002_10.png", cv2.IMREAD_COLOR_RGB),
        ("kitti_odometry/sequences/06/image_0/000000.png", cv2.IMREAD_GRAYSCALE),
        ("kitti_stereo2015/training/disp_occ_0/000002_10.png", cv2.IMREAD_UNCHANGED),
        ("chessboard/swapped_640x512/left01.jpg", cv2.IMREAD_ANYCOLOR),
    ):
        path = real_data / name
        want = cv2.imread(str(path), flag)
        image = read_image(path)
        assert image.pixels.dtype == want.dtype
        assert np.array_equal(image.pixels, want)


# --- row 1: missing ------------------------------------------------------------------------


def test_missing_names_the_nearest(tmp_path: Path) -> None:
    for number in (0, 7, 12):
        (tmp_path / f"{number:06d}_10.png").write_bytes(b"x")
    with pytest.raises(ImageMissing) as caught:
        read_image(tmp_path / "000007_11.png")
    assert "'000007_10.png'" in caught.value.fix
    assert caught.value.path == str(tmp_path / "000007_11.png")


def test_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(ImageMissing, match="folder"):
        read_image(tmp_path / "nowhere" / "a.png")


# --- row 2: no picture, or another kind ----------------------------------------------------


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (b"", "0 bytes"),
        (bytes(range(128, 256)), "no known kind"),
        (b"PK\x03\x04" + bytes(40), "ZIP"),
        (b"<!DOCTYPE html><html>", "HTML"),
        (b"version https://git-lfs.github.com/spec/v1\n", "Git LFS"),
        (b"GIF89a" + bytes(40), "GIF"),
        (b"1.0 2.0 3.0\n", "text"),
    ],
)
def test_what_is_no_picture_is_named(data: bytes, found: str, quiet_stderr: None) -> None:
    assert found in refusal(data, "a.png", ImageUnreadable).got


def test_wrong_extension_names_both() -> None:
    error = refusal(encode_png(RGB), "a.jpg", ImageUnreadable)
    assert "PNG" in error.got
    assert ".jpg" in error.got
    assert error.want == "JPEG"
    assert decode_image(encode_png(RGB), "a.picture").pixels.shape == RGB.shape


def test_a_folder_and_an_unreadable_file(tmp_path: Path) -> None:
    (tmp_path / "a.png").mkdir()
    with pytest.raises(ImageUnreadable, match="directory"):
        read_image(tmp_path / "a.png")


def test_a_loop_of_links(tmp_path: Path) -> None:
    (tmp_path / "a.png").symlink_to(tmp_path / "b.png")
    (tmp_path / "b.png").symlink_to(tmp_path / "a.png")
    with pytest.raises(ImageUnreadable, match="symbolic links"):
        read_image(tmp_path / "a.png")


# --- rows 3 and 4: cut and damaged ---------------------------------------------------------


@pytest.mark.parametrize(
    "extension", [".png", ".tiff", ".ppm", ".bmp", ".webp", ".jpg"], ids=lambda e: e[1:]
)
def test_cut_at_any_byte_is_truncated(extension: str, quiet_stderr: None) -> None:
    data = encoded(RGB, extension)
    steps = range(40, len(data) - 2, max(1, len(data) // 60))
    for length in [*steps, len(data) - 2]:
        with pytest.raises(ImageTruncated) as caught:
            decode_image(data[:length], f"a{extension}")
        assert f"{length} bytes" in caught.value.got


@pytest.mark.parametrize("settings", [{}, {"big_tiff": True}, {"compression": "tiff_lzw"}])
def test_cut_tiff_whose_directory_comes_first(
    settings: dict[str, object], quiet_stderr: None
) -> None:
    data = pillow_bytes(Pillow.fromarray(RGB), "TIFF", **settings)
    assert np.array_equal(decode_image(data, "a.tif").pixels, RGB)
    for length in range(40, len(data) - 2, len(data) // 40):
        refusal(data[:length], "a.tif", ImageTruncated)


def test_ascii_pgm_cut() -> None:
    data = cv2.imencode(".pgm", GREY, [cv2.IMWRITE_PXM_BINARY, 0])[1].tobytes()
    assert "values" in refusal(data[: len(data) // 2], "a.pgm", ImageTruncated).got


def test_progressive_and_restarting_jpegs_cut(quiet_stderr: None) -> None:
    for mode in ({"progressive": True}, {"restart_marker_rows": 1}):
        data = pillow_bytes(Pillow.fromarray(smooth_rgb()), "JPEG", quality=90, **mode)
        for length in range(700, len(data) - 1, len(data) // 40):
            refusal(data[:length], "a.jpg", ImageTruncated)


def test_two_halves_of_jpegs_joined(quiet_stderr: None) -> None:
    data = encode_jpeg(smooth_rgb(), 90)
    refusal(data[: len(data) // 2] + data, "a.jpg", ImageTruncated)


def test_zeroed_block_of_a_jpeg_with_restarts(quiet_stderr: None) -> None:
    plain = Pillow.fromarray(smooth_rgb())
    data = bytearray(pillow_bytes(plain, "JPEG", quality=90, restart_marker_rows=1))
    middle = len(data) // 2
    data[middle : middle + 4096] = bytes(4096)
    refusal(bytes(data), "a.jpg", ImageTruncated)


def test_lost_rows_of_a_jpeg_with_restarts(quiet_stderr: None) -> None:
    plain = Pillow.fromarray(smooth_rgb())
    data = pillow_bytes(plain, "JPEG", quality=90, restart_marker_rows=1)
    end = data.rindex(b"\xff\xd5")  # the 14th and last mark, before the 15th row
    refusal(data[:end] + b"\xff\xd9", "a.jpg", ImageTruncated)


@pytest.mark.parametrize("block", [1, 64, 512])
def test_what_libjpeg_complains_about_is_refused(
    block: int, capfd: pytest.CaptureFixture[str]
) -> None:
    data = encode_jpeg(smooth_rgb(), 90)
    start = data.index(b"\xff\xda") + 14
    rng = np.random.default_rng(block)
    refused = 0
    for place in rng.integers(start, len(data) - block - 2, 60):
        damaged = data[:place] + rng.bytes(block) + data[place + block :]
        try:
            decode_image(damaged, "a.jpg")
        except ImageTruncated:
            refused += 1
            continue
        assert capfd.readouterr().err == ""  # what is accepted, libjpeg decoded without complaint
    assert refused > 60 // 5  # a byte may change a coefficient alone; a block hardly
    assert block == 1 or refused > 60 * 4 // 5


def test_motion_jpeg_without_tables_is_left_to_the_decoder() -> None:
    data = encode_jpeg(smooth_rgb(), 90)
    while (at := data.find(b"\xff\xc4")) >= 0:
        data = data[:at] + data[at + 2 + int.from_bytes(data[at + 2 : at + 4], "big") :]
    assert decode_image(data, "a.jpg").pixels.shape == (240, 320, 3)


def test_any_flipped_bit_of_a_png_is_found(quiet_stderr: None) -> None:
    data = encode_png(RGB)
    for place in range(8, len(data), 97):
        damaged = bytearray(data)
        damaged[place] ^= 0x10
        with pytest.raises(PseudolidarError):
            decode_image(bytes(damaged), "a.png")


@pytest.mark.parametrize("extension", [".png", ".jpg", ".tiff", ".ppm", ".bmp", ".webp"])
def test_random_damage_gives_a_picture_or_our_error(extension: str) -> None:
    rng = np.random.default_rng(3)
    data = encoded(RGB, extension)
    for _ in range(60):
        damaged = np.frombuffer(data, np.uint8).copy()
        places = rng.integers(0, min(len(data), 400), 3)
        damaged[places] = rng.integers(0, 256, 3)
        try:
            pixels = decode_image(
                damaged.tobytes(), f"a{extension}", limits=Limits(pixels=10**6)
            ).pixels
        except PseudolidarError:
            continue
        assert pixels.ndim == 2 or pixels.shape[2] == 3


# --- row 5: limits -------------------------------------------------------------------------


def claims(extension: str, width: int, height: int) -> bytes:
    """A small picture whose header claims to be large."""
    data = bytearray(encoded(RGB, extension))
    match extension:
        case ".png":
            data[16:24] = struct.pack(">II", width, height)
        case ".bmp":
            data[18:26] = struct.pack("<ii", width, height)
        case ".jpg":
            at = data.index(b"\xff\xc0")
            data[at + 5 : at + 9] = struct.pack(">HH", height, width)
        case ".ppm":
            data = bytearray(b"P6\n%d %d\n255\n" % (width, height)) + data[-100:]
    return bytes(data)


@pytest.mark.parametrize("extension", [".png", ".jpg", ".ppm"])
def test_the_header_is_not_believed(extension: str, quiet_stderr: None) -> None:
    data = claims(extension, 30_000, 30_000)
    error = refusal(data, f"a{extension}", LimitError)
    assert "30000x30000" in error.got


def test_the_limit_can_be_raised_and_lowered() -> None:
    data = encode_png(RGB)
    refusal(data, "a.png", LimitError, limits=Limits(pixels=53 * 37 - 1))
    assert decode_image(data, "a.png", limits=Limits(pixels=53 * 37)).pixels.shape == RGB.shape


def test_a_huge_file_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    with path.open("wb") as file:
        os.truncate(file.fileno(), 10**9)  # sparse
    with pytest.raises(LimitError):
        read_image(path)


# --- row 7: channels -----------------------------------------------------------------------


def tiff_of(channels: int, *, extra: bool = False, bits: int = 8, sample: int = 1) -> bytes:
    """A TIFF of 4x2 pixels with any number of channels."""
    pixels = bytes(4 * 2 * channels * bits // 8)
    entries = [(256, 3, 4), (257, 3, 2), (262, 3, 1), (273, 4, 8), (277, 3, channels)]
    entries += [(258, 3, bits), (278, 3, 2), (279, 4, len(pixels)), (339, 3, sample)]
    entries += [(338, 3, 2)] if extra else []
    start = 8 + len(pixels)
    directory = b"".join(
        struct.pack("<HHIHxx" if code == 3 else "<HHII", tag, code, 1, value)
        for tag, code, value in sorted(entries)
    )
    head = struct.pack("<2sHI", b"II", 42, start)
    return head + pixels + struct.pack("<H", len(entries)) + directory + bytes(4)


@pytest.mark.parametrize("channels", [2, 4, 5])
def test_channels_without_meaning(channels: int, quiet_stderr: None) -> None:
    assert f"{channels} channels" in refusal(tiff_of(channels), "a.tif", ImageFormat).got


def test_pixels_that_are_no_8_or_16_bit_integers(quiet_stderr: None) -> None:
    refusal(tiff_of(1, bits=32, sample=3), "a.tif", ImageFormat)
    refusal(tiff_of(1, bits=32), "a.tif", ImageFormat)


def test_cmyk_jpeg() -> None:
    cmyk = Pillow.fromarray(np.dstack([RGB, GREY]), "CMYK")
    assert "4 channels" in refusal(pillow_bytes(cmyk, "JPEG"), "a.jpg", ImageFormat).got


def test_animated_webp() -> None:
    frames = [Pillow.fromarray(RGB), Pillow.fromarray(255 - RGB)]
    data = pillow_bytes(frames[0], "WebP", save_all=True, append_images=frames[1:])
    refusal(data, "a.webp", ImageFormat)


# --- row 50, threads -----------------------------------------------------------------------


@pytest.mark.parametrize("name", ["ä ö.png", "line\nbreak.png", "\U0001f697.png", "bad\udcff.png"])
def test_names_of_any_bytes(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(encode_png(RGB))
    assert np.array_equal(read_image(path).pixels, RGB)
    path.write_bytes(b"")
    with pytest.raises(ImageUnreadable) as caught:
        read_image(path)
    assert str(caught.value).isprintable()


def test_threads_decode_alike() -> None:
    data = [encode_png(np.roll(RGB, k, axis=0)) for k in range(8)]
    results: dict[int, np.ndarray] = {}

    def work(k: int) -> None:
        for _ in range(20):
            results[k] = decode_image(data[k], "a.png").pixels

    threads = [threading.Thread(target=work, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(results[k], np.roll(RGB, k, axis=0)) for k in range(8))
