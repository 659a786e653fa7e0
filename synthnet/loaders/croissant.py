"""Croissant 1.1 metadata of a built version: JSON-LD beside its manifest.

It names every shard with its SHA-256, every column with its type and shape, the splits, licence
and citation, so that tools that know Croissant can find, check and load the records.

References
----------
MLCommons, "Croissant Format Specification 1.1", http://mlcommons.org/croissant/1.1; "Croissant
RAI Specification 1.0", http://mlcommons.org/croissant/RAI/1.0.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from synthnet import recipe, store
from synthnet.errors import StoreError
from synthnet.recipe import Kind
from synthnet.store import StoredDataset
from synthnet.store.storage import Location, write_text
from synthnet.types import SPLITS
from synthnet.version import __version__

FILE = "croissant.json"
CONFORMS_TO = ("http://mlcommons.org/croissant/1.1", "http://mlcommons.org/croissant/RAI/1.0")
LICENCE = "https://spdx.org/licenses/MIT.html"
PARQUET = "application/x-parquet"
MESHES = ("isometries", "vertices", "faces")  # the columns that take time to load

# The specification's context, appendix 1, and the RAI vocabulary: first the terms of Croissant's
# own vocabulary that keep their names there, then the others.
OWN_TERMS = """
    arrayShape citeAs column containedIn equivalentProperty extract field fileObject
    fileProperty fileSet format includes isArray isLiveDataset jsonPath key md5 parentField
    path recordSet references regex repeated replace samplingRate separator source subField
    transform
