from itertools import pairwise

import numpy as np
import pytest
import torch
from eigbench.scoring.losses import rpd_loss
from torch_geometric.data import Batch, Data

from baselines.gcn import folded
from baselines.gcn.data import encoder
from baselines.gcn.encodings import CHANNELS, encoding
from baselines.gcn.graphs import graph, join
from baselines.gcn.model import GCN, WIDTHS, GCNConfig
from baselines.gcn.plain import Network
from tests.baselines.gcn.conftest import data_of, moved

CONFIGS = [GCNConfig(name, virtual) for name in CHANNELS for virtual in (False, True)]
CONFIGS += [GCNConfig("A", True, 4), GCNConfig("ALG", False, 5)]
IDS = [f"{c.encoding}{'-virtual' * c.virtual_node}-{c.blocks}" for c in CONFIGS]


@pytest.fixture(params=[1, 2], ids=["one thread", "two threads"])
def threads(request):
    return int(request.param)


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch, meshes):
    """The meshes are so small that all would go together."""
    monkeypatch.setattr(folded, "CHUNK", 60)
    assert len(folded.chunks([len(mesh.vertices) for mesh in meshes], folded.CHUNK)) > 3


def encoded(meshes, config):
    transform = encoding(config.encoding, virtual_node=config.virtual_node)
    kept = []
    for mesh in meshes:
        data = transform(data_of(mesh))
        weight = {"edge_weight": data.edge_weight} if "edge_weight" in data else {}
        kept.append(Data(x=data.x, edge_index=data.edge_index, **weight))
    return kept


def model_of(config):
    torch.manual_seed(1)
    return GCN(config)


def plain_of(model):
    """The plain network with the same parameters."""
    network = Network(model.config.channels, WIDTHS[: model.config.blocks])
    network.load_state_dict(model.state_dict())
    return network


def gradient(model):
    """The gradient in all parameters, as one vector."""
    return torch.cat([p.grad.flatten() for p in model.parameters()])


def norm_apart(actual, expected):
    return float((actual - expected).norm() / expected.norm())


def mean_rpd(outputs, labels, _):
    return rpd_loss(outputs, labels)


@pytest.mark.parametrize("config", CONFIGS, ids=IDS)
def test_outputs_are_those_of_the_plain_network(config, meshes, threads):
    data = encoded(meshes, config)
    model = model_of(config)
    expected = plain_of(model)(Batch.from_data_list(data)).detach()
    outputs = folded.outputs(model, [graph(item) for item in data], threads=threads)
    assert norm_apart(outputs, expected) < 1e-5
    assert torch.equal(model(Batch.from_data_list(data)), expected)


@pytest.mark.parametrize("config", CONFIGS, ids=IDS)
def test_gradients_are_those_of_the_plain_network(config, meshes, threads):
    data = encoded(meshes, config)
    y = torch.rand(len(data), 10) + 1
    ours = model_of(config)
    plain, doubles = plain_of(ours), plain_of(ours).double()
    batch = Batch.from_data_list(data)
    expected = rpd_loss(plain(batch), y)
    expected.backward()
    exact = batch.apply(lambda value: value.double() if value.is_floating_point() else value)
    rpd_loss(doubles(exact), y.double()).backward()
    graphs = [graph(item) for item in data]
    loss = folded.batch_loss(ours, graphs, None, y, mean_rpd, threads=threads)
    loss.backward()
    assert loss.item() == pytest.approx(expected.item(), rel=1e-5)
    # An activation next to zero may have either sign in single precision, and there the gradient
    # jumps: on one processor the plain network's is 4e-5 from that in doubles, ours 1e-7.
    found = gradient(ours)
    assert min(norm_apart(found, gradient(other)) for other in (plain, doubles)) < 1e-5


@pytest.mark.parametrize("config", CONFIGS[:6], ids=IDS[:6])
def test_gradients_of_moved_meshes_are_those_of_the_plain_network(config, meshes, orthogonal):
    matrices = [orthogonal[i % 2] for i in range(len(meshes))]
    there = list(map(moved, meshes, matrices))
    y = torch.rand(len(meshes), 10) + 1
    ours = model_of(config)
    plain = plain_of(ours)
    rpd_loss(plain(Batch.from_data_list(encoded(there, config))), y).backward()
    graphs = [graph(item) for item in encoded(meshes, config)]
    isometries = torch.from_numpy(np.stack(matrices)).float()
    folded.batch_loss(ours, graphs, isometries, y, mean_rpd).backward()
    apart = norm_apart(gradient(ours), gradient(plain))
    assert apart < 1e-4  # the coordinates themselves are rounded otherwise


@pytest.fixture(params=[False, True], ids=["emulated", "native"])
def processor(request, monkeypatch):
    """One that multiplies bfloat16, and one that does not: both ways are right everywhere."""
    monkeypatch.setattr(folded, "has_bfloat16", lambda: request.param)


