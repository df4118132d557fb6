"""What the README shows works: its commands parse, its code runs, its files and targets exist."""

from __future__ import annotations

import functools
import importlib
import json
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pseudolidar import cli
from pseudolidar.commandline.verbs import RUN_VERB, verb_files
from pseudolidar.formats.points.pcd import read_pcd, write_pcd
from pseudolidar.formats.rigs.body_json import write_body
from pseudolidar.formats.rigs.rig_fields import MINIMAL_RIG
from pseudolidar.formats.rigs.rig_json import parse_rig, write_rig
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.running.settings_json import to_json
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.body import BodyRig, MountedPair
from pseudolidar.structures.pose import Pose
from tests.extract_drives import some_scan, stamps, write_pictures, write_scans
from tests.recordings import named_clouds, write_own
from tests.videos import pictures, write_video

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text("utf-8")
OWN_JOB = "near_job.py"
DRIVE = "2011_09_26/2011_09_26_drive_0001_sync"
# Folders that the README stands for, under its names.
SHOWN_DRIVE, SHOWN_EXTRACT, SHOWN_STEREO, SHOWN_PAIRS = (
    "KITTI/2011_09_26/2011_09_26_drive_0002_sync",
    "KITTI/2011_09_26/2011_09_26_drive_0002_extract",
    "KITTI/training",
    "my_pairs",
)


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


def shown(program: str) -> list[str]:
    """Lines of indented blocks that run `program`, without comments."""
    lines = re.findall(rf"^    (?:\.venv/bin/)?{program} (.*)$", README, flags=re.MULTILINE)
    return [line.split("#")[0].strip() for line in lines]


class Answer:
    exit_code = 0

    def as_dict(self) -> dict[str, Any]:
        return {}

    def text(self) -> str:
        return ""


@pytest.fixture(scope="module")
def shown_folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that has all inputs that the README names, small."""
    folder = tmp_path_factory.mktemp("readme")
    for layout in ("raw", "stereo"):
        args = ["synth", str(folder / layout), "--layout", layout, "--frames", "2"]
        assert cli.main([*args, "--width-px", "256", "--height-px", "96"]) == 0
    (folder / SHOWN_DRIVE).parent.parent.mkdir(parents=True)
    drive = next(folder.glob("raw/*/*_sync"))
    drive.parent.rename((folder / SHOWN_DRIVE).parent)
    (folder / SHOWN_DRIVE).parent.joinpath(drive.name).rename(folder / SHOWN_DRIVE)
    for camera in (0, 1):
        dark = [np.zeros((96, 256), np.uint8)]
        write_pictures(folder / SHOWN_EXTRACT, camera, dark, stamps(1))
    write_scans(folder / SHOWN_EXTRACT, [some_scan()])
    (folder / "stereo/training").rename(folder / SHOWN_STEREO)
    (folder / "out").mkdir()
    (folder / "out/kitti").symlink_to(folder / "KITTI")
    picture = np.zeros((96, 256), np.uint8)
    for eye in ("left", "right"):
        (folder / SHOWN_PAIRS / eye).mkdir(parents=True)
        cv2.imwrite(str(folder / SHOWN_PAIRS / eye / "0.png"), picture)
    rig = Synthetic("street", width_px=256, height_px=96).open().rig
    write_rig(folder / SHOWN_PAIRS / "rig.json", rig)
    for maps in ("EST", "GT"):
        (folder / maps).mkdir()
        cv2.imwrite(str(folder / maps / "0.png"), picture.astype(np.uint16))
    for recording in ("drive.mcap", "out/street/street.mcap"):
        (folder / recording).parent.mkdir(parents=True, exist_ok=True)
        write_own(folder / recording, named_clouds(["a"]))
    (folder / "drone").mkdir()
    for pair in written_body(folder / "drone"):
        shutil.copytree(folder / SHOWN_PAIRS, folder / "drone" / pair)
    (folder / "out/points/pcd").mkdir(parents=True)
    write_pcd(folder / "out/points/pcd/0.pcd", named_clouds(["a"])[0].cloud)
    write_rig(folder / "rig.json", rig)
    for name, width_px in (("left.mp4", 256), ("right.mp4", 256), ("side_by_side.mkv", 512)):
        write_video(folder / name, pictures(2, width_px, 96))
    for trajectory in ("orb.txt", "truth.txt"):
        (folder / trajectory).write_text("1 0 0 5 0 0 0 1\n2 0 0 6 0 0 0 1\n")
    (folder / OWN_JOB).write_text(blocks("python")[0])
    return folder


def written_body(folder: Path) -> tuple[str, ...]:
    """Names of the pairs of a rig file that is written into `folder`."""
    rig = Synthetic("street", width_px=256, height_px=96).open().rig
    place = Pose.from_rotation("base_link", "camera_left", R_BODY_OPTICAL, np.zeros(3))
    pairs = [MountedPair(name, rig, place) for name in ("front", "left")]
    write_body(folder / "rig.json", BodyRig(tuple(pairs)))
    return tuple(pair.name for pair in pairs)


@pytest.fixture
def received(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Settings that verbs got; none of them does its work."""
    settings: list[object] = []

    def instead_of(run: Callable[[Any], Any]) -> Callable[[Any], Answer]:
        @functools.wraps(run)
        def receive(job: object) -> Answer:
            settings.append(job)
            return Answer()

        return receive

    for file in verb_files().values():
        module = importlib.import_module(f"pseudolidar.pipelines.{file.stem}")
        monkeypatch.setattr(module, "run", instead_of(module.run))
    return settings


