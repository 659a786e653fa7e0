"""Train the network of baselines/gcn_scale_free.py on 2.0 under its protocols, until it converges.

    python -m baselines.train_scale_free --runs runs
    python -m baselines.train_scale_free --runs runs --only genus --threads 1

The network, its loss and its schedule are those of `table2-alg-scale-free` on 1.0, and so is the
rule that ends a training. By default it is trained with everything and once for each protocol but
`family`, which asks for a training without each of 20 groups of families: half an hour each on one
core. What is finished in --runs is left as it is, an interrupted training goes on. When all of
these are finished, the weights go to baselines/gcn_scale_free.safetensors.
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
from baselines.gcn.configs import SCALE_FREE
from baselines.gcn.run import CHECKPOINT, WEIGHTS, Run
from baselines.gcn.train import loop, progress_of
from synthnet.store.files import make_directory

OUT = Path(__file__).parent / "gcn_scale_free.safetensors"
VERSION = "2.0"
VERTICES = 1000  # of a mesh; of larger ones a share is trained on, see gcn.sampled
CONFIG = replace(SCALE_FREE["table2-alg-scale-free"], vertices=0)  # the share is drawn already
TRAINED = ("grouped", "resolution", "genus", "boundary")
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
        "--only",
        nargs="+",
        choices=protocols(VERSION),
        default=TRAINED,
        metavar="PROTOCOL",
        help=f"train these (default: {' '.join(TRAINED)})",
    )
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1, help="one a core")
    options = parser.parse_args()
    torch.set_num_threads(1)  # meshes are shared out among threads, not their operations
    console = Console(stderr=True)
    console.print(f"Encoding a share of {VERSION}")
    shapes = sampled.load(VERSION, CONFIG.model, VERTICES, threads=options.threads)
    console.print(
        f"{len(shapes.ids):,} meshes, {sum(len(g.features) for g in shapes.graphs):,} vertices"
    )
    same = trained_as(shapes)
    folders = {name: options.runs / same[name].replace("/", "-") for name in protocols(VERSION)}
    for protocol in dict.fromkeys(same[name] for name in options.only):
        out = folders[protocol]
        if (out / WEIGHTS).exists():
            continue
        make_directory(out)
        console.print(protocol)
        run = Run(
            CONFIG,
            shapes,
            protocol=protocol,
            seed=SEED,
            out=out,
            device=torch.device("cpu"),
            dtype=torch.bfloat16,  # its fastest, where the processor multiplies it
            threads=options.threads,
        )
        if (out / CHECKPOINT).exists():
            run.resume()
        stopped = loop(run, None, console)
        run.save()
        if stopped == "interrupted":
            return 130
        run.finish()
        print(progress_of(run), flush=True)
    finished = {
        training_set(VERSION, name): out / WEIGHTS
        for name, out in folders.items()
        if (out / WEIGHTS).exists()
    }
    left = [name for name in TRAINED if training_set(VERSION, name) not in finished]
    if left:  # the file of before may hold them
        print(f"{OUT} is as it was: {options.runs} lacks {', '.join(left)}")
    else:
        trainings.gather(OUT, finished, vertices=VERTICES)
        print(f"{OUT}: {', '.join(finished)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
