"""The graph convolutional network: our way against PyTorch Geometric's, same weights, same run.

Both sides have the encoded graphs in memory and all threads of PyTorch. The peer is
``GraphConv`` on a ``Batch`` made beforehand; ours joins its graphs within the time. A training
step is forward, loss, backward; inference is of 200 meshes. Medians, in turn. With --figure-2
also the paper's Figure 2: the 200 meshes from raw vertices and faces to eigenvalues, by the
network, LaPy and the solver behind the labels, on one thread and on all.

Usage: PYTHONPATH=. python benchmarks/gcn.py [--version 1.0-small] [--rounds 7] [--figure-2]
"""

import argparse
import json
import statistics
import time
from functools import partial
from pathlib import Path

import lapy
import numpy as np
import threadpoolctl
import torch
from eigbench.scoring.losses import rpd_loss
from tabulate import tabulate
from torch_geometric.data import Batch, Data

from baselines.gcn import data, folded
from baselines.gcn.encodings import encoding
from baselines.gcn.model import GCN, GCNConfig
from synthnet import spectrum
from synthnet.build.versions import ensure_built
from synthnet.store.files import write_text
from synthnet.types import Mesh

STEP, INFERENCE = 32, 200


def timed(work) -> float:
    """Return the seconds of a call."""
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    started = time.perf_counter()
    work()
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    return time.perf_counter() - started


def figure_2(model: GCN, meshes: list[Mesh], threads: int) -> list[dict]:
    """Return seconds for all meshes, by the network, LaPy and our solver, on one thread and all.

    The network and our solver share meshes out among threads; LaPy has its libraries' own.
    """
    encode = data.encoder(model.config)
    device = next(model.parameters()).device

    def network(count: int) -> None:
        graphs = [one.to(device) for one in folded.each(encode, meshes, count)]
        folded.outputs(model, graphs, threads=count)

    def by_lapy(count: int) -> None:
        with threadpoolctl.threadpool_limits(count):
            for mesh in meshes:
                triangles = lapy.TriaMesh(mesh.vertices.astype(np.float64), mesh.faces)
                lapy.Solver(triangles).eigs(11)

    def by_solver(count: int) -> None:
        with threadpoolctl.threadpool_limits(1):
            folded.each(lambda mesh: spectrum.compute(mesh, 10), meshes, count)

    ways = {"GCN, encoding included": network, "LaPy": by_lapy, "our certified solver": by_solver}
    rows = []
    for what, way in ways.items():
        for count in dict.fromkeys((1, threads)):
            seconds = timed(partial(way, count))
            where = f"{device.type}, {count} thread{'s' * (count > 1)}"
            what_of = f"{what}, {len(meshes)} meshes"
            rows.append({"what": what_of, "where": where, "seconds": round(seconds, 3)})
    return rows


def main() -> None:
    """Compare and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--version", default="1.0-small")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--figure-2", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    config = GCNConfig("ALG")
    samples = list(ensure_built(options.version).samples())
    rng = np.random.default_rng(0)
    chosen = [samples[i] for i in rng.choice(len(samples), INFERENCE, replace=False)]
    transform, encode = encoding("ALG"), data.encoder(config)
    plain, graphs, labels = [], [], []
    for sample in chosen:
        pos = torch.from_numpy(sample.mesh.vertices.astype(np.float64))
        face = torch.from_numpy(sample.mesh.faces.T.astype(np.int64))
        encoded = transform(Data(pos=pos, face=face))
        plain.append(
            Data(x=encoded.x, edge_index=encoded.edge_index, edge_weight=encoded.edge_weight)
        )
        graphs.append(encode(sample.mesh).to(options.device))
        labels.append(sample.eigenvalues)
    y = torch.tensor(np.array(labels), dtype=torch.float32, device=options.device)
    torch.manual_seed(0)
    model = GCN(config).to(options.device)
    threads = torch.get_num_threads()
    few = Batch.from_data_list(plain[:STEP]).to(options.device)
    many = Batch.from_data_list(plain).to(options.device)

    def gradients() -> torch.Tensor:
        return torch.cat([p.grad.flatten() for p in model.parameters()])

    def plain_step() -> torch.Tensor:
        model.zero_grad()
        rpd_loss(model(few), y[:STEP]).backward()
        return gradients()

    def our_step(dtype: torch.dtype) -> torch.Tensor:
        model.zero_grad()
        loss = folded.batch_loss(
            model, graphs[:STEP], None, y[:STEP], lambda p, g, _: rpd_loss(p, g), dtype, threads
        )
        loss.backward()
        return gradients()

    def plain_inference() -> torch.Tensor:
        with torch.no_grad():
            return model(many)

    pairs = {
        "training step of 32": (plain_step, our_step),
        "inference of 200": (
            plain_inference,
            lambda dtype: folded.outputs(model, graphs, dtype, threads),
        ),
    }
    rows = []
    for what, (peer, ours) in pairs.items():
        for dtype in (torch.float32, torch.bfloat16):
            truth, found = peer(), ours(dtype)
            difference = float((truth - found).norm() / truth.norm())
            peers, mine = [], []
            for _ in range(options.rounds):
                peers.append(timed(peer))
                mine.append(timed(lambda: ours(dtype)))  # noqa: B023
            one, other = statistics.median(peers), statistics.median(mine)
            rows.append(
                {
                    "what": what,
                    "dtype": str(dtype).removeprefix("torch."),
                    "PyG ms": round(1e3 * one),
                    "ours ms": round(1e3 * other),
                    "ratio": round(one / other, 2),
                    "relative difference": float(f"{difference:.1e}"),
                }
            )
    result = {
        "device": options.device,
        "capability": torch.backends.cpu.get_cpu_capability(),
        "threads": threads,
        "vertices": {"step": int(few.num_nodes), "inference": int(many.num_nodes)},
        "rows": rows,
    }
    if options.figure_2:
        result["figure2"] = figure_2(model, [sample.mesh for sample in chosen], threads)
        print(tabulate(result["figure2"], headers="keys"))
    if options.json:
        write_text(options.json, json.dumps(result, indent=1) + "\n")
    print(tabulate(rows, headers="keys"))
    print({key: result[key] for key in ("device", "capability", "threads", "vertices")})


if __name__ == "__main__":
    main()
