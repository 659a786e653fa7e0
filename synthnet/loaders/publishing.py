"""What a repository of datasets asks for beside the files of a built version.

Zenodo's metadata, the card and the benchmark of the Hugging Face Hub, Croissant, and a list of
digests that ``sha256sum --check`` reads; nothing is sent anywhere.

References
----------
Zenodo, "Developers: deposit metadata", https://developers.zenodo.org; Hugging Face Hub, "Dataset
cards" and "Evaluation results", https://huggingface.co/docs/hub.
"""

from __future__ import annotations

import json
from typing import Any

from synthnet import store
from synthnet.loaders import croissant
from synthnet.store import StoredDataset, limits, storage
from synthnet.store.storage import Location, write_text
from synthnet.version import __version__

ZENODO, CARD, EVALUATION, SUMS = "zenodo.json", "README.md", "eval.yaml", "SHA256SUMS"
PAPER = "https://proceedings.mlr.press/v251/wu24a.html"
KEYWORDS = ["Laplace-Beltrami operator", "geometric deep learning", "spectral geometry"]
SIZES = {1_000: "n<1K", 10_000: "1K<n<10K", 100_000: "10K<n<100K", 1_000_000: "100K<n<1M"}


def write(dataset: StoredDataset) -> list[Location]:
    """Write all of it beside the manifest of a built version, and return the paths.

    The same dataset gives the same bytes.

    Raises
    ------
    StoreError
        If the dataset is an import or a sealed set, whose licence and authors are not known
        here.
    BuildError
        If a file cannot be written.
    """
    texts = {
        ZENODO: json.dumps(zenodo(dataset), indent=1, ensure_ascii=False) + "\n",
        CARD: card(dataset),
        EVALUATION: evaluation(dataset),
    }
    paths = [croissant.write(dataset)]
    for name, text in texts.items():
        paths.append(dataset.directory / name)
        write_text(paths[-1], text)
    named = [path.name for path in paths]
    paths.append(dataset.directory / SUMS)
    write_text(paths[-1], sums(dataset, named))
    return paths


def zenodo(dataset: StoredDataset) -> dict[str, Any]:
    """Return what Zenodo's interface takes as ``metadata``, JSON-ready."""
    metadata = croissant.metadata(dataset)
    return {
        "title": f"{metadata['name']}: triangle meshes with certified Laplace-Beltrami spectra",
        "upload_type": "dataset",
        "description": f"<p>{metadata['description']}</p><p>Recipe digest "
        f"{dataset.manifest.recipe_digest}.</p>",
        "creators": [{"name": metadata["creator"]["name"]}],
        "access_right": "open",
        "license": "MIT",
        "version": metadata["version"],
        "publication_date": metadata["datePublished"],
        "language": "eng",
        "keywords": KEYWORDS,
        "related_identifiers": [
            {"identifier": PAPER, "relation": "isDerivedFrom", "scheme": "url"},
        ],
        "notes": f"Made with synthnet {__version__}.",
    }


def card(dataset: StoredDataset) -> str:
    """Return the card of a dataset on the Hugging Face Hub: facts in YAML, then text."""
    metadata, rows = croissant.metadata(dataset), dataset.manifest.rows
    size = next((name for most, name in SIZES.items() if rows < most), "1M<n<10M")
    facts = {
        "pretty_name": metadata["name"],
        "license": "mit",
        "annotations_creators": ["machine-generated"],
        "source_datasets": ["original"],
        "size_categories": [size],
        "task_categories": ["graph-ml"],
        "tags": KEYWORDS,
        "configs": [
            {
                "config_name": "default",
                "data_files": [{"split": "all", "path": "shards/*.parquet"}],
            }
        ],
    }
    families = "\n".join(f"| {name} | {n:,} |" for name, n in dataset.manifest.drawn.items())
    limitations = "\n".join(f"- {text}" for text in metadata["rai:dataLimitations"])
    return (
        f"---\n{_yaml(facts)}---\n\n# {metadata['name']}\n\n{metadata['description']}\n\n"
        "A row is a shape; the column `split` says whether it is of train, validation or test, and "
        "`eigenvalues` is its label. `croissant.json` describes every column, "
        f"`{SUMS}` has the digest of every file. The labels of all splits are here: what is "
        "trained must not read those of `test`.\n\n"
        f"Recipe digest {dataset.manifest.recipe_digest}.\n\n"
        f"| family | drawn |\n| --- | --: |\n{families}\n\n## Limitations\n\n{limitations}\n\n"
        f"## Citation\n\n```bibtex\n{metadata['citeAs']}\n```\n"
    )


def evaluation(dataset: StoredDataset) -> str:
    """Return the registration of a benchmark on the Hugging Face Hub, in YAML."""
    metadata = croissant.metadata(dataset)
    return _yaml(
        {
            "name": metadata["name"],
            "description": f"{metadata['description']} Scored on the rows whose `split` is `test`.",
            "evaluation_framework": "eigbench",
            "tasks": [{"id": "spectrum", "config": "default", "split": "all"}],
        }
    )


def sums(dataset: StoredDataset, more: list[str]) -> str:
    """Return the digests of the manifest, shards, limits and other files, as ``sha256sum`` does."""
    digests = {shard.file: shard.sha256 for shard in dataset.manifest.shards}
    beside = [f"{limits.DIRECTORY}/{file.rpartition('/')[2]}" for file in digests]
    for name in (store.MANIFEST, *beside, *more):
        if storage.size(dataset.directory / name) is not None:
            digests[name] = storage.sha256(dataset.directory / name)
    return "".join(f"{digest}  {name}\n" for name, digest in sorted(digests.items()))


def _yaml(facts: dict[str, Any]) -> str:
    """Return facts as YAML, a key a line; JSON is YAML, and so are its values."""
    lines = (f"{key}: {json.dumps(value, ensure_ascii=False)}\n" for key, value in facts.items())
    return "".join(lines)
