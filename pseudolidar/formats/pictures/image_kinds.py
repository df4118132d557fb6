"""What a file is by its first bytes, and whether its name says so too."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pseudolidar.errors import ImageUnreadable

# First bytes of what is read as a picture. PNM: P1-P6 and white space, checked apart.
PICTURES: Final = {
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"II*\x00": "TIFF",
    b"MM\x00*": "TIFF",
    b"II+\x00": "BigTIFF",
    b"MM\x00+": "BigTIFF",
    b"BM": "BMP",
}
# First bytes of what people have under a picture's name and that is not read, so that it is named.
OTHERS: Final = {
    b"version https://git-lfs": "Git LFS pointer (the picture itself was not downloaded)",
    b"GIF8": "GIF",
    b"\x00\x00\x00\x0cjP  ": "JPEG 2000",
    b"\xff\x4f\xff\x51": "JPEG 2000",
    b"v/1\x01": "OpenEXR",
    b"#?RADIANCE": "Radiance HDR",
    b"8BPS": "Photoshop",
    b"PK\x03\x04": "ZIP archive",
    b"\x1f\x8b": "gzip archive",
    b"%PDF": "PDF",
    b"\x93NUMPY": "NumPy array",
    b"\x89MCAP0": "MCAP recording",
    b"PF\n": "PFM",
    b"Pf\n": "PFM",
    b"ply\n": "PLY cloud",
    b"# .PCD": "PCD cloud",
}
EXTENSIONS: Final = {
    ".png": {"PNG"},
    ".jpg": {"JPEG"},
    ".jpeg": {"JPEG"},
    ".tif": {"TIFF", "BigTIFF"},
    ".tiff": {"TIFF", "BigTIFF"},
    ".pgm": {"PGM"},
    ".ppm": {"PPM"},
    ".pnm": {"PGM", "PPM"},
    ".bmp": {"BMP"},
    ".webp": {"WebP"},
}
READ = "PNG, JPEG, TIFF, PGM, PPM, BMP or WebP"
SNIFFED_BYTES = 512


def content_kind(data: bytes) -> str:
    """Name of what `data` is, by its magic bytes; "" where they tell nothing."""
    for table in (PICTURES, OTHERS):
        for magic, kind in table.items():
            if data.startswith(magic):
                return kind
    if data[:1] == b"P" and data[1:2] in b"2356" and data[2:3].isspace():
        return "PGM" if data[1:2] in b"25" else "PPM"
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "WebP"
    if data[4:8] == b"ftyp":
        return "MP4, HEIF or AVIF"
    return _text_kind(data[:SNIFFED_BYTES])


def check_kind(data: bytes, path: str | Path) -> str:
    """The kind of picture `data` is.

    Raises:
        ImageUnreadable: empty, no picture, or another kind than the name says.
    """
    if not data:
        raise ImageUnreadable("0 bytes", want=READ, fix="Copy the file again.", path=path)
    kind = content_kind(data)
    if kind not in set().union(*EXTENSIONS.values()):
        got = f"{len(data)} bytes that are {f'a {kind}' if kind else 'no known kind of file'}"
        raise ImageUnreadable(got, want=READ, fix="Copy or export the file again.", path=path)
    suffix = Path(path).suffix.lower()
    named = EXTENSIONS.get(suffix)
    if named is not None and kind not in named:
        raise ImageUnreadable(
            f"a {kind} file under the name {suffix}",
            want=" or ".join(sorted(named)),
            fix="Give the file the extension of its content.",
            path=path,
        )
    return kind


def _text_kind(start: bytes) -> str:
    if start.lstrip()[:5].lower() in (b"<!doc", b"<html"):
        return "HTML page (a failed download?)"
    try:
        text = start.decode("ascii")
    except UnicodeDecodeError:
        return ""
    printed = all(c.isprintable() or c in "\r\n\t" for c in text)
    return "text file" if printed and text else ""