"""
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "name": {"@container": "@language"},
    "rai": "http://mlcommons.org/croissant/RAI/",
    "sc": "https://schema.org/",
    **{term: f"cr:{term}" for term in OWN_TERMS.split()},
}


@dataclass(frozen=True, slots=True)
class About:
    """What a full version is, for people.

    Parameters
    ----------
    semantic : str
        Its version as Croissant counts: major, data changed; minor, data added.
    frozen : str
        The day on which its recipe was frozen.
    description : str
        What it holds.
    biases, limitations : tuple of str
        As the dataset card has them, in short.
    """

    semantic: str
    frozen: str
    description: str
    biases: tuple[str, ...]
    limitations: tuple[str, ...]


LITTLE_VARIETY = (
    "All shapes are synthetic; the families differ in number, and those with one parameter have "
    "little variety."
)
NO_OUTSIDE = "A Möbius band has no outside: what relies on consistent normals fails there."
ABOUT = {
    "1.0": About(
        semantic="1.0.0",
        frozen="2026-11-21",
        description=(
            "Closed triangle meshes of ten families of primitives, drawn as Wu, Fu, Peng and "
            "Chen describe (GRaM workshop at ICML 2024), each labelled with the first ten "
            "eigenvalues after zero of its Laplace-Beltrami operator"
        ),
        biases=(
            "All shapes are synthetic, closed, of genus 0 or 1 and low in detail; the families "
            "differ in number.",
        ),
        limitations=(
            "Results do not speak for scanned or modelled meshes, nor for other topologies.",
            "Split cones and the caps of cylinders and frustums are coarse, so their labels are "
            "well above the smooth surface's spectrum.",
            "Spheres and split spheres are one surface in many meshes.",
        ),
    ),
    "2.0": About(
        semantic="2.0.0",
        frozen="2026-11-22",
        description=(
            "Triangle meshes of 25 families, each surface in three triangulations: genus up to "
            "7, boundaries, a surface with one side, organic and sharp shapes; each labelled "
            "with the first ten eigenvalues after zero of its Laplace-Beltrami operator, "
            "Neumann's condition on a boundary"
        ),
        biases=(LITTLE_VARIETY,),
        limitations=(
            "Results do not speak for scanned or modelled meshes.",
            NO_OUTSIDE,
            "Pretzels have slivers that do not lie along the surface where charts meet the rim.",
        ),
    ),
    "2.1": About(
        semantic="2.1.0",
        frozen="2026-11-26",
        description=(
            "The triangle meshes of synthNet 2.0 and those of seven families more: parts like "
            "those of computer-aided design (unions of boxes, lattices, perforated plates, sheet "
            "metal, rounded boxes, shafts) and folded balls like a cortex, each surface in three "
            "triangulations; each labelled with the first ten eigenvalues after zero of its "
            "Laplace-Beltrami operator, Neumann's condition on a boundary"
        ),
        biases=(LITTLE_VARIETY,),
        limitations=(
            "Parts and folded balls are nearer to real meshes than the rest, but results on them "
            "do not replace results on real ones.",
            "Their triangulations are those of 2.0: none has the long needles of CAD exports.",
            "Coarse meshes of folded balls do not resolve their valleys, so that their labels are "
            "far from the surface's spectrum.",
            NO_OUTSIDE,
        ),
    ),
}
USE_CASES = (
    "Training and testing predictors of Laplace-Beltrami spectra of triangle meshes, and studying "
    "how they generalise. Not for shapes with a meaning to people, and not for physical design.",
)

COLUMNS: dict[str, tuple[str, str]] = {  # of store.SCHEMA: type, and what it is
    "id": ("sc:Text", "Family and number, the same in every subset of a version"),
    "family": ("sc:Text", "Family of the shape"),
    "index": ("cr:Int32", "Number of the draw within the family, from 0"),
    "parameters": ("sc:Text", "JSON object of the generator's arguments"),
    "group": ("sc:Text", "Hash of what makes two shapes the same; it never crosses a split"),
    "split": ("sc:Text", "Split of the shape: train, validation or test"),
    "paper_splits": ("sc:Text", "Split of each instance under the protocol of the paper"),
    "eigenvalues": ("cr:Float64", "The label: eigenvalues after zero, ascending, in 1/length²"),
    "trivial": ("cr:Float64", "The computed value of the zero eigenvalue"),
    "count": ("cr:Int32", "Certificate: eigenvalues below the shift, zero included"),
    "shift": ("cr:Float64", "Certificate: where they were counted, in 1/length²"),
    "residual": ("cr:Float64", "Certificate: largest relative residual"),
    "isometries": ("cr:Float64", "3×3 matrices of the instances by rows, the first the identity"),
    "vertices": ("cr:Float32", "Coordinates; one unit is the radius or width of the primitive"),
    "faces": ("cr:Int32", "Vertex numbers of each triangle, from 0"),
}


def write(dataset: StoredDataset) -> Location:
    """Write the metadata of a built version beside its manifest, and return its path.

    Raises
    ------
    StoreError
        If the dataset is an import, a sealed set or of a recipe of your own, whose licence and
        authors are not known here, or of a version that has no words in ``ABOUT``.
    BuildError
        If the file cannot be written.
    """
    path = dataset.directory / FILE
    text = json.dumps(metadata(dataset), indent=1, ensure_ascii=False)
    write_text(path, text + "\n")
    return path


def metadata(dataset: StoredDataset) -> dict[str, Any]:
    """Return the metadata of a built version as JSON-ready data; the same at each call.

    Records load from the directory that the file lies in: ``labels`` has every column but the
    meshes, ``shapes`` has all.

    Raises
    ------
    StoreError
        As :func:`write`.
    """
    manifest = dataset.manifest
    about, resolved = _about(manifest.version)
    return {
        "@context": dict(sorted(CONTEXT.items())),
        "@type": "sc:Dataset",
        "conformsTo": list(CONFORMS_TO),
        "name": f"synthNet {manifest.version}",
        "description": f"{about.description}. {manifest.rows:,} meshes{_part(resolved)}.",
        "version": about.semantic,
        "datePublished": about.frozen,
        "license": LICENCE,
        "url": "./",  # these files: they are built in place, and have no other address
        "creator": {"@type": "sc:Organization", "name": "The synthNet authors"},
        "keywords": ["Laplace-Beltrami operator", "geometric deep learning", "triangle meshes"],
        "isLiveDataset": False,
        "citeAs": (
            "@software{synthnet, title = {synthNet and eigbench}, "
            "author = {{The synthNet authors}}, "
            f"version = {{{__version__}}}, note = {{dataset {manifest.version}}}}}"
        ),
        **_responsible(about),
        "distribution": _distribution(dataset),
        "recordSet": [
            _splits(),
            _records("labels", [c for c in COLUMNS if c not in MESHES], resolved, manifest.rows),
            _records("shapes", list(COLUMNS), resolved, manifest.rows),
        ],
    }


def _about(version: str) -> tuple[About, recipe.Recipe]:
    name = recipe.parse_name(version)
    if name.kind is Kind.SEALED or name.version not in recipe.available():
        raise StoreError(
            f"{version} is no version of synthNet: an import, a sealed set or what your own recipe "
            "made has its own authors and licence, so write its Croissant metadata by hand"
        )
    base = recipe.load(name.version).base
    if base not in ABOUT:
        raise StoreError(f"{base} has no words of its own: add them to ABOUT in {__file__}")
    return ABOUT[base], recipe.load(version)


def _part(resolved: recipe.Recipe) -> str:
    if resolved.kind is Kind.SCALED:
        source = recipe.parse_name(resolved.version).version
        return f", drawn by the distributions of {source}, all new"
    if resolved.subset is not None:
        return f" of {resolved.subset.of}, with the same ids, splits and labels"
    return ""


def _responsible(about: About) -> dict[str, Any]:
    """Return what the RAI vocabulary asks and the project can answer."""
    return {
        "rai:dataCollection": (
            "Generated by `synthnet build` from a frozen recipe: parameters are drawn from "
            "stated distributions, meshes made from them and checked by named filters."
        ),
        "rai:dataCollectionType": ["Others"],
        "rai:dataCollectionMissingData": (
            "None: a shape that a filter refuses is left out, and the manifest says why."
        ),
        "rai:dataPreprocessingProtocol": ["Vertices are rounded to float32. Nothing is repaired."],
        "rai:dataAnnotationProtocol": [
            "Labels are computed by linear finite elements and a certified eigenvalue solver."
        ],
        "rai:machineAnnotationTools": [f"synthnet {__version__}"],
        "rai:dataBiases": list(about.biases),
        "rai:dataLimitations": list(about.limitations),
        "rai:dataUseCases": list(USE_CASES),
        "rai:personalSensitiveInformation": ["None: the shapes are mathematical surfaces."],
        "rai:dataReleaseMaintenancePlan": (
            "A version is frozen. What would change a mesh, a split or a label becomes a new one, "
            "and the changelog says why."
        ),
    }


def _distribution(dataset: StoredDataset) -> list[dict[str, Any]]:
    """Return the files with their digests, and the set of all shards, from which records come."""
    files = [
        _file(shard.file, PARQUET, shard.sha256, shard.size) for shard in dataset.manifest.shards
    ]
    written = (dataset.directory / store.MANIFEST).read_bytes()
    digest = hashlib.sha256(written).hexdigest()
    shards = {
        "@type": "cr:FileSet",
        "@id": "shards",
        "name": "shards",
        "description": "All shards; each holds shapes of one family, in order.",
        "encodingFormat": PARQUET,
        "includes": "shards/*.parquet",
    }
    return [_file(store.MANIFEST, "application/json", digest, len(written)), *files, shards]


def _file(name: str, kind: str, digest: str, size: int) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name.rpartition("/")[2],
        "contentUrl": name,
        "contentSize": f"{size} B",
        "encodingFormat": kind,
        "sha256": digest,
    }


def _splits() -> dict[str, Any]:
    kinds = ("cr:TrainingSplit", "cr:ValidationSplit", "cr:TestSplit")
    return {
        "@type": "cr:RecordSet",
        "@id": "splits",
        "name": "splits",
        "description": "The splits of the protocol `grouped`: equal shapes are in one split.",
        "dataType": "cr:Split",
        "key": {"@id": "splits/name"},
        "field": [
            {"@type": "cr:Field", "@id": f"splits/{name}", "name": name, "dataType": kind}
            for name, kind in (("name", "sc:Text"), ("url", "sc:URL"))
        ],
        "data": [
            {"splits/name": name, "splits/url": kind}
            for name, kind in zip(SPLITS, kinds, strict=True)
        ],
    }


def _records(
    name: str, columns: Sequence[str], resolved: recipe.Recipe, rows: int
) -> dict[str, Any]:
    contents = "all columns" if "vertices" in columns else "all but the meshes"
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": f"One record a mesh, {rows:,} in all: {contents}.",
        "key": {"@id": f"{name}/id"},
        "field": [_field(name, column, resolved) for column in columns],
    }


def _field(records: str, column: str, resolved: recipe.Recipe) -> dict[str, Any]:
    kind, text = COLUMNS[column]
    instances = resolved.augmentation.instances
    shapes = {
        "paper_splits": f"{instances}",
        "eigenvalues": f"{resolved.label.eigenvalues}",
        "isometries": f"{instances},9",
        "vertices": "-1,3",
        "faces": "-1,3",
    }
    # No reference to the record set of the splits: mlcroissant joins where there is one, and
    # holds all meshes in memory for that.
    types: Any = {"split": [kind, "cr:Split"], "eigenvalues": [kind, "cr:Label"]}.get(column, kind)
    return {
        "@type": "cr:Field",
        "@id": f"{records}/{column}",
        "name": column,
        "description": text + ".",
        "dataType": types,
        **({"isArray": True, "arrayShape": shapes[column]} if column in shapes else {}),
        "source": {"fileSet": {"@id": "shards"}, "extract": {"column": column}},
    }
