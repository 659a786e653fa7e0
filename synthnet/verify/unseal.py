"""Check a sealed set when its salt has been revealed: its seal, its draw, and the set itself."""

import os
from collections.abc import Callable

from synthnet import recipe, store
from synthnet.build.jobs import Watcher
from synthnet.build.versions import build
from synthnet.errors import SealError
from synthnet.verify import checks, seal
from synthnet.verify.report import Check, VerifyReport
from synthnet.verify.seal import Seal

CHECKS = {  # in order, with what each holds
    "commitment": "that of the salt, the version and its recipe, and the share",
    "seal": "recipe, counts and digest of the set that the salt draws",
    **checks.CHECKS,
}


def verify_sealed(
    sealed: Seal,
    salt: bytes,
    *,
    root: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    sample: int = 100,
    seed: int = 0,
    watcher: Watcher | None = None,
    on_shard: Callable[[int, int], None] | None = None,
) -> VerifyReport:
    """Verify that a salt draws the set of a seal, and the set.

    Checks, in order: that the salt gives the commitment; that the recipe it draws is the seal's;
    then builds the set, where it is not built yet, and checks its counts and its digest, and all
    that :func:`synthnet.verify.checks.verify` does. The first check that fails is the last.

    ``root``, ``workers`` and ``watcher`` are as for :func:`synthnet.build.versions.build`;
    ``sample``, ``seed`` and ``on_shard`` as for ``verify``. Raise SealError if the seal is of a
    version of another recipe than this release's, StoreError if its directory holds another set,
    and BuildError as ``build`` does.
    """
    here = recipe.load(sealed.version).digest
    if here != sealed.version_digest:
        raise SealError(
            f"the seal is of {sealed.version} with the recipe {sealed.version_digest[:12]}…, "
            f"here it is {here[:12]}…: install synthnet {sealed.packages.get('synthnet', '')}"
        )
    directory = store.dataset_directory(sealed.dataset, root)
    resolved = seal.sealed_recipe(sealed.version, salt, share=sealed.share, beacon=sealed.beacon)
    assert resolved.sealed is not None
    if resolved.sealed.commitment != sealed.commitment:
        problem = (
            f"commitment: the salt gives {resolved.sealed.commitment[:12]}…, the seal has "
            f"{sealed.commitment[:12]}…: another salt, or the seal was altered"
        )
        return VerifyReport(directory, (Check("commitment", 1, (problem,)),))
    fits = Check("commitment", 1, ())
    if resolved.digest != sealed.recipe_digest:
        problem = (
            f"seal: its recipe is {sealed.recipe_digest[:12]}…, salt and beacon give "
            f"{resolved.digest[:12]}…"
        )
        return VerifyReport(directory, (fits, Check("seal", 1, (problem,))))
    dataset = build(resolved, root=root, workers=workers, watcher=watcher).dataset
    differences = tuple(seal.differences(seal.describe(dataset), sealed))
    same = Check("seal", dataset.manifest.rows, differences)
    if differences:
        return VerifyReport(directory, (fits, same))
    checked = checks.verify(sealed.dataset, root=root, sample=sample, seed=seed, on_shard=on_shard)
    return VerifyReport(directory, (fits, same, *checked.checks))
