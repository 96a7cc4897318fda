from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmm.config import NetworkConfig
from jaxmm.inputs import InputError
from jaxmm.learning.fused_layers import CLOUDS, EPSILON, drop
from jaxmm.learning.network import PointNetwork, from_torch
from jaxmm.learning.torch_weights import read_state_dict

SMALL = NetworkConfig(encoder=(8, 16), head=(12, 6), dropout=0.0)
RNG = np.random.default_rng(0)


def fresh(config, feature_count=4, seed=0):
    """Random variables, running statistics included, so that no default hides a fault."""
    rng = np.random.default_rng(seed)

    def draw(leaf):
        scale = rng.normal(size=leaf.shape) / np.sqrt(leaf.shape[0]) if leaf.ndim == 2 else 1.0
        return (scale + rng.uniform(0.1, 0.5, leaf.shape)).astype(leaf.dtype)

    return jax.tree.map(draw, shapes_of(config, feature_count))


def shapes_of(config, feature_count):
    init = partial(PointNetwork(config).init, train=False)
    return jax.eval_shape(init, jax.random.key(0), jnp.zeros((1, feature_count)), jnp.ones(1, bool))


@partial(jax.jit, static_argnums=0)
def predict(config, variables, cloud, mask):
    return PointNetwork(config).apply(variables, cloud, mask, train=False)


@partial(jax.jit, static_argnums=0)
def train_apply(config, variables, features, mask):
    seeds = jnp.zeros(len(features), jnp.uint32)

    def one(x, m, s):
        return PointNetwork(config).apply(variables, x, m, train=True, seed=s, mutable=["batch_stats"])

    logits, updated = jax.vmap(one, axis_name=CLOUDS, out_axes=(0, None))(features, mask, seeds)
    return logits, updated["batch_stats"]


def reference(variables, features, train):
    """The thesis network in NumPy float64 on clouds (B, N, F) without padding or dropout, the head not split."""
    params, stats = jax.tree.map(
        lambda leaf: np.asarray(leaf, np.float64), (variables["params"], variables["batch_stats"])
    )
    moments = {}

    def norm(x, name):
        mean, var = stats[name]["mean"], stats[name]["var"]
        if train:
            mean, var = x.mean((0, 1)), x.var((0, 1))
            moments[name] = mean, x.reshape(-1, x.shape[-1]).var(0, ddof=1)
        return np.maximum((x - mean) / np.sqrt(var + EPSILON) * params[name]["scale"] + params[name]["bias"], 0)

    x = np.asarray(features, np.float64)
    for name in sorted(name for name in params if name.startswith("conv")):
        x = norm(x @ params[name]["kernel"] + params[name]["bias"], name.replace("conv", "bn"))
    x = np.concatenate([x, np.broadcast_to(x.max(1, keepdims=True), x.shape)], -1)
    head = sorted(name for name in params if name.startswith("seg_conv"))
    for name in head[:-1]:
        x = norm(x @ params[name]["kernel"] + params[name]["bias"], name.replace("conv", "bn"))
    return (x @ params[head[-1]]["kernel"] + params[head[-1]]["bias"])[..., 0], moments


def test_default_widths_are_the_thesis_network():
    variables = shapes_of(NetworkConfig(), 1)
    kernels = {name: leaf["kernel"].shape for name, leaf in variables["params"].items() if "conv" in name}
    assert kernels == {
        "conv1": (1, 64),
        "conv2": (64, 128),
        "conv3": (128, 256),
        "conv4": (256, 512),
        "seg_conv1": (1024, 256),
        "seg_conv2": (256, 128),
        "seg_conv3": (128, 1),
    }
    assert sorted(variables["batch_stats"]) == ["bn1", "bn2", "bn3", "bn4", "seg_bn1", "seg_bn2"]


def test_predicts_as_written_out_in_float64():
    variables, features = fresh(SMALL), RNG.normal(size=(3, 50, 4)).astype(np.float32)
    expected, _ = reference(variables, features, train=False)
    for cloud, logits in zip(features, expected, strict=True):
        found = predict(SMALL, variables, cloud, np.ones(50, bool))
        np.testing.assert_allclose(found, logits, rtol=1e-4, atol=1e-4)


