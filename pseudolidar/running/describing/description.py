"""What is known about a path: plain values for programs, a table for people."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from pseudolidar.errors import printable
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.running.table import table_text

# Longest list of ids, gaps or reasons that people are shown; --json has all.
SHOWN = 5
_LONGEST_WANT = 120
# What a reading that was tried is called.
READ_AS = "as "
# Codes of a calibration in which two cameras were found, and cannot be.
UNUSABLE_RIG = ("CalibrationValue", "CalibrationUnits", "CalibrationSizeMismatch")
_MICROMETRES = 6  # decimals of metres that are shown
# Earlier times, 2001, count from the start of something.
_DATED_S = 1e9
_STEPS = ((10**9, "GB"), (10**6, "MB"), (10**3, "kB"))


@dataclass(frozen=True)
class Description:
    """What a path is.

    Args:
        path: what was asked about.
        kind: one word: of a source as `--source` takes it, or of a file.
        what: one line.
        size: bytes on the disk.
        files: how many files.
        facts: what is known, plain JSON values; see `describe.describe`.
        notes: what was assumed.
        absent: what such a thing can have and this has not.
        unknown: what could not be found out, with the reason.
    """

    path: str
    kind: str
    what: str
    size: int = 0
    files: int = 0
    facts: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    unknown: tuple[dict[str, Any], ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "path": self.path,
            "kind": self.kind,
            "what": self.what,
            "bytes": self.size,
            "files": self.files,
            **self.facts,
            "absent": list(self.absent),
            "notes": list(self.notes),
            "unknown": list(self.unknown),
        }

    def text(self) -> str:
        """The same for people."""
        rows = [("is", self.what), ("on disk", self._on_disk()), *self._rows()]
        rows += [("absent", ", ".join(self.absent))] if self.absent else []
        told = self.facts.get("damage") or ()
        rows += [("note", note) for note in self.notes if note not in told]
        rows += [("unknown", reason) for reason in self._reasons()]
        tables = [table_text([(name, printable(str(value))) for name, value in rows])]
        figures = self.facts.get("figures") or {}
        for rows_of in (
            self.facts.get("topics"),
            self.facts.get("written"),
            self.facts.get("entries"),
            figures.get("columns") or self.facts.get("columns"),
        ):
            tables += [_table(rows_of)] if rows_of else []
        return "\n".join([printable(self.path), *tables])

    def _reasons(self) -> Iterable[str]:
        """What could not be found out; of many readings that failed, only what tells something."""
        readings = [item for item in self.unknown if item["what"].startswith(READ_AS)]
        if len(readings) > 1 and not is_likely(readings[0]):
            names = ", ".join(item["what"].removeprefix(READ_AS) for item in readings)
            yield f"it cannot be read as {names} (--json says why)"
            readings = []
        yield from map(self._reason, readings[:1])
        yield from (
            self._reason(item)
            for item in self.unknown
            if item not in readings and not item["what"].startswith(READ_AS)
        )

    def _reason(self, item: dict[str, Any]) -> str:
        place = [] if item["path"] in (None, self.path) else [item["path"]]
        place += [item["where"]] if item.get("where") else []
        text = f"{item['what']}: {item['code']}: {': '.join([*place, item['got']])}"
        wanted, fix = item.get("want") or "", item.get("fix")
        text += f"; wanted {wanted}" if 0 < len(wanted) <= _LONGEST_WANT else ""
        return f"{text}. {fix}" if fix else text

    def _on_disk(self) -> str:
        if not self.files:
            return "nothing"
        return f"{bytes_text(self.size)} in {self.files} file{'s' if self.files > 1 else ''}"

    def _rows(self) -> Iterable[tuple[str, Any]]:
        for name, value in self.facts.items():
            if value is None or value in ({}, []) or name in _SAID.get(self.kind, ()):
                continue
            match value:
                case dict() if name == "figures":
                    yield from _figure_rows(value)
                case dict() if name in _ROWS:
                    yield name, _ROWS[name](value)
                case dict() if name.endswith("_box_m"):
                    yield "bounding box, m", _sides(value)
                case dict():
                    yield (
                        name.replace("_", " "),
                        ", ".join(f"{key} {_value(v)}" for key, v in value.items()),
                    )
                case [dict(), *_]:
                    continue
                case list():
                    yield _title(name), _some(value)
                case _:
                    yield _title(name), _value(value)


def likelihood(reason: dict[str, Any]) -> int:
    """How well a reader understood a file that it refused: the lines before the mistake.

    Calibrations of KITTI are texts with keys, as many others are: lines tell nothing about them.
    """
    if reason["what"] == f"{READ_AS}calibration":
        return reason["code"] in UNUSABLE_RIG
    return lines_before(reason["where"])


def lines_before(where: str) -> int:
    """Lines before the place of a mistake, as errors tell it; 0 where none is told."""
    found = re.match(r"line (\d+)", where)
    return int(found[1]) - 1 if found else 0


def is_likely(reason: dict[str, Any]) -> bool:
    """Whether a file is of the kind that it was refused as."""
    return likelihood(reason) > 0


def bytes_text(size: int) -> str:
    """A size for people."""
    for step, unit in _STEPS:
        if size >= step:
            return f"{size / step:.1f} {unit}"
    return f"{size} bytes"


def counted(count: int, things: str) -> str:
    """`3 pairs of pictures`, `1 pair of pictures`: things begin with a plural."""
    return f"{count} {_SINGULAR.sub(lambda found: found[0][:-1], things) if count == 1 else things}"


def _rig_row(rig: dict[str, Any]) -> str:
    sized = rig["width_px"] is not None
    lengths = (
        f"f {rig['f_px']:.4f} px, B {rig['baseline_m']:.5f} m, fB {rig['fB_px_m']:.3f} px m",
        f"depth at 1 px {_value(rig['depth_at_1_px_m'])} m",
    )
    if not rig["metric"]:
        lengths = (f"f {rig['f_px']:.4f} px", "scale unknown: no metres")
    parts = [
        *lengths,
        f"{rig['width_px']}x{rig['height_px']} px" if sized else "image size not stated",
    ]
    if rig["doffs_px"]:
        parts.append(f"doffs {rig['doffs_px']:.3f} px")
    parts.append("rectified" if rig["rectified"] else "not rectified")
    parts.append("with a disparity correction" if rig["corrected"] else "no disparity correction")
    if rig["rows_corrected"]:
        parts.append("with a row correction")
    return ", ".join(parts) + f"; frames: {', '.join(rig['frames'])}"


def _frames_row(frames: dict[str, Any]) -> str:
    text = counted(frames["count"], frames["yields"])
    if frames["count"] == 1:
        text += f", {frames['first']}"
    elif frames["count"]:
        text += f", {frames['first']} to {frames['last']}"
    if frames["refused"]:
        names = _some([f"{item['id']} ({item['code']})" for item in frames["refused"]])
        text += f"; {len(frames['refused'])} refused: {names}"
    return text


def _times_row(times: dict[str, Any]) -> str:
    if times["first_s"] is None:
        return "none"
    rate = "" if times["rate_hz"] is None else f" at {times['rate_hz']:.3g} Hz"
    begin = f" from {times['first']}" if times["first_s"] >= _DATED_S else ""
    if times["first_s"] == times["last_s"]:  # of one frame
        dated = times["first"] if times["first_s"] >= _DATED_S else f"{times['first_s']:.3f} s"
        return "made up" if times["synthetic"] else str(dated)
    begin = ", made up" if times["synthetic"] else begin
    text = f"{times['span_s']:.3f} s{rate}{begin}"
    if times["gaps"]:
        gaps = _some([f"{gap['seconds']:.2f} s after {gap['after']}" for gap in times["gaps"]])
        text += f"; {counted(len(times['gaps']), 'gaps')}: {gaps}"
    return text


def _run_row(run: dict[str, Any]) -> str:
    return f"{run['verb']} {run['version']} of {run['source']}"


def _pictures_row(size: dict[str, Any]) -> str:
    return f"{size['width_px']}x{size['height_px']} px"


_ROWS = {
    "rig": _rig_row, "frames": _frames_row, "times": _times_row,
    "run": _run_row, "pictures": _pictures_row,
}  # fmt: skip
# Facts that the line of their kind says already.
_SAID = {
    "picture": ("width_px", "height_px", "channels", "bits"),
    "map": ("width_px", "height_px"),
    "table": ("rows", "values_a_row"),
}
_SINGULAR = re.compile(r"^(point clouds|pairs|pictures|gaps|files|folders)")


def _figure_rows(figures: dict[str, Any]) -> Iterable[tuple[str, str]]:
    for name, value in figures.items():
        if name == "columns" or value is None:
            continue
        if name == "bounding_box_m":
            yield "bounding box, m", _sides(value)
        elif isinstance(value, dict) and set(value) == {"min", "max"}:
            yield name, f"{_value(value['min'])} to {_value(value['max'])}"
        elif isinstance(value, list) and len(value) == 2:
            yield _title(name), f"{_value(value[0])} to {_value(value[1])}"
        else:
            yield _title(name), _value(value)


def _title(name: str) -> str:
    """A name with its unit apart."""
    for unit in ("m_s", "m", "px", "deg"):
        if name.endswith(f"_{unit}"):
            return f"{_title(name.removesuffix(f'_{unit}'))}, {unit.replace('_', '/')}"
    return name.replace("_", " ").replace("kitti", "KITTI")


def _sides(box_m: dict[str, list[float]]) -> str:
    return ", ".join(
        f"{axis} {_value(round(a, _MICROMETRES) + 0.0)} to {_value(round(b, _MICROMETRES) + 0.0)}"
        for axis, (a, b) in box_m.items()
    )


def time_text(timestamp_ns: int) -> str:
    """A time as a date to the microsecond, UTC."""
    return datetime.fromtimestamp(timestamp_ns / NS_PER_S, UTC).isoformat(timespec="microseconds")


def _table(rows: list[dict[str, Any]]) -> str:
    names = [n for n in dict.fromkeys(name for row in rows for name in row) if n != "first_s"]
    cells = [[printable(_cell(name, row.get(name))) for name in names] for row in rows]
    return table_text(cells, header=[name.replace("_", " ") for name in names]).rstrip()


def _cell(name: str, value: Any) -> str:
    match name, value:
        case "bytes", int():
            return bytes_text(value)
        case "rate_hz" | "span_s", float():
            return f"{value:.4g}"
    return _value(value)


def _value(value: Any) -> str:
    match value:
        case None:
            return "-"
        case float():
            return f"{value:.6g}"
        case dict():
            return ", ".join(f"{key} {_value(v)}" for key, v in value.items())
        case list():
            return _some(value)
    return str(value)


def _some(values: list[Any]) -> str:
    more = f", ... {len(values) - SHOWN} more" if len(values) > SHOWN else ""
    return ", ".join(_value(value) for value in values[:SHOWN]) + more
