"""``synthnet versions``: list what can be built, and what is there."""

from __future__ import annotations

import argparse

from tabulate import tabulate

from synthnet import recipe, store
from synthnet.commands.options import add_command
from synthnet.terminal import Commands, print_json


def add(commands: Commands) -> None:
    """Add the command."""
    add_command(commands, "versions", run, "list what can be built", version=False)


def run(options: argparse.Namespace) -> int:
    """List the versions, and the imports, sealed sets and scaled versions that are there."""
    rows = []
    known, there = recipe.available(), store.there(options.out)
    for name in known:
        version, manifest = recipe.load(name), there.get(name)
        built = manifest is not None and manifest.recipe_digest == version.digest
        rows.append({"version": name, "shapes": version.count, "built": built})
    for name, manifest in there.items():
        if name not in known:
            rows.append({"version": name, "shapes": manifest.rows, "built": True})
    if options.json:
        print_json(rows)
        return 0
    print(tabulate([{**r, "built": "yes" if r["built"] else "no"} for r in rows], headers="keys"))
    print(f"\nin {store.home(options.out)}")
    return 0
