"""A sealed hold-out: a fresh test set drawn from a secret salt, and the file that commits to it.

The salt and what the set is to be (version, its recipe, share) give the commitment; these and a
beacon give the seed of the sealed recipe. All of the set is a function of that recipe, so the
published file commits its author to one set, and reveals nothing of it. See docs/sealed.md.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from synthnet import recipe, store
from synthnet.build.jobs import BuildReport, Watcher, is_whole
from synthnet.build.versions import build
from synthnet.errors import DamagedError, RecipeError, SealError, printable
from synthnet.recipe import Recipe, Sealed, SplitSettings
from synthnet.recipe.plan import plan_shards
from synthnet.store import files, pins, storage
from synthnet.store.files import one_line

SCHEMA_VERSION = 1
DOMAIN = "synthnet seal/1"
SALT_BYTES = 32  # 256 bits, no more than a seed has
SALT_MARK = "synthnet-salt-1:"  # so that no other secret or digest is taken for a salt
SALT = re.compile(rf"{SALT_MARK}([0-9a-f]{{{2 * SALT_BYTES}}})\r?\n?".encode())
MOST_BYTES = 1024  # that are read of its file
MOST_LETTERS = 1000  # a beacon may be no longer
ALL_TEST = SplitSettings(0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Seal:
    """What is published of a sealed set: it reveals no parameter, id or label.

    Parameters
    ----------
    dataset : str
        Name of the sealed set, ``2.0-sealed-`` and the beginning of the commitment.
    version, version_digest : str
        The version it was drawn from, and the digest of its recipe.
    share : float
        Surfaces of each family, as a share of the version's.
    beacon : str or None
        Public text that went into the seed, see :func:`sealed_recipe`.
    commitment : str
        SHA-256 of the salt with version, its digest and share.
    recipe_digest : str
        Of the sealed recipe, whose seed is the secret.
    drawn, kept, left_out : mapping of str to int
        By family: shapes of the set, those that no filter rejected, and surfaces left out
        because the version has them.
    meshes : str
        SHA-256 of the seed and all that must be equal on every machine, see :func:`digest`.
    packages : mapping of str to str
        Versions of the packages that made the set.
    """

    dataset: str
    version: str
    version_digest: str
    share: float
    beacon: str | None
    commitment: str
    recipe_digest: str
    drawn: Mapping[str, int]
    kept: Mapping[str, int]
    left_out: Mapping[str, int]
    meshes: str
    packages: Mapping[str, str]


# The salt


def make_salt(path: Path) -> None:
    """Write a new salt of 256 random bits into a file that only its owner may read.

    Raise SealError if a file is there, since a salt that is lost takes its set with it, and
    BuildError if it cannot be written.
    """
    try:
        files.write_secret(path, salt_text(secrets.token_bytes(SALT_BYTES)))
    except FileExistsError as error:
        raise SealError(
            f"{path} is there already, and no salt is overwritten: leave out --new-salt to use "
            "it, or name another file"
        ) from error


def salt_text(salt: bytes) -> str:
    """Return the line of a salt's file: its mark, and hexadecimal digits."""
    return f"{SALT_MARK}{salt.hex()}\n"


def read_salt(path: Path) -> bytes:
    """Read a salt that :func:`make_salt` wrote.

    Raise SealError if it is missing, or anything else: what a person chose could be guessed.
    """
    try:
        with path.open("rb") as file:
            text = file.read(MOST_BYTES)
    except FileNotFoundError as error:
        raise SealError(f"there is no salt {path}: `synthnet seal --new-salt` makes one") from error
    except OSError as error:
        raise SealError(f"cannot read the salt {path} ({error.strerror})") from error
    match = SALT.fullmatch(text)
    if match is None:
        raise SealError(
            f"{path} is no salt: that is one line, {SALT_MARK!r} and {2 * SALT_BYTES} hexadecimal "
            "digits, and `synthnet seal --new-salt` alone makes one"
        )
    return bytes.fromhex(match[1].decode())


def check_secret(path: Path) -> None:
    """Raise SealError if others may read a salt: then its set is none that only its owner knows."""
    mode = path.stat().st_mode & 0o777
    if mode & 0o077:
        raise SealError(
            f"others may read the salt {path} (mode {mode:o}): make another one, or `chmod 600` it "
            "if nobody has"
        )


# From the salt to the recipe


