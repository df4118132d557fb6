"""Pictures: bytes to RGB or grey arrays and back, checked before the decoder sees them.

OpenCV decodes. It returns None for many broken files, invents the lower part of a cut JPEG, and
turns 16 bits into 8 by default; hence the checks here.
"""

from __future__ import annotations

import bisect
import difflib
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from pseudolidar.errors import (
    ImageFormat,
    ImageMissing,
    ImageUnreadable,
    LimitError,
    PseudolidarError,
    StructureError,
)
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits, raise_cap
from pseudolidar.formats.pictures.image_header import (
    ImageHeader,
    bmp_header,
    check_png,
    check_pnm,
    png_header,
    pnm_header,
    webp_header,
)
from pseudolidar.formats.pictures.image_kinds import check_kind
from pseudolidar.formats.pictures.jpeg_structure import check_jpeg, jpeg_header
from pseudolidar.formats.pictures.tiff_header import tiff_header
from pseudolidar.formats.whole_read import read_whole
from pseudolidar.structures.arrays import AnyArray, Image

# Names beside a missing one that are compared with it; a folder may hold 100 000.
COMPARED_NAMES = 100
# Bytes of a pixel that a file can have at most: 4 channels of 16 bits; more is not believed.
LARGEST_PIXEL_BYTES = 8


@dataclass(frozen=True, eq=False)
class DecodedImage:
    """A decoded picture.

    Args:
        pixels: (H, W) grey or (H, W, 3) RGB; uint8, or uint16 with the values of the file.
        notes: what was left out or is odd ("alpha channel dropped").
    """

    pixels: Image
    notes: tuple[str, ...] = ()


def read_image(path: str | Path, *, limits: Limits = DEFAULT_LIMITS) -> DecodedImage:
    """Read a PNG, JPEG, TIFF, PGM, PPM, BMP or WebP.

    Raises:
        ImageMissing: no such file; names the nearest one.
        ImageUnreadable: empty, no picture, a name that contradicts the content, damaged.
        ImageTruncated: the file ends early.
        ImageFormat: a pixel layout without meaning here.
        LimitError: the header claims more pixels than `limits.pixels`.
    """
    path = Path(path)
    return decode_image(_read_bytes(path, limits), path, limits=limits)


def read_size(path: str | Path, *, limits: Limits = DEFAULT_LIMITS) -> tuple[int, int]:
    """(width, height) of a picture by its header; its pixels are not decoded. Raises as above."""
    header = read_header(path, limits=limits)
    return header.width_px, header.height_px


def read_header(path: str | Path, *, limits: Limits = DEFAULT_LIMITS) -> ImageHeader:
    """The header of a whole picture; its pixels are not decoded. Raises as above."""
    path = Path(path)
    data = _read_bytes(path, limits)
    try:
        return _checked_header(data, check_kind(data, path), limits)
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__


def decode_image(data: bytes, path: str | Path, *, limits: Limits = DEFAULT_LIMITS) -> DecodedImage:
    """Decode the bytes of a picture; `path` names it in errors. Releases the GIL.

    The header is parsed and the file checked for completeness before anything is decoded. 16-bit
    pictures keep their 16 bits and values. A rotation in the Exif data is ignored: pixels belong
    to the sensor.

    Raises:
        ImageUnreadable, ImageTruncated, ImageFormat, LimitError: see `read_image`.
    """
    try:
        header = _checked_header(data, check_kind(data, path), limits)
        pixels = _decode(data, header)
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__
    dropped = ("alpha channel dropped",) if header.alpha else ()
    return DecodedImage(pixels, dropped + header.notes)


def encode_png(pixels: Image, level: int = 1) -> bytes:
    """PNG of (H, W) or (H, W, 3) RGB pixels, uint8 or uint16; zlib `level` 0-9."""
    import cv2

    return _encode(pixels, ".png", [cv2.IMWRITE_PNG_COMPRESSION, level])


def encode_jpeg(pixels: Image, quality: int = 90) -> bytes:
    """JPEG of (H, W) or (H, W, 3) RGB uint8 pixels; `quality` 0-100.

    Raises:
        StructureError: 16-bit pixels, which a JPEG cannot hold.
    """
    import cv2

    if pixels.dtype != np.uint8:
        raise StructureError(f"{pixels.dtype} pixels", want="uint8", where="encode_jpeg")
    return _encode(pixels, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, quality])


