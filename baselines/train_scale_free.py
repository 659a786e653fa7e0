"""Train the network of baselines/gcn_scale_free.py on 2.0 under each of its protocols.

    python -m baselines.train_scale_free --runs runs

It is trained once with everything, once for each protocol and once without each family, where
families that share surfaces are left out together: 24 trainings of two to seven minutes on two
cores. (The committed weights are of 26, by an earlier rule of which families do.) What is
finished in --runs is left as it is, an interrupted training goes on. When all are finished their
weights go to baselines/gcn_scale_free.safetensors.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

import torch
from eigbench.scoring.training import protocols, training_set
from rich.console import Console

from baselines.gcn import sampled, trainings
from baselines.gcn.configs import CONFIGS
from baselines.gcn.run import CHECKPOINT, WEIGHTS, Run
from baselines.gcn.train import loop, progress_of
from synthnet.store.files import make_directory

OUT = Path(__file__).parent / "gcn_scale_free.safetensors"
VERSION = "2.0"
VERTICES = 1000  # of a mesh; of larger ones a share is trained on, see gcn.sampled
EPOCHS = 4
SEED = 0


def trained_as(shapes: sampled.Sampled) -> dict[str, str]:
    """Return of each training the first that uses the same meshes, mostly itself."""
    first: dict[bytes, str] = {}
    used = {name: shapes.instances("train", name).numpy().tobytes() for name in protocols(VERSION)}
    return {name: first.setdefault(key, name) for name, key in used.items()}


def main() -> int:
    """Train what is not trained yet; return 130 if interrupted."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=Path, required=True, help="directory of the checkpoints")
    parser.add_argument(
        "--only", nargs="+", choices=protocols(VERSION), metavar="PROTOCOL", help="train these"
    )
    options = parser.parse_args()
    config = replace(CONFIGS["modern"], epochs=EPOCHS)
    threads = os.cpu_count() or 1
    torch.set_num_threads(1)  # meshes are shared out among threads, not their operations
    console = Console(stderr=True)
    console.print(f"Encoding a share of {VERSION}")
    shapes = sampled.load(VERSION, config.model, VERTICES, threads=threads)
    console.print(
        f"{len(shapes.ids):,} meshes, {sum(len(g.features) for g in shapes.graphs):,} vertices"
    )
    same = trained_as(shapes)
    folders = {name: options.runs / same[name].replace("/", "-") for name in protocols(VERSION)}
    for protocol in dict.fromkeys(same[name] for name in options.only or protocols(VERSION)):
        out = folders[protocol]
        if (out / WEIGHTS).exists():
            continue
        make_directory(out)
        console.print(protocol)
        run = Run(
            config,
            shapes,
            protocol=protocol,
            seed=SEED,
            out=out,
            device=torch.device("cpu"),
            threads=threads,
        )
        if (out / CHECKPOINT).exists():
            run.resume()
        stopped = loop(run, None, console)
        run.save()
        if stopped != "done":
            return 130
        run.finish()
        print(progress_of(run), flush=True)
    finished = {training_set(VERSION, name): out / WEIGHTS for name, out in folders.items()}
    if missing := [name for name, file in finished.items() if not file.exists()]:
        print(f"{OUT} is as it was: {len(missing)} trainings are missing, such as {missing[0]}")
        return 0
    trainings.gather(OUT, finished, vertices=VERTICES)
    print(f"{OUT}: {len(finished)} trainings")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
