"""Results and predictions as files: what they hold, and what is checked when they are read."""

from eigbench.results.result import (
    SCHEMA_VERSION,
    check_cost,
    check_schema,
    dataset_facts,
    declared,
    load,
    overused,
    put,
    read,
    schema,
    setting,
    title,
    validate,
    write,
)

__all__ = [
    "SCHEMA_VERSION",
    "check_cost",
    "check_schema",
    "dataset_facts",
    "declared",
    "load",
    "overused",
    "put",
    "read",
    "schema",
    "setting",
    "title",
    "validate",
    "write",
]
