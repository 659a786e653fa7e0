"""The plain network: its encoding and its training."""

import numpy as np
import pytest
import torch
from torch_geometric.data import Batch, Data

from baselines.gcn import plain
from baselines.gcn.encodings import encoding
from baselines.gcn.plain import Network, encode, train
from synthnet.types import Mesh
from tests.baselines.gcn.conftest import data_of


@pytest.mark.parametrize("inwards", [False, True])
@pytest.mark.parametrize("virtual", [False, True])
def test_the_encoding_is_that_of_the_fast_network(virtual, inwards, meshes):
    for mesh in meshes:
        turned = Mesh(mesh.vertices, mesh.faces[:, ::-1]) if inwards else mesh
        ours = encode(data_of(turned), virtual)
        theirs = encoding("ALG", virtual_node=virtual)(data_of(turned))
        torch.testing.assert_close(ours.x, theirs.x, rtol=1e-6, atol=1e-6)
        assert torch.equal(ours.edge_index, theirs.edge_index)
        torch.testing.assert_close(ours.edge_weight, theirs.edge_weight, rtol=1e-6, atol=0)


def test_the_encoding_of_a_right_triangle_by_hand():
    # Legs 3 and 4, area 6: the circumcentre is the middle of the hypotenuse, of length 5.
    corners = torch.tensor([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])
    graph = encode(Data(pos=corners, face=torch.tensor([[0], [1], [2]])), virtual_node=False)
    assert graph.x[:, 3].tolist() == [3.0, 1.5, 1.5]
    assert graph.x[:, 4:].abs().tolist() == [[0, 0, 1]] * 3
    assert graph.edge_index.tolist() == [[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]]
    assert graph.edge_weight.tolist() == pytest.approx([0.6, 0.8, 0.6, 1, 0.8, 1])


def batch_of(samples):
    graphs = []
    for sample in samples:
        graphs.append(encode(data_of(sample.mesh)))
        graphs[-1].y = torch.from_numpy(sample.eigenvalues[None].astype(np.float32))
    return Batch.from_data_list(graphs)


def test_training_lowers_the_loss(samples):
    torch.manual_seed(0)
    batch = batch_of(samples)
    losses = list(train(Network(), [batch] * 60, rate=3e-3))
    assert len(losses) == 60
    assert (np.diff(losses[::20] + losses[-1:]) < 0).all()  # 2.82 at first, 0.007 less each time


def test_an_untrained_network_starts_at_the_mean_spectrum(samples):
    torch.manual_seed(0)
    batch, network = batch_of(samples), Network()
    with torch.no_grad():
        network.head[-1].weight.zero_()
    (loss,) = train(network, [batch], rate=0.0)
    mean = batch.y.log().mean(dim=0).exp()
    expected = ((batch.y - mean).abs() / (batch.y + mean)).sum(dim=1).mean()
    assert loss == pytest.approx(expected.item(), rel=1e-5)


def test_the_command_prints_a_loss_a_step(samples, monkeypatch, capsys):
    graphs = batch_of(samples).to_data_list()
    options = []

    def dataset(**chosen):
        options.append((chosen["version"], chosen["split"], chosen["transform"]))
        return graphs * 4

    monkeypatch.setattr(plain, "SynthNet", dataset)
    plain.main(steps=2)
    assert options == [("1.0-mini", "train", encode)]
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["step 0", "step 1"]
