"""Networks as matchers: sizes, evidence, threads, and files that must not be run."""

from __future__ import annotations

import json
import logging
import pickle
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import onnx
import pytest

from pseudolidar.errors import MissingDependency, ModelError, ModelOutput, StereoConfig
from pseudolidar.stereo.networks.evidence import with_evidence
from pseudolidar.stereo.networks.layout import NetworkLayout
from pseudolidar.stereo.networks.scene import probe_scene
from pseudolidar.stereo.networks.sizes import tiled
from pseudolidar.stereo.neural import Onnx
from pseudolidar.structures.image_size import ImageSize
from tests.stereo import graphs
from tests.stereo.pairs import frame

LAYOUT = NetworkLayout(
    inputs="left,right",
    normalisation="unit",
    channels="rgb",
    output="c",
    sign="positive",
    unit="pixel",
    scale=1.0,
)
NAMES = {"names": ("a", "b"), "output": "c", "normalisation": "unit"}


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PSEUDOLIDAR_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache" / "networks"


@pytest.fixture(scope="module")
def scene():
    return probe_scene(300, 150, seed=5)


@pytest.fixture(scope="module")
def free(tmp_path_factory):
    """A network of free size; its layout is given, so that nothing needs to be found out."""
    return graphs.two_images(tmp_path_factory.mktemp("n") / "n.onnx", disparities=28, **NAMES)


def matched(scene, path, **settings):
    settings = {"layout": LAYOUT, **settings}
    return Onnx(path, **settings).load()(frame(scene.left, scene.right))


def judged(scene, disparity):
    """Share of wrong pixels among the visible ones with a disparity, and their share."""
    known = disparity.valid & scene.visible
    error = np.abs(disparity.values - scene.truth)[known]
    return float((error > 1.5).mean()), known.sum() / scene.visible.sum()


def test_a_picture_of_any_size_is_padded_and_cropped(scene, tmp_path):
    path = graphs.two_images(tmp_path / "n.onnx", disparities=28, multiple=64, **NAMES)
    disparity = matched(scene, path)
    wrong, density = judged(scene, disparity)
    assert disparity.values.shape == (150, 300)
    assert wrong < 0.06
    assert density > 0.9


def test_a_network_of_one_size_gets_it_and_the_disparity_grows_with_the_width(scene, tmp_path):
    path = graphs.two_images(tmp_path / "n.onnx", disparities=28, size=(240, 160), **NAMES)
    wrong, density = judged(scene, matched(scene, path))
    assert wrong < 0.08
    assert density > 0.9


def test_size_brings_pictures_to_another_size(scene, free):
    wrong, _density = judged(scene, matched(scene, free, size=ImageSize(256, 160)))
    assert wrong < 0.08


def test_tiles_give_what_the_whole_gives(scene, free):
    whole = matched(scene, free)
    parts = matched(scene, free, tile=ImageSize(256, 96))
    both = whole.valid & parts.valid
    assert both.mean() > 0.97 * whole.valid.mean()
    # Whole and tile are padded by different rows and columns at the border of the picture.
    off = np.abs(whole.values - parts.values)[12:, :-12][both[12:, :-12]]
    assert np.quantile(off, 0.99) < 0.05
    assert off.max() < 1.0


def test_tiles_that_disagree_at_their_seam_know_nothing_there():
    calls = []

    def run(left, _right):
        calls.append(left.shape)
        return np.full(left.shape[:2], 10.0 * len(calls), np.float32)

    blank = np.zeros((64, 400, 3), np.uint8)
    found = tiled(run, blank, blank, ImageSize(260, 64), range_px=32)
    assert len(calls) > 1
    seam = np.isnan(found[0])
    assert 0 < seam.sum() < 200
    assert set(np.unique(found[0][~seam])) <= {10.0, 20.0, 30.0}


def test_tiles_narrower_than_the_range_are_refused(scene, free):
    with pytest.raises(StereoConfig, match="tiles 64 px wide"):
        matched(scene, free, tile=ImageSize(64, 64))
    with pytest.raises(StereoConfig, match="both a size and tiles"):
        Onnx(free, tile=ImageSize(64, 64), size=ImageSize(64, 64))


def test_hidden_pixels_and_the_left_border_get_no_disparity(scene, free):
    single, double = matched(scene, free), matched(scene, free, consistency=True)
    hidden = ~scene.visible
    assert (single.valid & hidden).sum() < 0.75 * hidden.sum()
    assert (double.valid & hidden).sum() < 0.25 * hidden.sum()
    columns = np.arange(300)
    assert not (columns - single.values < 0).any()
    wrong_single, _ = judged(scene, single)
    wrong_double, density = judged(scene, double)
    assert wrong_double < 0.6 * wrong_single
    assert density > 0.85


