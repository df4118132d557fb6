"""Which picture belongs to which: by name or by time, never by position."""

from __future__ import annotations

import bisect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.errors import ImageMissing, PairMismatch, PseudolidarError
from pseudolidar.sources.names import natural_key, safe_id, stamp_unit_ns, time_of_name_ns

SEPARATORS = "_-. "


@dataclass(frozen=True)
class EyeRule:
    """How the name of a left picture differs from that of the right one.

    Args:
        text: the rule in words.
        left: what only names of the left eye contain; None where names are equal.
        right: what only names of the right eye contain.
    """

    text: str
    left: re.Pattern[str] | None = None
    right: re.Pattern[str] | None = None

    def keys(self, files: Iterable[Path], eye: str) -> list[tuple[str, Path]]:
        """Files of one eye, each with what its name shares with the other eye's."""
        mark = self.left if eye == "left" else self.right
        named = ((_without(mark, file.stem), file) for file in files)
        return [(key, file) for key, file in named if key is not None]


def _rule(text: str, left: str, right: str) -> EyeRule:
    return EyeRule(text, re.compile(left, re.IGNORECASE), re.compile(right, re.IGNORECASE))


SAME_NAME = EyeRule("equal names")
WORDS = _rule("'left' and 'right' in the names", "left", "right")
LETTERS = _rule("'l' and 'r' in the names", "(?<![a-z])l(?![a-z])", "(?<![a-z])r(?![a-z])")
_CAMERA = "(?<![a-z])(?:im|img|cam|view)[_-]?"
NUMBERED = _rule("'im0' and 'im1' in the names", f"{_CAMERA}0(?![0-9])", f"{_CAMERA}1(?![0-9])")
# A third number says that these are frames, or views of an array, and not two eyes.
FURTHER_NUMBER = re.compile(f"{_CAMERA}0*[2-9](?![0-9])", re.IGNORECASE)
FOLDER_NUMBERS = tuple(
    _rule(f"'{a}' and '{b}' in the folders' names", f"(?<![0-9])0*{a}$", f"(?<![0-9])0*{b}$")
    for a, b in ((0, 1), (2, 3))
)


def pattern_rule(left: str, right: str) -> EyeRule:
    """Rule from two file patterns, each with one `*` that stands for what is equal in both."""
    return EyeRule(f"patterns {left!r} and {right!r}", _glob(left), _glob(right))


@dataclass(frozen=True)
class PicturePair:
    """Two pictures of one moment.

    Args:
        key: what their names share.
        left: picture of the left camera.
        right: picture of the right camera.
        time_ns: time that the left name states, or None.
    """

    key: str
    left: Path
    right: Path
    time_ns: int | None = None


@dataclass(frozen=True)
class Pairing:
    """What a rule makes of the pictures.

    Args:
        pairs: in numeric order of their names, or in order of time.
        unpaired: frame ids that cannot be used, with the reason.
        left_keys: keys of all pictures of the left eye, paired or not, in order.
        rule: how they were paired, in words.
        notes: what was odd.
    """

    pairs: tuple[PicturePair, ...]
    unpaired: tuple[tuple[str, PseudolidarError], ...]
    left_keys: tuple[str, ...]
    rule: str
    notes: tuple[str, ...] = ()


