"""The dataset on disk or at a URL: shards, manifest, and the pins that the repository keeps."""

from synthnet.store.datasets import (
    StoredDataset,
    dataset_directory,
    home,
    known_names,
    open_dataset,
    open_unversioned,
    there,
)
from synthnet.store.imports import ImportDescription, description_of
from synthnet.store.manifest import (
    DIGEST,
    MANIFEST,
    read_manifest,
    with_digest,
    without_digest,
    write_manifest,
)
from synthnet.store.shards import (
    METADATA_KEY,
    SCHEMA,
    SCHEMA_VERSION,
    read_labels,
    read_record,
    read_samples,
    read_table,
    recipe_digest_of,
    write_shard,
)

__all__ = [
    "DIGEST",
    "MANIFEST",
    "METADATA_KEY",
    "SCHEMA",
    "SCHEMA_VERSION",
    "ImportDescription",
    "StoredDataset",
    "dataset_directory",
    "description_of",
    "home",
    "known_names",
    "open_dataset",
    "open_unversioned",
    "read_labels",
    "read_manifest",
    "read_record",
    "read_samples",
    "read_table",
    "recipe_digest_of",
    "there",
    "with_digest",
    "without_digest",
    "write_manifest",
    "write_shard",
]
