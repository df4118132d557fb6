"""What is written of a frame does not depend on the threads of BLAS, and so not on the machine."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

PROGRAM = """
import hashlib
import numpy as np
from pseudolidar.clouds.ground import Label
from pseudolidar.clouds.normals import Normals
from pseudolidar.geometry.normals import _line
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose
from pseudolidar.geometry.frames import R_BODY_OPTICAL

rng = np.random.default_rng(1)
# An odd number of points: parts of an even one may be rounded alike.
v, u = np.mgrid[190:375, 0:1241].astype(np.float64)
z = 700 * 1.7 / (v - 172.9) + rng.normal(0, 0.02, v.shape)
xyz = np.stack([(u - 609.5) / 721.5 * z, (v - 172.9) / 721.5 * z, z], axis=-1)
uv = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32)
cloud = PointCloud(xyz.reshape(-1, 3).astype(np.float32), "camera_left", uv=uv)
tree = (Pose.from_rotation("velodyne", "camera_left", R_BODY_OPTICAL, np.zeros(3)),)
correction = DisparityCorrection(rng.normal(size=10), 0.1)
pixels = (700 / z.ravel(), u.ravel(), v.ravel())
lengths = (100_001, 200_003, z.size)
offsets = [correction.offset_px(*(c[:n] for c in pixels), (1242, 375)) for n in lengths]
plane, _ = Label().load().found(cloud, tree)
normals, _ = Normals().load()(cloud, tree)
results = {
    "offset": np.concatenate(offsets),
    "focal length": np.array(_line(u.ravel(), xyz[..., 0].ravel() / z.ravel())),
    "ground": np.array([*plane.normal, plane.offset_m]),
    "normals": np.stack([normals.extra[name] for name in ("nx", "ny", "nz")]),
}
for name, array in results.items():
    print(name, len(array), hashlib.sha256(array.tobytes()).hexdigest())
"""


def results(threads: int) -> str:
    env = {**os.environ, "OPENBLAS_NUM_THREADS": str(threads), "MKL_NUM_THREADS": str(threads)}
    return subprocess.run(
        [sys.executable, "-c", PROGRAM], env=env, capture_output=True, text=True, check=True
    ).stdout


def test_one_thread_and_many_give_the_same_bytes() -> None:
    one = results(1)
    assert one.count("\n") == 4
    assert results(4) == one


COMMAND = """
from pseudolidar.cli import main
main(["info", "nowhere"])
import scipy.linalg
from threadpoolctl import threadpool_info
print({each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"})
"""


TWO = min(2, os.cpu_count() or 1)


@pytest.mark.parametrize(("given", "used"), [({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, TWO)])
def test_a_command_uses_one_unless_it_is_told_else(given: dict[str, str], used: int) -> None:
    ours = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
    env = {name: value for name, value in os.environ.items() if name not in ours} | given
    done = subprocess.run(
        [sys.executable, "-c", COMMAND], env=env, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == str({used})
