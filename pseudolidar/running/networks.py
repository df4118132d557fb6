"""The networks that a run uses, as they describe themselves: for `run.json` and the journal."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from pseudolidar.obstacles.onnx_detector import NetworkDetector
from pseudolidar.stereo.neural import NetworkMatcher

# What is found out about a network, by files beside it too, and decides about its answers. What
# kind of file it was does not: its content is in the settings.
DECIDES = ("layout", "input", "classes", "provider")


def networks_of(part: object) -> dict[str, dict[str, Any]]:
    """Every network among the parts of what does a frame, by what it is for, plain JSON values.

    Args:
        part: loaded, such as `ConvertFrame`; parts are fields of dataclasses, and members of tuples
            and mappings in these.
    """
    return {name: network.describe() for name, network in _by_name(part).items()}


def with_times(
    networks: Mapping[str, Mapping[str, Any]], part: object
) -> dict[str, dict[str, Any]]:
    """Networks with the time that each frame has taken them so far.

    Args:
        networks: as `networks_of` tells those of `part`.
        part: the same loaded part, after it has seen frames.

    Returns:
        The same with `median_ms` for detectors that ran in this process; matchers are not timed.
    """
    told = {name: dict(network) for name, network in networks.items()}
    for name, network in _by_name(part).items():
        if isinstance(network, NetworkDetector) and network.median_ms is not None:
            told[name]["median_ms"] = round(network.median_ms, 2)
    return told


def timed(networks: Mapping[str, Mapping[str, Any]], part: object) -> dict[str, Any]:
    """`with_times` as figures of a run, `{"networks": ...}`; empty where there are no networks."""
    return {"networks": with_times(networks, part)} if networks else {}


def times_in_words(networks: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """A line for each network whose time is known, as `with_times` tells it."""
    return [
        f"network of the {name}: {network['median_ms']:.1f} ms a frame on {network['provider']}, "
        "median of its own time"
        for name, network in networks.items()
        if "median_ms" in network
    ]


def deciding(networks: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """What of `networks_of` decides about a byte of the results: no name, no place."""
    return {
        name: {key: network[key] for key in DECIDES if key in network}
        for name, network in networks.items()
    }


def _by_name(part: object) -> dict[str, NetworkDetector | NetworkMatcher]:
    """The networks of a part by what they are for: `detector`, `matcher`, `detector 2`."""
    named: dict[str, NetworkDetector | NetworkMatcher] = {}
    for network in _found(part, set()):
        kind = "detector" if isinstance(network, NetworkDetector) else "matcher"
        same = sum(name.split()[0] == kind for name in named)
        named[f"{kind} {same + 1}" if same else kind] = network
    return named


def _found(part: object, seen: set[int]) -> Iterator[NetworkDetector | NetworkMatcher]:
    if id(part) in seen:
        return
    seen.add(id(part))
    if isinstance(part, NetworkDetector | NetworkMatcher):
        yield part
    elif dataclasses.is_dataclass(part) and not isinstance(part, type):
        for field in dataclasses.fields(part):
            yield from _found(getattr(part, field.name, None), seen)
    elif isinstance(part, tuple | Mapping):
        for one in part.values() if isinstance(part, Mapping) else part:
            yield from _found(one, seen)
