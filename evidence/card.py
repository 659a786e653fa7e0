"""What the pages say of whole builds and of what a full evaluation costs."""

import json

from tabulate import tabulate

from evidence import ROOT, markdown
from evidence.shapes import new_families
from synthnet.families import FAMILIES
from synthnet.version import __version__


def composition(report: dict) -> str:
    """Return the table of families of a build report, those of earlier versions as one row.

    What `synthnet info --json` says of a version will do: then nothing is said of time.
    """
    pictures = f"pictures/{report['version']}"
    new = new_families(report["version"])
    timed = "wall_seconds" in report
    counted = ["drawn", "kept", "vertices", "faces", *["core_seconds"] * timed]
    rows = []
    for row in report["families"]:
        if row["family"] in new:
            title, numbers = FAMILIES[row["family"]].title, [row[name] for name in counted]
            refused = ", ".join(f"{n} `{reason}`" for reason, n in row["rejected"].items()) or "0"
            picture = f"![{title}]({pictures}/{row['family']}.png)"
            rows.append([picture, title, *_counts(numbers, refused)])
    old = [row for row in report["families"] if row["family"] not in new]
    for title, some in (("Families of earlier versions", old), ("All", report["families"])):
        if some:
            sums = [sum(round(row[name], 1) for row in some) for name in counted]
            rows.append(["", title, *_counts(sums)])
    if report["version"] == "1.0":
        rows.append(["", "*The paper, as reported*", 16550, "189", 16361, "", "", ""])
    headers = ["", "family", "drawn", "rejected", "kept", "vertices", "faces"]
    headers += ["core-seconds"] * timed
    table = tabulate(rows, headers, tablefmt="github", intfmt=",", floatfmt=",.1f")
    size = report["bytes"] / 1e6
    unpacked = f"PyTorch Geometric unpacks it into another {unpacked_gb(report):.1f} GB."
    if not timed:
        written = f"`synthnet build {report['version']}` writes {size:,.0f} MB."
        return f"{table}\n\n{written} {unpacked}"
    minutes = report["wall_seconds"] / 60
    return (
        f"{table}\n\nBuilt by `synthnet build {report['version']}` on 2 cores in "
        f"{minutes:.1f} minutes; {size:,.0f} MB. {unpacked}"
    )


def unpacked_gb(report: dict) -> float:
    """Return the size of what PyTorch Geometric maps: three numbers of 4 bytes a vertex and face.

    Examples
    --------
    >>> unpacked_gb({"families": [{"vertices": 50_000_000, "faces": 100_000_000}]})
    1.8
    """
    return 12 * sum(row["vertices"] + row["faces"] for row in report["families"]) / 1e9


def takes(*builds: dict) -> str:
    """Return the time and the disk that each version takes."""
    sentences = []
    for build in builds:
        timed = f"{minutes} on two cores and " if (minutes := _minutes(build)) else ""
        sentences.append(
            f"{build['version']} takes {timed}{build['bytes'] / 1e9:.1f} GB, and "
            f"{unpacked_gb(build):.1f} GB more once PyTorch Geometric has unpacked it"
            f"{'' if timed else '; its build was not timed'}."
        )
    return " ".join(sentences)


def _minutes(build: dict) -> str:
    """Return how long a build took, empty if it was not timed."""
    return f"{build['wall_seconds'] / 60:.0f} minutes" if "wall_seconds" in build else ""


def _counts(numbers: list, refused: str | None = None) -> list:
    """Return the cells of a row: drawn, rejected, kept, vertices, faces, perhaps core-seconds."""
    drawn, kept, vertices, faces, *seconds = numbers
    cells = [drawn, refused or str(drawn - kept), kept, vertices, faces]
    return cells + [round(taken, 1) for taken in seconds]