def sealed_recipe(
    version: str, salt: bytes, *, share: float | None = None, beacon: str | None = None
) -> Recipe:
    """Return the recipe of the set that a salt draws.

    Commitment and seed are SHA-256 of a purpose, what the set is to be, and the salt; the seed's
    with the beacon. So a commitment can be published before the beacon is known, and the set
    is then neither of the drawer's choice nor of anyone else's.

    Parameters
    ----------
    version : str
        What it is drawn from, by its distributions: a version that is not scaled.
    salt : bytes
        Of :func:`read_salt`.
    share : float, optional
        Surfaces of each family, as a share of the version's, at least one of each; by
        default the version's share of test shapes.
    beacon : str, optional
        Public text on one line that nobody could choose, such as a round of drand.

    Raises
    ------
    RecipeError
        If there is no such version, or it is scaled.
    SealError
        If share or beacon will not do.

    Examples
    --------
    >>> sealed = sealed_recipe("1.0-mini", bytes(range(32)))
    >>> sealed.version, sealed.count
    ('1.0-mini-sealed-639ce4db0ff0', 34)
    """
    base = recipe.load(version)
    share = base.splits.test if share is None else share
    check_terms(base, share, beacon)
    if beacon is not None:  # or its spelling could be chosen
        beacon = " ".join(beacon.split()).lower()
    terms: dict[str, Any] = {"of": version, "digest": base.digest, "share": share}
    commitment = _derived("commitment", terms, salt)
    sealed = Sealed(**terms, commitment=commitment, beacon=beacon)
    return _recipe(base, sealed, int(_derived("seed", {**terms, "beacon": beacon}, salt), 16))


def recipe_of(dataset: store.StoredDataset) -> Recipe:
    """Return the recipe of a sealed set that has been built; no salt is needed for that.

    Raise DamagedError if the manifest has none.
    """
    stored = dataset.manifest.recipe
    try:
        sealed = Sealed(**stored["sealed"])
        return _recipe(recipe.load(sealed.of), sealed, int(stored["seed"]))
    except (KeyError, TypeError, ValueError) as error:
        raise DamagedError(
            f"{dataset.directory} is no sealed set ({one_line(error)}): remove it and seal again"
        ) from error