def test_trains_on_the_statistics_of_all_clouds_together():
    variables, features = fresh(SMALL), RNG.normal(2, 3, size=(3, 50, 4)).astype(np.float32)
    expected, moments = reference(variables, features, train=True)
    logits, updated = train_apply(SMALL, variables, features, jnp.ones((3, 50), bool))
    np.testing.assert_allclose(logits, expected, rtol=1e-4, atol=1e-4)
    for name, (mean, var) in moments.items():
        old = variables["batch_stats"][name]
        np.testing.assert_allclose(updated[name]["mean"], 0.9 * old["mean"] + 0.1 * mean, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(updated[name]["var"], 0.9 * old["var"] + 0.1 * var, rtol=1e-4, atol=1e-5)


def test_padding_changes_nothing_while_training_or_predicting():
    variables, counts = fresh(SMALL), (50, 20, 33)
    clouds = [RNG.normal(size=(count, 4)).astype(np.float32) for count in counts]
    mask = np.arange(60) < np.array(counts)[:, None]

    def padded(filler):
        features = np.full((3, 60, 4), filler, np.float32)
        for row, cloud in zip(features, clouds, strict=True):
            row[: len(cloud)] = cloud
        return features

    logits, stats = train_apply(SMALL, variables, padded(0.0), mask)
    other_logits, other_stats = train_apply(SMALL, variables, padded(1e3), mask)
    logits, other_logits = np.asarray(logits), np.asarray(other_logits)
    np.testing.assert_allclose(logits[mask], other_logits[mask], rtol=1e-5, atol=1e-5)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5), stats, other_stats)
    for row, cloud, real in zip(padded(1e3), clouds, mask, strict=True):
        whole = predict(SMALL, variables, cloud, np.ones(len(cloud), bool))
        found = np.asarray(predict(SMALL, variables, row, real))[: len(cloud)]
        np.testing.assert_allclose(found, whole, rtol=1e-5, atol=1e-5)


def test_order_of_points_does_not_matter():
    variables, cloud, order = fresh(SMALL), RNG.normal(size=(200, 4)).astype(np.float32), RNG.permutation(200)
    mask = np.ones(200, bool)
    logits = np.asarray(predict(SMALL, variables, cloud, mask))
    np.testing.assert_allclose(predict(SMALL, variables, cloud[order], mask), logits[order], atol=1e-5)


def test_dropout_keeps_the_right_share_and_the_mean():
    x = jnp.ones((4000, 64))
    dropped = np.asarray(drop(x, 0.3, jnp.uint32(7), layer=0))
    assert set(np.unique(dropped)) == {0, np.float32(1 / 0.7)}
    # Binomial: 4 standard deviations of the share of 256,000 draws.
    np.testing.assert_allclose((dropped == 0).mean(), 0.3, atol=4 * np.sqrt(0.21 / dropped.size))
    np.testing.assert_allclose((dropped == 0).mean(0), 0.3, atol=5 * np.sqrt(0.21 / 4000))  # in every channel
    np.testing.assert_allclose((dropped == 0).mean(1), 0.3, atol=6 * np.sqrt(0.21 / 64))  # and at every point


def test_dropout_masks_of_different_seeds_and_layers_are_unrelated():
    x = jnp.ones((256, 64))
    cases = [(seed, layer) for seed in (0, 1, 2, 64, 2**31, 123456789) for layer in (0, 1, 2)]
    masks = [np.asarray(drop(x, 0.5, jnp.uint32(seed), layer=layer) > 0).ravel() for seed, layer in cases]
    assert np.array_equal(masks[0], np.asarray(drop(x, 0.5, jnp.uint32(0), layer=0) > 0).ravel())
    for index, mask in enumerate(masks):
        for other in masks[:index]:
            # Every cyclic shift at once by Fourier transform: a shifted copy would stand out as correlation 1.
            spectrum = np.fft.rfft(mask - 0.5) * np.conj(np.fft.rfft(other - 0.5))
            correlation = np.fft.irfft(spectrum) / (0.25 * mask.size)
            assert np.abs(correlation).max() < 6 / np.sqrt(mask.size)


