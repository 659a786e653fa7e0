"""The torch losses against the NumPy metrics, and their gradients."""

import numpy as np
import pytest
from eigbench.scoring.metrics import l1_norm, polar_loss, relative_percent_difference

torch = pytest.importorskip("torch")
losses = pytest.importorskip("eigbench.scoring.losses")

METRICS = {
    losses.rpd_loss: relative_percent_difference,
    losses.polar_loss: polar_loss,
    losses.l1_loss: l1_norm,
}


@pytest.fixture(params=METRICS, ids=lambda loss: loss.__name__)
def loss(request):
    return request.param


def batch(rows=7, *, seed=0):
    rng = np.random.default_rng(seed)
    g = np.sort(rng.uniform(0.1, 60, (rows, 10)), axis=1)
    return g * rng.uniform(0.5, 2, g.shape), g


@pytest.mark.parametrize("sign", [1, -1])
def test_loss_equals_the_mean_of_the_metric(loss, sign):
    p, g = batch()
    value = loss(torch.tensor(sign * p), torch.tensor(g))
    assert value.shape == ()
    assert value.dtype == torch.float64
    assert value.item() == pytest.approx(METRICS[loss](sign * p, g).mean(), rel=1e-12, abs=1e-12)


def test_a_loss_broadcasts_nothing(loss):
    p, g = map(torch.tensor, batch())
    for given, label in ((p, g[:1]), (p, g[0]), (p[0], g[0]), (p[:, :1], g)):
        with pytest.raises(ValueError, match=r"must both have shape \(B, k\), got \("):
            loss(given, label)


def test_loss_of_the_label_is_zero(loss):
    _, g = batch()
    assert loss(torch.tensor(g), torch.tensor(g)).item() == pytest.approx(0, abs=1e-12)


def test_gradient_of_the_loss_equals_the_finite_difference(loss):
    p, g = batch(3, seed=1)
    prediction = torch.tensor(p, requires_grad=True)
    assert torch.autograd.gradcheck(lambda p: loss(p, torch.tensor(g)), (prediction,))


def test_gradient_at_the_label_is_finite(loss):
    _, g = batch(2)
    prediction = torch.tensor(g, requires_grad=True)
    loss(prediction, torch.tensor(g)).backward()
    assert torch.isfinite(prediction.grad).all()


def test_a_step_against_the_gradient_lowers_the_loss(loss):
    p, g = batch(4, seed=2)
    prediction, label = torch.tensor(p, requires_grad=True), torch.tensor(g)
    before = loss(prediction, label)
    before.backward()
    step = 1e-4 / prediction.grad.norm()
    assert loss(prediction.detach() - step * prediction.grad, label) < before