def _read_bytes(path: Path, limits: Limits) -> bytes:
    try:
        size = path.stat().st_size
        if size > limits.pixels * LARGEST_PIXEL_BYTES:
            raise _too_large(f"a file of {size} bytes", limits).located(path)
        return read_whole(path)
    except FileNotFoundError:
        raise _missing(path) from None
    except OSError as error:
        raise ImageUnreadable(
            error.strerror or str(error), want="a readable file", path=path
        ) from error


def _checked_header(data: bytes, kind: str, limits: Limits) -> ImageHeader:
    """The header, after all that can be checked without decoding."""
    start = 0
    match kind:
        case "PNG":
            header = png_header(data)
        case "JPEG":
            header = jpeg_header(data)
        case "PGM" | "PPM":
            header, start = pnm_header(data)
        case "BMP":
            header = bmp_header(data)
        case "WebP":
            header = webp_header(data)
        case _:
            header = tiff_header(data)
    _check_layout(header, limits)
    match kind:
        case "PNG":
            check_png(data)
        case "JPEG":
            check_jpeg(data)
        case "PGM" | "PPM":
            check_pnm(data, header, start)
    return header


def _check_layout(header: ImageHeader, limits: Limits) -> None:
    size = f"{header.width_px}x{header.height_px} pixels"
    if header.width_px < 1 or header.height_px < 1:
        raise ImageUnreadable(f"a picture of {size}", want="at least one pixel")
    if header.width_px * header.height_px > limits.pixels:
        raise _too_large(f"a header that claims {size}", limits)
    if header.channels - header.alpha not in (1, 3):
        raise ImageFormat(
            f"{header.channels} channels" + (" without alpha" if header.channels == 4 else ""),
            want="grey or RGB, with or without alpha",
            fix="Export it as grey or RGB.",
        )
    if header.bits > 16:
        raise ImageFormat(f"{header.bits} bits a channel", want="8 or 16")


def _decode(data: bytes, header: ImageHeader) -> Image:
    import cv2

    # IMREAD_COLOR_RGB is left out: in OpenCV 5.0 it garbles 16-bit TIFF.
    flags = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise ImageUnreadable(
            f"the decoder refused it: {error.err}",
            want="a picture without damage",
            fix="Export it again.",
        ) from error
    pixels = cast("Image | None", decoded)
    if pixels is None:
        raise ImageUnreadable(
            "damaged image data", want="an undamaged file", fix="Copy the file again."
        )
    if pixels.shape[:2] != (header.height_px, header.width_px) or pixels.dtype.type not in (
        np.uint8,
        np.uint16,
    ):
        raise ImageUnreadable(
            f"decoded to {pixels.dtype} of shape {pixels.shape}",
            want=f"{header.width_px}x{header.height_px} pixels as the header says",
        )
    if pixels.ndim == 2:
        return pixels
    if header.is_grey:
        return cast("Image", np.ascontiguousarray(pixels[:, :, 0]))
    return cast("Image", cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB))


def _encode(pixels: Image, extension: str, settings: list[int]) -> bytes:
    import cv2

    bgr: AnyArray = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
    done, buffer = cv2.imencode(extension, bgr, settings)
    if not done:
        raise StructureError(f"{pixels.dtype} pixels of shape {pixels.shape}", where="encode")
    return buffer.tobytes()


def _too_large(got: str, limits: Limits) -> LimitError:
    return LimitError(
        got,
        want=f"at most {limits.pixels} pixels",
        fix=raise_cap("pixels"),
    )


def _missing(path: Path) -> ImageMissing:
    folder = path.parent
    try:
        names = sorted(file.name for file in folder.iterdir())
    except OSError:
        return ImageMissing(
            "its folder is not there", want="an image", fix="Check the path.", path=path
        )
    at = bisect.bisect(names, path.name)
    near = names[max(0, at - COMPARED_NAMES) : at + COMPARED_NAMES]
    found = difflib.get_close_matches(path.name, near, n=1)
    fix = f"The nearest name there is {found[0]!r}." if found else "No name there is like it."
    return ImageMissing("no such file", want="an image", fix=fix, path=path)