def pair_pictures(
    left: Iterable[Path], right: Iterable[Path], rule: EyeRule, *, tolerance_s: float
) -> Pairing:
    """Pair pictures of two eyes by what `rule` leaves of their names, or by the times they state.

    Args:
        left: pictures among which those of the left eye are.
        right: pictures among which those of the right eye are; may be the same ones.
        rule: what tells the eyes apart.
        tolerance_s: names that are times are paired up to this difference.
    """
    lefts, twice_left = _unique(rule.keys(left, "left"))
    rights, twice_right = _unique(rule.keys(right, "right"))
    unit_ns = stamp_unit_ns([*lefts, *rights])
    if unit_ns is None:
        partner = {key: key for key in lefts if key in rights}
        order: Callable[[str], object] = natural_key
    else:
        tolerance_ns = round(tolerance_s * 1e9)
        partner = _nearest_times(lefts, rights, unit_ns, tolerance_ns)
        order = lambda key: time_of_name_ns(key, unit_ns)  # noqa: E731 -- one of two orders
    keys = sorted(lefts, key=order)  # type: ignore[arg-type]
    pairs = tuple(
        PicturePair(
            key,
            lefts[key],
            rights[partner[key]],
            None if unit_ns is None else time_of_name_ns(key, unit_ns),
        )
        for key in keys
        if key in partner
    )
    used = set(partner.values())
    alone = [(key, _alone(lefts[key], "right")) for key in keys if key not in partner]
    alone += [(key, _alone(rights[key], "left")) for key in rights if key not in used]
    refused = sorted([*alone, *twice_left, *twice_right], key=lambda item: natural_key(item[0]))
    by = rule.text if unit_ns is None else f"{rule.text}, times within {tolerance_s * 1e3:g} ms"
    return Pairing(
        pairs, tuple((safe_id(k), e) for k, e in refused), tuple(keys), by, _widths(keys)
    )


def _without(mark: re.Pattern[str] | None, stem: str) -> str | None:
    """The stem without the eye's mark; None if it has none."""
    if mark is None:
        return stem
    match = mark.search(stem)
    if match is None:
        return None
    if match.groups():
        return match[1]
    before, after = stem[: match.start()], stem[match.end() :]
    head, tail = before.rstrip(SEPARATORS), after.lstrip(SEPARATORS)
    joined = head and tail and (head != before or tail != after)
    return f"{head}_{tail}" if joined else head + tail


def _glob(pattern: str) -> re.Pattern[str]:
    stem = Path(pattern).stem if Path(pattern).suffix else Path(pattern).name
    before, _, after = stem.partition("*")
    return re.compile(f"{re.escape(before)}(.*){re.escape(after)}\\Z", re.DOTALL)


def _unique(
    keyed: Sequence[tuple[str, Path]],
) -> tuple[dict[str, Path], list[tuple[str, PseudolidarError]]]:
    """Files by key, and the keys that two files claim."""
    files: dict[str, Path] = {}
    twice: dict[str, PseudolidarError] = {}
    for key, file in keyed:
        if key in files:
            twice[key] = PairMismatch(
                f"{file.name!r} and {files[key].name!r} are pictures of the same eye and moment",
                want="one of them",
                fix="Remove the one that is not meant.",
                path=file,
            )
        files[key] = file
    return {key: file for key, file in files.items() if key not in twice}, list(twice.items())


def _nearest_times(
    lefts: Mapping[str, Path], rights: Mapping[str, Path], unit_ns: int, tolerance_ns: int
) -> dict[str, str]:
    """For each left name the right one that is nearest in time, if each is the other's nearest."""
    left = sorted((time_of_name_ns(key, unit_ns), key) for key in lefts)
    right = sorted((time_of_name_ns(key, unit_ns), key) for key in rights)
    partner = {}
    for time_ns, key in left:
        found = _nearest(right, time_ns)
        if found is None or abs(found[0] - time_ns) > tolerance_ns:
            continue
        back = _nearest(left, found[0])
        if back is not None and back[1] == key:
            partner[key] = found[1]
    return partner


def _nearest(times: Sequence[tuple[int, str]], time_ns: int) -> tuple[int, str] | None:
    at = bisect.bisect(times, (time_ns, ""))
    return min(times[max(0, at - 1) : at + 1], key=lambda t: abs(t[0] - time_ns), default=None)


def _alone(file: Path, other: str) -> ImageMissing:
    return ImageMissing(f"no {other} picture belongs to it", want="both eyes", path=file)


def _widths(keys: Sequence[str]) -> tuple[str, ...]:
    """A note where numbers are written with different widths although some have leading zeros."""
    numbers = [match[0] for key in keys if (match := re.search(r"[0-9]+(?=[^0-9]*\Z)", key))]
    widths = {len(number) for number in numbers}
    padded = any(number != "0" and number.startswith("0") for number in numbers)
    if len(widths) < 2:
        return ()
    shown = " and ".join(str(width) for width in sorted(widths)[:2])
    odd = ", some with leading zeros: check that no frame is there twice" if padded else ""
    return (f"numbers in the names have {shown} digits; ordered by value{odd}",)
