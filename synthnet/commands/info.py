"""``synthnet info``: say what a built version holds."""

import argparse
from collections import Counter
from pathlib import Path

from tabulate import tabulate

from synthnet import store
from synthnet.build.importing import file_outcomes
from synthnet.commands.options import add_command
from synthnet.commands.report import family_table, summary
from synthnet.errors import StoreError, counted
from synthnet.mesh.formats import kind_of
from synthnet.recipe import Kind
from synthnet.store import limits, storage
from synthnet.terminal import Commands, print_answer, print_json
from synthnet.types import SPLITS


def add(commands: Commands) -> None:
    """Add the command."""
    sub = add_command(commands, "info", run, "say what a built version holds", "1.0-small")
    sub.add_argument(
        "--ids", action="store_true", help="list the ids of its shapes, and the files of an import"
    )
    sub.add_argument(
        "--shape",
        metavar="ID",
        help="say what became of one shape of an import, by its id or its file, also of one that "
        "was rejected (default: the whole dataset)",
    )


def run(options: argparse.Namespace) -> int:
    """Print the numbers of a dataset, or the ids of its shapes."""
    dataset = store.open_dataset(options.version, options.out)
    manifest = dataset.manifest
    if options.ids:
        ids, files = dataset.ids(), dataset.files()
        if options.json:
            imported = dataset.kind is Kind.IMPORTED
            print_json([{"id": id, "file": files.get(id)} for id in ids] if imported else ids)
        else:
            print("\n".join(f"{id}  {files[id]}" if id in files else id for id in ids))
        return 0
    if options.shape is not None:
        outcome = _outcome(dataset, options.shape)
        text = tabulate(outcome.items(), tablefmt="plain", intfmt=",")
        print_answer(options, outcome, text)
        return 0
    surfaces = _count_limits(dataset)
    if options.json:
        print_json({**summary(manifest), "directory": str(dataset.directory), "limits": surfaces})
        return 0
    print(family_table(manifest))
    size = sum(shard.size for shard in manifest.shards)
    splits = Counter(
        split.as_py() for path in dataset.paths() for split in store.read_table(path, ["split"])[0]
    )
    print(f"\nversion    {manifest.version}  (recipe {manifest.recipe_digest[:12]})")
    print(f"directory  {dataset.directory}")
    print(f"size       {size / 1e6:,.1f} MB in {counted(len(manifest.shards), 'shard')}")
    print(f"limits     {_say_limits(surfaces, dataset.kind)}")
    print("splits     " + ", ".join(f"{name} {splits[name]:,}" for name in SPLITS))
    print("made with  " + ", ".join(f"{k} {v}" for k, v in manifest.packages.items()))
    for rejection in manifest.rejections:
        print(f"rejected   {rejection.id}: {rejection.reason}: {rejection.detail}")
    return 0


def _outcome(dataset: store.StoredDataset, name: str) -> dict[str, str | int]:
    """Return what became of a file, by the name of the file or the id of its shape."""
    if dataset.kind is not Kind.IMPORTED:
        if kind_of(Path(name).name) is not None:
            raise StoreError(dataset.no_file(name))
        dataset.find(name)  # or say that there is none
        version, directory = dataset.manifest.version, dataset.directory.parent
        out = "" if str(directory) == str(store.home()) else f" --out {directory}"
        raise StoreError(f"{version} is no import: `synthnet show {name} --dataset {version}{out}`")
    id = dataset.id_of(name)
    for row in file_outcomes(dataset):
        if row["id"] == id:
            return row
    raise StoreError(dataset.no_file(name))


def _count_limits(dataset: store.StoredDataset) -> dict[str, int]:
    """Count the labels that have a limit, and those with a PSNR of 20 dB or less against it."""
    directory = dataset.directory
    there = [
        record
        for record in dataset.manifest.shards
        if storage.size(limits.path_of(directory, record)) is not None
    ]
    above = [row.above_20_db for shard in there for row in limits.read_shard(directory, shard)]
    return {"labels": len(above), "failing": above.count(False)}


def _say_limits(counts: dict[str, int], kind: Kind) -> str:
    labels, failing = counts["labels"], counts["failing"]
    if not labels:
        imported = kind is Kind.IMPORTED
        return "none: no import has a known surface" if imported else "none (--limits)"
    return (
        f"of {labels:,} labels; {failing:,} of them ({failing / labels:.1%}) have a PSNR of "
        "20 dB or less against their limit"
    )