def cost(build: dict, full: dict, loading: dict) -> str:
    """Return what a built mesh and an epoch cost."""
    whole = build["rows"][-1]
    return (
        f"Building a mesh, with checks, label, copies and storage, takes {whole['ours ms']} "
        f"core-milliseconds; a plain loop over Open3D and `lapy.Solver(...).eigs(11)`, which "
        f"checks and stores nothing, {whole['plain ms']}: {whole['ratio']} of it, over "
        f"{whole['shapes']} random shapes, in one run, on one thread "
        f"(`python -m evidence measure build-cost --shapes {whole['shapes']}`). The whole of "
        f"{full['version']} on {full['workers']} cores, one after the other: the loop "
        f"{full['plain seconds']:.0f} s, the build {full['build seconds']:.0f} s, "
        f"{full['ratio']} of it (`python -m evidence measure build-full`). The train split opens "
        f"in {loading['open_seconds']} s; an epoch of a `DataLoader` over its "
        f"{loading['instances']:,} instances, without a model, takes {loading['epoch_seconds']} s "
        f"and at most {loading['peak_resident_mb']} MB of resident memory "
        "(`python -m evidence measure loading`)."
    )


def many_meshes(report: dict, meshes: int = 1_000_000, cores: int = 64) -> str:
    """Return the cost of a measured build, and that of more meshes: times the ratio of shapes."""
    drawn = sum(row["drawn"] for row in report["families"])
    hours = sum(row["core_seconds"] for row in report["families"]) / 3600
    ratio = meshes / drawn
    return (
        f"Measured: {drawn:,} meshes of {report['version']} in {hours:.2f} core-hours, "
        f"{report['bytes'] / 1e9:.2f} GB.\n"
        f"{meshes:,} meshes: {hours * ratio:.1f} core-hours ({60 * hours * ratio / cores:.0f} "
        f"minutes on {cores} cores), {report['bytes'] * ratio / 1e9:.0f} GB."
    )


def surfaces(shown: dict) -> str:
    """Return which eigenfunctions the picture of the README shows, from left to right."""
    named = "; ".join(
        f"{FAMILIES[row['family']].title.lower()}, λ{row['number']} = {row['eigenvalue']:.3g}"
        for row in shown["rows"]
    )
    return f"*From left to right, in 1/length²: {named}.*"


def citations(*builds: dict) -> str:
    """Return the entries for BibTeX: the software, and a version of the dataset each."""
    entries = [bibtex("synthnet", "synthNet and eigbench", f"software, version {__version__}")]
    for build in builds:
        version, note = build["version"], f"recipe digest {build['recipe_digest'][:12]}"
        title = f"synthNet {version}, a dataset of certified spectra"
        entries.append(bibtex(f"synthnet-{version}", title, note))
    return "```bibtex\n" + "\n\n".join(entries) + "\n```"


def bibtex(key: str, title: str, note: str) -> str:
    """Return an entry for BibTeX."""
    return (
        f"@misc{{{key},\n  title = {{{title}}},\n  author = {{{{The synthNet authors}}}},\n"
        f"  year = {{2026}},\n  note = {{{note}}},\n}}"
    )


def full_runs(*builds: dict) -> str:
    """Return the table of what a full evaluation on each version costs, by the board's own runs."""
    rows = []
    for build in builds:
        board = ROOT / "benchmark" / "results" / f"{build['version']}-test-grouped"
        result = json.loads((board / "synthnet-certified.json").read_text())
        cost, instances = result["cost"], result["dataset"]["instances"]
        reference = cost["reference"]
        rows.append(
            [
                f"`{build['version']}`",
                _minutes(build) or "–",
                f"{build['bytes'] / 1e9:.1f} GB",
                f"{unpacked_gb(build):.1f} GB",
                f"{instances:,}",
                f"{reference['meshes'] * reference['ms_per_mesh'] / 60_000:.1f} minutes",
                f"{instances * cost['ms_per_mesh_mean'] / 60_000:.1f} minutes",
            ]
        )
    headers = ["version", "build, 2 cores", "disk", "unpacked for PyTorch Geometric"]
    headers += ["test instances", "LaPy as reference"]
    headers.append("predictor as fast as the certified solver")
    return markdown.table(headers, rows, "lr")