@pytest.mark.usefixtures("processor")
def test_bfloat16_is_near(meshes):
    config = GCNConfig("ALG")
    model, graphs = model_of(config), [graph(item) for item in encoded(meshes, config)]
    expected = folded.outputs(model, graphs)
    apart = norm_apart(folded.outputs(model, graphs, torch.bfloat16), expected)
    assert 1e-6 < apart < 0.02  # eight bits of mantissa, and another result than float32's


@pytest.mark.usefixtures("processor")
def test_gradients_in_bfloat16_are_near(meshes):
    config = GCNConfig("ALG")
    graphs = [graph(item) for item in encoded(meshes, config)]
    y = torch.rand(len(graphs), 10) + 1
    gradients = []
    for dtype in (torch.bfloat16, torch.float32):
        model = model_of(config)
        folded.batch_loss(model, graphs, None, y, mean_rpd, dtype).backward()
        gradients.append(gradient(model))
    assert norm_apart(*gradients) < 0.05


@pytest.mark.parametrize("config", CONFIGS[:6], ids=IDS[:6])
def test_features_turn_as_the_mesh_does(config, meshes, orthogonal):
    encode = encoder(config)
    for matrix in orthogonal:
        isometries = torch.from_numpy(matrix).float().repeat(len(meshes), 1, 1)
        here = join([encode(mesh) for mesh in meshes], isometries)
        there = join([encode(moved(mesh, matrix)) for mesh in meshes])
        torch.testing.assert_close(here.features, there.features, rtol=1e-5, atol=1e-4)


def test_join_keeps_meshes_apart(meshes):
    graphs = [encoder(GCNConfig("ALG"))(mesh) for mesh in meshes[:3]]
    joined = join(graphs)
    sizes = [len(part.features) for part in graphs]
    assert joined.starts == (0, sizes[0], sizes[0] + sizes[1], sum(sizes))
    for part, start, end in zip(graphs, joined.starts, joined.starts[1:], strict=False):
        first, last = joined.offsets[start], joined.offsets[end]
        inside = joined.neighbours[first:last]
        assert inside.min() >= start
        assert inside.max() < end
        assert torch.equal(inside - start, part.neighbours)


@pytest.mark.parametrize("sizes", [[5], [1, 1, 1], [10, 3, 3, 3, 1], [4, 9, 2, 9]])
def test_chunks_hold_every_mesh_once_and_respect_the_limit(sizes):
    groups = folded.chunks(sizes, limit=6)
    assert sorted(i for group in groups for i in group) == list(range(len(sizes)))
    for group in groups:
        assert len(group) == 1 or sum(sizes[i] for i in group) <= 6


def test_threads_give_the_same_bits(meshes):
    config = GCNConfig("ALG", True)
    graphs = [graph(item) for item in encoded(meshes, config)] * 3
    model = model_of(config)
    answers = [folded.outputs(model, graphs, threads=count) for count in (1, 2)]
    assert torch.equal(*answers)


# The network


@pytest.mark.parametrize("blocks", [3, 4, 5])
def test_parameters_counted_by_hand(blocks):
    widths = [7, *WIDTHS[:blocks]]
    convolutions = sum(2 * i * o + o + o * o + o for i, o in pairwise(widths))
    head = 256 * 64 + 64 + 3 * (64 * 64 + 64) + 64 * 10 + 10
    assert GCN(GCNConfig("ALG", False, blocks)).parameter_count() == convolutions + head


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"encoding": "B"}, "the encoding must be one of none, A, ALG, got 'B'"),
        ({"blocks": 6}, "blocks must be 1 to 5, got 6"),
        ({"blocks": 0}, "blocks must be 1 to 5, got 0"),
    ],
)
def test_options_out_of_range(options, message):
    with pytest.raises(ValueError, match=message):
        GCNConfig(**options)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_meshes_on_the_gpu_give_the_same(meshes):
    config = GCNConfig("ALG", True)
    graphs = [graph(item) for item in encoded(meshes, config)]
    expected = folded.outputs(model_of(config), graphs)
    there = [item.to("cuda") for item in graphs]
    model = model_of(config).to("cuda")
    assert norm_apart(folded.outputs(model, there).cpu(), expected) < 1e-4
    y, still = torch.ones(len(meshes), 10, device="cuda"), torch.eye(3, device="cuda")
    still = still.repeat(len(meshes), 1, 1)
    folded.batch_loss(model, there, still, y, mean_rpd).backward()
    assert torch.isfinite(gradient(model)).all()


def test_the_sparse_matrix_of_a_gpu_is_the_same_product(meshes):
    config = GCNConfig("ALG", True)
    joined = join([graph(data) for data in encoded(meshes, config)])
    a = torch.rand(len(joined.features), 5, requires_grad=True)
    weight = torch.rand(len(joined.features), 14)
    results = []
    for sparse in (None, folded.adjacency(joined, torch.float32)):
        both = folded.Aggregate.apply(a, joined, sparse, torch.float32)
        (gradient,) = torch.autograd.grad((both * weight).sum(), a)
        results.append((both.detach(), gradient))
    (product, gradient), theirs = results
    torch.testing.assert_close((product, gradient), theirs)