def _recipe(base: Recipe, sealed: Sealed, seed: int) -> Recipe:
    families = {}
    for name, family in base.families.items():
        surfaces = max(1, round(sealed.share * (base.drawn(name) // base.copies)))
        families[name] = replace(family, count=surfaces * base.copies)
    return replace(
        base,
        version=_name(sealed.of, sealed.commitment),
        seed=seed,
        splits=ALL_TEST,
        families=families,
        subset=None,
        sealed=sealed,
    )


def _name(version: str, commitment: str) -> str:
    return f"{version}-sealed-{commitment[:12]}"


def _derived(purpose: str, terms: Mapping[str, Any], salt: bytes) -> str:
    """Return the SHA-256 of what precedes the salt, at a fixed length, and the salt."""
    text = json.dumps(terms, sort_keys=True, separators=(",", ":"))
    head = f"{DOMAIN} {purpose}\n{hashlib.sha256(text.encode()).hexdigest()}\n"
    return hashlib.sha256(head.encode() + salt).hexdigest()


def check_terms(base: Recipe, share: float | None, beacon: str | None) -> None:
    """Raise RecipeError or SealError if a version cannot be sealed, or not on these terms."""
    if base.scale is not None:
        raise RecipeError(f"{base.version} is scaled: seal what it came from")
    if share is not None and not 0 < share <= 1:
        raise SealError(f"--share must be above 0, at most 1, got {share:g}")
    if beacon is not None and not (
        beacon.isascii() and beacon.isprintable() and 1 <= len(beacon.strip()) <= MOST_LETTERS
    ):
        raise SealError(
            f"--beacon must be 1 to {MOST_LETTERS} printable ASCII letters on one line, got "
            f"{printable(beacon[:40])!r}"
        )


# From the recipe to the set and its seal


def make(
    resolved: Recipe,
    *,
    root: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    watcher: Watcher | None = None,
    wait_for_lock: bool = False,
) -> tuple[Seal, BuildReport]:
    """Build a sealed set, in a directory and files that only their owner may open; describe it.

    Raises
    ------
    StoreError
        If its location is no directory on this machine, or holds another set.
    BuildError
        As :func:`synthnet.build.versions.build`, which goes on where it was stopped.
    """
    location = store.dataset_directory(resolved.version, root)
    directory = storage.local(location, resolved.version)
    files.make_directory(directory)
    directory.chmod(0o700)
    before = os.umask(0o077)  # of the workers too: the manifest holds the seed
    try:
        report = build(
            resolved, root=root, workers=workers, watcher=watcher, wait_for_lock=wait_for_lock
        )
    finally:
        os.umask(before)
    (directory / store.MANIFEST).chmod(0o600)
    return describe(report.dataset), report


def describe(dataset: store.StoredDataset) -> Seal:
    """Return the seal of a set that has been built, or raise StoreError if it is damaged."""
    resolved = recipe_of(dataset)
    assert resolved.sealed is not None
    manifest = dataset.manifest
    last = {
        shape.spec.family: shape.spec for plan in plan_shards(resolved) for shape in plan.shapes
    }
    kept = dict.fromkeys(manifest.drawn, 0)
    for shard in manifest.shards:
        kept[shard.family] += shard.rows
    return Seal(
        dataset=manifest.version,
        version=resolved.sealed.of,
        version_digest=resolved.sealed.digest,
        share=resolved.sealed.share,
        beacon=resolved.sealed.beacon,
        commitment=resolved.sealed.commitment,
        recipe_digest=manifest.recipe_digest,
        drawn=dict(manifest.drawn),
        kept=kept,
        left_out={
            family: (spec.index + 1 - resolved.drawn(family)) // resolved.copies
            for family, spec in last.items()
        },
        meshes=digest(dataset, resolved.seed),
        packages=dict(manifest.packages),
    )


def digest(dataset: store.StoredDataset, seed: int) -> str:
    """Hash what must be equal on every machine: ids, parameters, groups, splits, faces.

    Vertices and labels are left out, since their last bits differ between machines; they are
    functions of what is hashed. The seed goes in, so that no guess at a shape can be tried.
    """
    state = hashlib.sha256(f"{DOMAIN} meshes\n{seed:064x}\n".encode())
    for sample in dataset.samples():
        state.update(f"{pins.digest(sample)}\n".encode())
    for rejection in sorted(dataset.manifest.rejections, key=lambda r: r.id):
        state.update(f"{rejection.id} {rejection.reason}\n".encode())
    return state.hexdigest()


def differences(built: Seal, published: Seal) -> Iterator[str]:
    """Yield what differs between two seals, but for the packages."""
    for field in fields(Seal):
        here, there = getattr(built, field.name), getattr(published, field.name)
        if here != there and field.name != "packages":
            name = field.name.replace("_", " ")
            yield f"seal: its {name} is {_short(there)}, the set here has {_short(here)}"


def _short(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {count}" for key, count in value.items())
    text = str(value)
    return f"{text[:12]}…" if len(text) == hashlib.sha256().digest_size * 2 else text


def open_checked(expected: Seal, root: str | os.PathLike[str] | None = None) -> store.StoredDataset:
    """Open the set of a seal, every byte as it was built, and the one that the seal is of.

    Raise StoreError if it is not here, or damaged, and SealError if it is another.
    """
    dataset = store.open_dataset(expected.dataset, root)
    for shard in dataset.manifest.shards:
        if not is_whole(dataset.directory / shard.file, shard):
            raise DamagedError(
                f"{dataset.directory / shard.file} is damaged: remove it and seal again, "
                "with the same salt"
            )
    for difference in differences(describe(dataset), expected):
        raise SealError(f"{dataset.directory} is not the set that was sealed: {difference}")
    return dataset


# The file


def write(path: Path, seal: Seal) -> None:
    """Write the file to publish; the same set gives the same bytes.

    Raise SealError if another file is there, and BuildError if it cannot be written.
    """
    text = store.with_digest({"schema_version": SCHEMA_VERSION, **asdict(seal)})
    if path.exists() and path.read_bytes() != text.encode():
        raise _taken(path)
    files.write_text(path, text)


def check_free(path: Path, resolved: Recipe) -> None:
    """Raise SealError if a file is there that is no seal of the set of a recipe."""
    if not path.exists():
        return
    try:
        there = read(path).recipe_digest
    except SealError as error:
        raise _taken(path) from error
    if there != resolved.digest:
        raise _taken(path)


def _taken(path: Path) -> SealError:
    return SealError(
        f"{path} is there and is not this seal: nothing is overwritten, name another --publish"
    )


def read(path: Path) -> Seal:
    """Read the file that was published.

    Raise SealError if it is missing, no seal, of another schema, altered, or contradicts itself.
    """
    try:
        content, whole = store.without_digest(path.read_bytes())
        schema = content.pop("schema_version")
        if schema != SCHEMA_VERSION:
            raise SealError(
                f"{path} has schema version {schema}, this synthnet reads {SCHEMA_VERSION}: "
                "install a matching release"
            )
        seal = Seal(**content)
        _check_types(seal)
    except FileNotFoundError as error:
        raise SealError(f"there is no seal {path}") from error
    except OSError as error:
        raise SealError(f"cannot read the seal {path} ({error.strerror})") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SealError(f"{path} is no seal: {one_line(error)}") from error
    if not whole:
        raise SealError(f"{path} was altered: its SHA-256 is not that of its content")
    if seal.dataset != _name(seal.version, seal.commitment):
        raise SealError(
            f"{path} contradicts itself: {seal.dataset} is not the set of {seal.version} with the "
            f"commitment {seal.commitment[:12]}…"
        )
    return seal


def _check_types(seal: Seal) -> None:
    """Raise TypeError or ValueError where a value is of the wrong kind."""
    for field in fields(Seal):
        value = getattr(seal, field.name)
        kinds = {"float": (float, int), "str": (str,), "str | None": (str, type(None))}
        if type(value) not in kinds.get(str(field.type), (dict,)):
            raise TypeError(f"{field.name} is {value!r}")
    for name in ("version_digest", "commitment", "recipe_digest", "meshes"):
        if not re.fullmatch(r"[0-9a-f]{64}", getattr(seal, name)):
            raise ValueError(f"{name} is no SHA-256")
