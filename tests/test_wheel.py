"""The wheel as a user gets it: made from the sdist, installed and used outside the checkout."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

import pseudolidar
from pseudolidar.commandline.verbs import verb_files
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.running.installation.part_trials import trial_frame

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT_S = 300


def checked(*command: str | Path, cwd: Path) -> str:
    """Standard output of a command that must succeed, without the checkout on its path."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    ended = subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the sdist and the wheel made from it."""
    folder = tmp_path_factory.mktemp("built")
    checked(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT, cwd=folder)
    return folder


@pytest.fixture(scope="module")
def installed(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A venv with the wheel alone, which sees the libraries of the test environment."""
    venv = tmp_path_factory.mktemp("elsewhere") / "venv"
    checked(sys.executable, "-m", "venv", "--without-pip", venv, cwd=built)
    python = venv / "bin" / "python"
    site = Path(
        checked(
            python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=built
        ).strip()
    )
    libraries = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    (site / "libraries_of_the_tests.pth").write_text("\n".join(libraries) + "\n")
    wheel = next(built.glob("*.whl"))
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--no-index", "--no-deps"]
    checked(*pip, wheel, cwd=built)
    lend_kernels(site / "pseudolidar")
    return venv


def lend_kernels(package: Path) -> None:
    """Give an installed package the compiled kernels of the checkout, which costs a minute less.

    They are those of the very same files, bytes and times (which numba asks for): what the checkout
    has not compiled, or has changed, is compiled there. `make wheel-check` lends none.
    """
    ours = Path(pseudolidar.__file__).parent
    for index in ours.rglob("__pycache__/*.nbi"):
        source = index.parent.parent / f"{index.name.partition('.')[0]}.py"
        lent = package / source.relative_to(ours)
        if not source.exists() or lent.read_bytes() != source.read_bytes():
            continue
        os.utime(lent, ns=(source.stat().st_atime_ns, source.stat().st_mtime_ns))
        (lent.parent / "__pycache__").mkdir(exist_ok=True)
        for file in (index, *index.parent.glob(f"{index.stem}.*.nbc")):
            shutil.copy(file, lent.parent / "__pycache__")


def write_pair(folder: Path) -> None:
    """A folder source of one small pair."""
    frame = trial_frame()
    for side, picture in (("left", frame.left), ("right", frame.right)):
        write_atomic(folder / side / "000000.png", encode_png(picture))
    write_rig(folder / "rig.json", frame.rig)


def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_the_sdist_holds_the_pipelines_and_makes_the_same_wheel(
    built: Path, tmp_path: Path
) -> None:
    with tarfile.open(next(built.glob("*.tar.gz"))) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    pipelines = {f"pipelines/{file.name}" for file in verb_files().values()}
    assert pipelines <= names
    build = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", tmp_path]
    checked(*build, ROOT, cwd=tmp_path)
    from_sdist = contents(next(built.glob("*.whl")))
    assert contents(next(tmp_path.glob("*.whl"))) == from_sdist
    assert {f"pseudolidar/{name}" for name in pipelines} <= set(from_sdist)
    assert {"pseudolidar/py.typed", "pseudolidar/formats/rigs/rig.schema.json",
            "pseudolidar/formats/obstacle.schema.json"} <= set(from_sdist)  # fmt: skip


def test_the_wheel_has_the_files_of_the_checkout(built: Path) -> None:
    held = contents(next(built.glob("*.whl")))
    for folder, within in ((ROOT / "pseudolidar", "pseudolidar"),
                           (ROOT / "pipelines", "pseudolidar/pipelines")):  # fmt: skip
        files = sorted(folder.rglob("*.py"))
        assert len(files) > 5
        for file in files:
            name = f"{within}/{file.relative_to(folder).as_posix()}"
            assert held[name] == file.read_bytes(), name


def test_pipelines_are_imported_from_the_wheel(installed: Path, tmp_path: Path) -> None:
    code = "import pseudolidar.pipelines.convert as c; print(c.__name__, c.__file__)"
    name, file = checked(installed / "bin" / "python", "-c", code, cwd=tmp_path).split()
    assert name == "pseudolidar.pipelines.convert"
    assert Path(file).resolve().is_relative_to(installed.resolve())


def test_the_command_lists_the_verbs(installed: Path, tmp_path: Path) -> None:
    text = checked(installed / "bin" / "pseudolidar", "--help", cwd=tmp_path)
    for verb in verb_files():
        assert f"  {verb} " in text


def test_doctor_and_a_conversion_work_outside_the_checkout(installed: Path, tmp_path: Path) -> None:
    command = installed / "bin" / "pseudolidar"
    report = json.loads(checked(command, "doctor", "--json", cwd=tmp_path))
    assert report["core_works"]
    write_pair(tmp_path / "pair")
    result = json.loads(
        checked(command, "convert", "pair", "out", "--to=pcd,mcap", "--json", cwd=tmp_path)
    )
    assert (result["committed"], result["exit_code"]) == (1, 0)
    assert len(read_pcd(next((tmp_path / "out" / "pcd").glob("*.pcd")))) > 1000
    assert len(list((tmp_path / "out").glob("*.mcap"))) == 1
