import pytest
from pseudolidar.pipelines.demo import Demo, run


@pytest.mark.slow
def test_the_demo_leaves_everything_and_names_it(tmp_path):
    report = run(Demo(tmp_path, frames=2))
    assert report.exit_code == 0
    for name in ("pcd", "ply", "depth", "disparity", "street.mcap"):
        assert (tmp_path / name).exists()
        assert str(tmp_path / name) in report.text()
    assert f"pseudolidar view {tmp_path / 'street.mcap'}" in report.text()