def test_sigma_tells_the_wrong_pixels_from_the_right_ones(scene, free):
    for settings in ({}, {"consistency": True}):
        disparity = matched(scene, free, **settings)
        known = disparity.valid & scene.visible
        error = np.abs(disparity.values - scene.truth)[known]
        sigma = disparity.sigma[known]
        assert np.isnan(disparity.sigma[~disparity.valid]).all()
        sure = sigma <= np.median(sigma)
        assert error[sure].mean() < 0.5 * error[~sure].mean()
    scaled = matched(scene, free, sigma_scale=2.0)
    assert np.nanmedian(scaled.sigma) > 1.5 * np.nanmedian(matched(scene, free).sigma)


def test_sigma_falls_with_texture_and_grows_with_noise():
    rng = np.random.default_rng(0)
    flat = np.full((60, 200), 100.0)
    strong = flat + 40 * np.sin(np.arange(200) / 2)
    d = np.full((60, 200), 8.0, np.float32)

    def sigma(texture, noise):
        left = np.clip(texture + rng.normal(0, noise, texture.shape), 0, 255).astype(np.uint8)
        moved = np.roll(texture, -8, axis=1) + rng.normal(0, noise, texture.shape)
        right = np.clip(moved, 0, 255).astype(np.uint8)
        found = with_evidence(
            left, right, d, of_right=None, agreement_px=1, largest_px=50, sigma_scale=1
        )
        return float(np.nanmedian(found.sigma[10:-10, 20:-20]))

    assert sigma(strong, 1) < sigma(strong, 6) < sigma(flat, 6)
    assert sigma(strong, 1) < 0.15


def test_disparities_that_cannot_be_are_left_out(scene):
    grey = scene.left[:, :, 0]
    d = np.full(grey.shape, 8.0, np.float32)
    d[10, 100], d[20, 100], d[30, 100], d[40, 5] = -1, 0, 70, 8
    d[50, 100] = np.nan
    found = with_evidence(
        grey, grey, d, of_right=None, agreement_px=1, largest_px=50, sigma_scale=1
    )
    for place in ((10, 100), (20, 100), (30, 100), (40, 5), (50, 100)):
        assert np.isnan(found.values[place])
    assert found.values[60, 100] == 8


def test_one_session_serves_threads_and_is_rebuilt_from_a_pickle(scene, free):
    matcher = Onnx(free, layout=LAYOUT).load()
    pair = frame(scene.left, scene.right)
    alone = matcher(pair)
    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(matcher, [pair] * 4))
    again = pickle.loads(pickle.dumps(matcher))(pair)
    for other in (*together, again):
        assert np.array_equal(other.values, alone.values, equal_nan=True)
        assert np.array_equal(other.sigma, alone.sigma, equal_nan=True)


def test_grey_and_16_bit_pictures_are_matched_too(scene, free):
    matcher = Onnx(free, layout=LAYOUT).load()
    left, right = (image[:, :, 1] for image in (scene.left, scene.right))
    assert judged(scene, matcher(frame(left, right)))[0] < 0.06
    deep = [image.astype(np.uint16) * 16 for image in (scene.left, scene.right)]
    found = matcher(frame(*deep)).values
    assert np.array_equal(found, matcher(frame(scene.left, scene.right)).values, equal_nan=True)


@pytest.mark.parametrize(("what", "message"), [("nan", "NaN"), ("constant", "7 everywhere")])
def test_answers_that_mean_nothing_are_refused(scene, tmp_path, what, message):
    path = graphs.answering(tmp_path / "n.onnx", what)
    layout = NetworkLayout(**{**LAYOUT.as_dict(), "output": "disparity"})
    with pytest.raises(ModelOutput, match=message):
        matched(scene, path, layout=layout)
    with pytest.raises(ModelError, match="its layout could not be told"):
        Onnx(path).load()


# --- how the layout is told --------------------------------------------------------------------


def told(caplog, path, **settings):
    caplog.clear()
    with caplog.at_level(logging.INFO, logger="pseudolidar.stereo.neural"):
        matcher = Onnx(path, **settings).load()
    return matcher.layout, caplog.records[-1].getMessage()


def test_flags_come_before_a_sidecar_before_metadata_before_names(tmp_path, caplog):
    path = graphs.two_images(
        tmp_path / "igev.onnx",
        disparities=8,
        metadata={"pseudolidar.normalisation": "imagenet", "pseudolidar.scale": "2"},
        **NAMES,
    )
    graphs.sidecar(path, normalisation="centred", sign="negative")
    layout, line = told(caplog, path, layout=NetworkLayout(normalisation="unit"), probe=False)
    assert (layout.normalisation, layout.sign, layout.scale) == ("unit", "negative", 2)
    assert (layout.channels, layout.inputs) == ("rgb", "left,right")
    assert "told by flags, its file, names (IGEV); sha256 " in line


