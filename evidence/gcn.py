"""The graph convolutional network: our way against PyTorch Geometric's, same weights, same run.

Both sides have the encoded graphs in memory and all threads of PyTorch. The peer is
``GraphConv`` on a ``Batch`` made beforehand; ours joins its graphs within the time. A training
step is forward, loss, backward; inference is of 200 meshes. Medians, in turn. With --figure-2
also the paper's Figure 2: the 200 meshes from raw vertices and faces to eigenvalues, by the
network that is nearest on the board of 1.0, LaPy and the solver behind the labels, on one thread
and on all.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import threadpoolctl

from evidence import solvers
from evidence.timing import in_turn
from synthnet import spectrum
from synthnet.build.versions import ensure_built
from synthnet.types import Mesh, Sample

if TYPE_CHECKING:
    import torch

    from baselines.gcn.model import GCN

STEP, INFERENCE = 32, 200  # meshes
ENCODING = "ALG"
NEAREST = "table2-alg-virtual-long"  # its layers and encoding; what its weights are takes no time


def measure(
    *, version: str = "1.0-small", rounds: int = 7, device: str = "", figure_2: bool = False
) -> dict:
    """Return a row for each task and precision; with ``--figure-2`` the figure's seconds too."""
    import torch

    from baselines.gcn.configs import CONFIGS
    from baselines.gcn.model import GCN, GCNConfig

    device = device or ("cuda" if torch.cuda.is_available() else "cpu")
    samples = list(ensure_built(version).samples())
    chosen = np.random.default_rng(0).choice(len(samples), INFERENCE, replace=False)
    samples = [samples[i] for i in chosen]
    torch.manual_seed(0)
    model = GCN(GCNConfig(ENCODING)).to(device)
    threads = torch.get_num_threads()
    few, many, tasks = sides(model, samples, device, threads)
    rows = [
        row(task, dtype, peer, partial(ours, dtype), rounds)
        for task, (peer, ours) in tasks.items()
        for dtype in (torch.float32, torch.bfloat16)
    ]
    result = {
        "device": device,
        "capability": torch.backends.cpu.get_cpu_capability(),
        "threads": threads,
        "vertices": {"step": few, "inference": many},
        "rows": rows,
    }
    if figure_2:
        nearest = GCN(CONFIGS[NEAREST].model).to(device)
        result["figure2"] = from_raw_meshes(nearest, [sample.mesh for sample in samples], threads)
    return result


def sides(
    model: GCN, samples: list[Sample], device: str, threads: int
) -> tuple[int, int, dict[str, tuple[Callable, Callable]]]:
    """Return the vertices of a step and of inference, and the peer's and our call of each task."""
    import torch
    from eigbench.scoring.losses import rpd_loss
    from torch_geometric.data import Batch

    from baselines.gcn import data, folded

    encode = data.encoder(model.config)
    graphs = [encode(sample.mesh).to(device) for sample in samples]
    plain = [plain_graph(sample.mesh) for sample in samples]
    few = Batch.from_data_list(plain[:STEP]).to(device)
    many = Batch.from_data_list(plain).to(device)
    labels = np.array([sample.eigenvalues for sample in samples])
    y = torch.tensor(labels, dtype=torch.float32, device=device)

    def gradients(loss: Callable[[], torch.Tensor]) -> torch.Tensor:
        model.zero_grad()
        loss().backward()
        return torch.cat([p.grad.flatten() for p in model.parameters()])

    def our_loss(dtype: torch.dtype) -> torch.Tensor:
        return folded.batch_loss(
            model, graphs[:STEP], None, y[:STEP], lambda p, g, _: rpd_loss(p, g), dtype, threads
        )

    def plain_inference() -> torch.Tensor:
        with torch.no_grad():
            return model(many)

    tasks = {
        f"training step of {STEP}": (
            lambda: gradients(lambda: rpd_loss(model(few), y[:STEP])),
            lambda dtype: gradients(lambda: our_loss(dtype)),
        ),
        f"inference of {INFERENCE}": (
            plain_inference,
            lambda dtype: folded.outputs(model, graphs, dtype, threads),
        ),
    }
    return int(few.num_nodes), int(many.num_nodes), tasks


def plain_graph(mesh: Mesh) -> object:
    """Return a mesh as PyTorch Geometric has it, encoded without a trick."""
    import torch
    from torch_geometric.data import Data

    from baselines.gcn.plain import encode

    pos = torch.from_numpy(mesh.vertices.astype(np.float64))
    face = torch.from_numpy(mesh.faces.T.astype(np.int64))
    return encode(Data(pos=pos, face=face), virtual_node=False)


def row(task: str, dtype: torch.dtype, peer: Callable, ours: Callable, rounds: int) -> dict:
    """Return the milliseconds of both sides, and the difference of their answers."""
    both = {"peer": peer, "ours": ours}
    in_turn(both)  # this call warms up
    timed = in_turn(both, rounds, clock=clock)
    truth, answer = timed["peer"].answer, timed["ours"].answer
    difference = float((truth - answer).norm() / truth.norm())
    return {
        "what": task,
        "dtype": str(dtype).removeprefix("torch."),
        "PyG ms": round(1e3 * timed["peer"].seconds),
        "ours ms": round(1e3 * timed["ours"].seconds),
        "ratio": round(timed["peer"].seconds / timed["ours"].seconds, 2),
        "relative difference": float(f"{difference:.1e}"),
    }


def clock() -> float:
    """Return the seconds of a clock, once a GPU has done its work."""
    import torch

    if torch.cuda.is_available():
        torch.cuda.synchronize()
    return time.perf_counter()


def from_raw_meshes(model: GCN, meshes: list[Mesh], threads: int) -> list[dict]:
    """Return seconds for all meshes, by the network, LaPy and our solver, on one thread and all.

    The network and our solver share meshes out among threads; LaPy has its libraries' own.
    """
    import torch

    from baselines.gcn import data, folded

    encode = data.encoder(model.config)
    device = next(model.parameters()).device

    def network(some: list[Mesh], count: int) -> None:
        before = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            graphs = [graph.to(device) for graph in folded.each(encode, some, count)]
            folded.outputs(model, graphs, threads=count)
        finally:
            torch.set_num_threads(before)

    def by_lapy(some: list[Mesh], count: int) -> None:
        with threadpoolctl.threadpool_limits(count):
            for mesh in some:
                solvers.lapy(mesh, 10)

    def by_solver(some: list[Mesh], count: int) -> None:
        with threadpoolctl.threadpool_limits(1):
            folded.each(lambda mesh: spectrum.compute(mesh, 10), some, count)

    ways = {"GCN, encoding included": network, "LaPy": by_lapy, "our certified solver": by_solver}
    rows = []
    for name, way in ways.items():
        for count in dict.fromkeys((1, threads)):
            way(meshes[:STEP], count)  # this call imports, compiles and starts threads
            seconds = in_turn({name: partial(way, meshes, count)}, clock=clock)[name].seconds
            where = f"{device.type}, {count} thread{'s' * (count > 1)}"
            what = f"{name}, {len(meshes)} meshes"
            rows.append({"what": what, "where": where, "seconds": round(seconds, 3)})
    return rows