def test_released_weights_agree_with_torch_on_real_scans(data_root):
    torch = pytest.importorskip("torch", reason="torch is an extra (peers)")
    from scipy.spatial import cKDTree

    compared, length = 0, 16_384  # one for all, so that the network is compiled once
    for path in sorted((data_root / "thesis/trained_models").glob("*/*.pth")):
        folder = data_root / f"thesis/datasets/dataset_{path.parent.name}/clean_and_occluded"
        params, batch_stats, config = from_torch(read_state_dict(path))
        witness = torch_network(torch, torch.load(path, map_location="cpu", weights_only=True))
        for scan in sorted(folder.glob("npy_files*/room_test_1_*_dt_scan_*.npy")):
            dt, robot = np.load(scan), np.load(str(scan).replace("dt_scan", "robot_scan"))
            own, other = (dt, robot) if path.parent.name.endswith("removed") else (robot, dt)
            distance = cKDTree(other).query(own)[0].astype(np.float32)[:, None]
            variables = {"params": params, "batch_stats": batch_stats}
            padded, real = np.zeros((length, 1), np.float32), np.arange(length) < len(distance)
            padded[real] = distance
            ours = np.asarray(jax.nn.sigmoid(predict(config, variables, padded, real)))[real]
            with torch.no_grad():
                theirs = torch.sigmoid(witness(torch.from_numpy(distance.T[None])))[0, 0].numpy()
            np.testing.assert_allclose(ours, theirs, atol=1e-5)
            compared += 1
    assert compared == 8


def torch_network(torch, state):
    """The thesis network out of torch's own layers."""
    functional = torch.nn.functional

    def norm(x, name):
        moments = state[f"{name}.running_mean"], state[f"{name}.running_var"]
        return torch.relu(functional.batch_norm(x, *moments, state[f"{name}.weight"], state[f"{name}.bias"]))

    def conv(x, name):
        return functional.conv1d(x, state[f"{name}.weight"], state[f"{name}.bias"])

    def forward(x):
        for index in (1, 2, 3, 4):
            x = norm(conv(x, f"conv{index}"), f"bn{index}")
        x = torch.cat([x, x.max(2, keepdim=True)[0].expand(-1, -1, x.shape[2])], 1)
        for index in (1, 2):
            x = norm(conv(x, f"seg_conv{index}"), f"seg_bn{index}")
        return conv(x, "seg_conv3")

    return forward


def as_torch_state(variables):
    """The inverse of from_torch, for its tests."""
    state = {}
    for name, leaf in variables["params"].items():
        if "conv" in name:
            state[f"{name}.weight"] = np.asarray(leaf["kernel"]).T[:, :, None]
        else:
            moments = variables["batch_stats"][name]
            state |= {f"{name}.weight": np.asarray(leaf["scale"]), f"{name}.num_batches_tracked": np.array(3)}
            state |= {f"{name}.running_{key}": np.asarray(moments[key]) for key in ("mean", "var")}
        state[f"{name}.bias"] = np.asarray(leaf["bias"])
    return state


def test_from_torch_brings_every_tensor_to_its_place():
    variables = fresh(SMALL)
    params, batch_stats, config = from_torch(as_torch_state(variables))
    assert (config.encoder, config.head) == (SMALL.encoder, SMALL.head)
    jax.tree.map(np.testing.assert_array_equal, {"params": params, "batch_stats": batch_stats}, dict(variables))


@pytest.mark.parametrize(
    "damage, message",
    [
        pytest.param(lambda s: s.pop("bn1.running_var"), "bn1.running_var: expected shape", id="missing"),
        pytest.param(lambda s: s.update({"conv2.weight": np.zeros((16, 7, 1))}), r"conv2.weight: expected", id="shape"),
        pytest.param(lambda s: s.update({"stn.weight": np.zeros(3)}), "stn.weight", id="left over"),
        pytest.param(lambda s: s.clear(), "expected tensors conv1.weight", id="empty"),
        pytest.param(
            lambda s: s.update({"conv4.weight": np.zeros((3, 16, 1))}), "conv1.weight ...", id="a gap in between"
        ),
        pytest.param(lambda s: s.update({"conv2.weight": np.float32(1)}), "conv1.weight ...", id="a number"),
    ],
)
def test_from_torch_names_what_is_wrong(damage, message):
    state = as_torch_state(fresh(SMALL))
    damage(state)
    with pytest.raises(InputError, match=message):
        from_torch(state)