def test_every_verb_has_its_commands():
    verbs = {line.split()[0] for line in shown("pseudolidar")}
    assert verbs == {*verb_files(), RUN_VERB}


@pytest.mark.parametrize(
    "line", sorted({line for line in shown("pseudolidar") if not line.startswith(RUN_VERB)})
)
def test_a_command_is_understood(line, shown_folders, received, monkeypatch, capsys):
    monkeypatch.chdir(shown_folders)
    assert cli.main(shlex.split(line)) == 0, capsys.readouterr().err
    assert len(received) == 1


def test_a_run_is_repeated_from_its_settings(shown_folders, received, monkeypatch):
    monkeypatch.chdir(shown_folders)
    first = next(line for line in shown("pseudolidar") if line.startswith("convert"))
    flag, file = re.search(r"`(--settings) (\S+)`", README).groups()
    assert cli.main(shlex.split(first)) == 0
    Path(file).parent.mkdir(exist_ok=True)
    Path(file).write_text(json.dumps({"settings": to_json(received[0])}))
    assert cli.main(["convert", flag, file]) == 0
    assert to_json(received[1]) == to_json(received[0])


def test_the_pipeline_of_ones_own_runs(shown_folders, monkeypatch, capsys):
    monkeypatch.chdir(shown_folders)
    (line,) = (line for line in shown("pseudolidar") if line.startswith(RUN_VERB))
    args = shlex.split(line)
    assert args[1] == OWN_JOB
    small = ["--source.width-px", "256", "--source.height-px", "96", "--matcher.disparities", "32"]
    assert cli.main([*args, *small]) == 0, capsys.readouterr().err
    assert re.fullmatch(r"(00000[012]  [0-9.]+ m\n){3}", capsys.readouterr().out)


def test_the_example_in_python_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    job, *examples = blocks("python")
    example = "\n".join(examples)  # the second one goes on with the first
    assert job.startswith('"""How near')
    exec(compile(example, "README.md", "exec"), {"__name__": "readme"})
    said, *steps = re.findall(r"^(\w+ .*?)$", capsys.readouterr().out, flags=re.MULTILINE)
    points, frame, *_ = said.split()
    assert frame == "camera_left"
    assert [step.split()[0] for step in steps] == ["first", "ok", "ok"]
    kept = len(read_pcd(tmp_path / "street.pcd"))
    assert 0 < kept < int(points)


def test_the_rig_is_the_least_that_is_needed():
    (rig,) = blocks("json")
    assert json.loads(rig) == json.loads(MINIMAL_RIG)
    assert parse_rig(rig, "README.md").baseline_m == pytest.approx(0.54)


def test_make_has_every_target_that_is_shown():
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    assert {line.split()[0] for line in shown("make")} <= set(targets)


def test_links_lead_to_files_and_headings():
    headings = re.findall(r"^#+ (.*)$", README, flags=re.MULTILINE)
    anchors = {re.sub(r"[^a-z0-9 -]", "", text.lower()).replace(" ", "-") for text in headings}
    links = re.findall(r"\]\(([^)]+)\)", README)
    assert links
    for link in links:
        assert link[1:] in anchors if link.startswith("#") else (ROOT / link).exists(), link