def test_names_without_a_probe_must_tell_all(tmp_path, caplog):
    path = graphs.two_images(tmp_path / "raft.onnx", disparities=8, **NAMES)
    layout, line = told(caplog, path, probe=False)
    assert (layout.normalisation, layout.sign) == ("raw", "negative")
    assert "names (RAFT-Stereo)" in line
    other = path.rename(tmp_path / "mine.onnx")
    with pytest.raises(ModelError, match=r"--matcher\.layout\.normalisation"):
        Onnx(other, probe=False).load()


def test_what_was_found_out_is_kept_by_the_hash_of_the_file(tmp_path, caplog, own_cache):
    path = graphs.two_images(tmp_path / "n.onnx", disparities=18, size=(192, 96), **NAMES)
    layout, line = told(caplog, path)
    assert "a probe (9" in line
    (entry,) = own_cache.iterdir()
    assert json.loads(entry.read_text())["layout"]["normalisation"] == "unit"
    moved = path.rename(tmp_path / "moved.onnx")
    again, line = told(caplog, moved)
    assert again == layout
    assert line.count("cached") == 1
    entry.write_text("{}")  # damaged: found out anew
    _layout, line = told(caplog, moved)
    assert "cached" not in line


def test_a_bad_sidecar_is_named(free, tmp_path):
    path = tmp_path / "n.onnx"
    path.write_bytes(free.read_bytes())
    for text, message in (
        ("{", "not a layout"),
        ('{"sgin": 1}', "unknown field 'sgin'"),
        ('{"sign": "minus"}', "sign 'minus'"),
        ('{"scale": "two"}', "scale = 'two'"),
        ('{"inputs": "left,wright"}', "input role 'wright'"),
    ):
        path.with_suffix(".json").write_text(text)
        with pytest.raises(ModelError, match=message) as caught:
            Onnx(path).load()
        assert caught.value.path.endswith("n.json")


# --- files that must not be run, and places that are not there ---------------------------------


def test_a_network_that_never_ends_is_stopped(tmp_path):
    path = graphs.endless(tmp_path / "n.onnx")
    begin_s = time.perf_counter()
    with pytest.raises(ModelError, match="no answer within 4 s"):
        Onnx(path, trial_seconds=4).load()
    assert time.perf_counter() - begin_s < 30


def test_a_network_that_asks_for_all_memory_is_stopped(tmp_path):
    path = graphs.two_images(tmp_path / "n.onnx", disparities=8, **NAMES)
    model = onnx.load(str(path))
    shape = onnx.helper.make_tensor("huge", onnx.TensorProto.INT64, [1], [10**9])  # 4 GB
    nodes = [
        onnx.helper.make_node("ConstantOfShape", ["huge"], ["zeros"]),
        onnx.helper.make_node("ReduceSum", ["zeros"], ["none"], keepdims=1),
        onnx.helper.make_node("Add", ["c", "none"], ["more"]),
    ]
    model.graph.initializer.append(shape)
    model.graph.node.extend(nodes)
    model.graph.output[0].name = "more"
    onnx.save(model, str(path))
    layout = NetworkLayout(**{**LAYOUT.as_dict(), "output": "more"})
    with pytest.raises(ModelError) as caught:
        Onnx(path, layout=layout, trial_memory_mb=3000).load()
    assert "lloc" in str(caught.value) or "memory" in str(caught.value)


def test_unknown_operators_are_named_with_the_signature(tmp_path):
    path = graphs.two_images(tmp_path / "n.onnx", disparities=8, **NAMES)
    model = onnx.load(str(path))
    model.graph.node[0].op_type = "Frobnicate"
    path.write_bytes(model.SerializeToString())
    with pytest.raises(ModelError, match=r"Frobnicate.*a float32\[1,3,h,w\]"):
        Onnx(path).load()


def test_inputs_of_no_stereo_network_are_shown(tmp_path, real_data):
    detector = next((real_data / "models").rglob("*.onnx"))
    with pytest.raises(ModelError, match=r"images float32\[1,3,\d+,\d+\].*wanted one image input"):
        Onnx(detector).load()


def test_another_file_than_the_pinned_one_is_refused(free):
    with pytest.raises(ModelError, match="not the one that was pinned"):
        Onnx(free, layout=LAYOUT, sha256="0" * 64).load()


def test_a_provider_that_is_not_there_is_named_with_its_package(free):
    with pytest.raises(MissingDependency, match=r"no CUDAExecutionProvider.*onnxruntime-gpu"):
        Onnx(free, layout=LAYOUT, provider="cuda").load()
    assert Onnx(free, layout=LAYOUT, provider="auto").load().session.provider == "cpu"
