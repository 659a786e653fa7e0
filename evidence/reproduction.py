"""docs/reproduction.md: the paper's tables and figures beside those of our own trainings.

From benchmark/reproduction (results and predictions, scored anew here), the weights in
baselines/reproduction (what each row was trained on), docs/data/gcn.json (``measure gcn
--figure-2``) and benchmark/reported. A row whose training has not ended has no score: it says that
it was not run.
"""

import json
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
from eigbench.board import error_figures, figures, ranking
from eigbench.board.tables import number
from eigbench.results import submission
from eigbench.results.submission import Submission
from eigbench.scoring.metrics import METRICS
from matplotlib.figure import Figure

from baselines.gcn import queue, weights
from baselines.gcn.configs import CONFIGS, SCALE_FREE
from baselines.gcn.model import GCN
from baselines.gcn.predictor import told
from baselines.gcn.queue import Training
from evidence import DOCS, ROOT, markdown, numbers, paper_speed, training_curves
from evidence.markdown import folded
from evidence.training_curves import LEARNS, NOT_RUN
from synthnet.pictures.palette import BLUE, PALE, VERMILION
from synthnet.store.files import write_bytes

PAGE = DOCS / "reproduction.md"
REPORTED = json.loads((ROOT / "benchmark" / "reported" / "wu-2024.json").read_text())
LEAKAGE = """\
Under the protocol `paper` a model trains on copies of test shapes: rotated or reflected, with
the same eigenvalues. The table shows what that is worth to two predictors that can remember, on
all of 1.0 (`python -m evidence measure leakage`). Both see only six numbers of a mesh, which no
isometry changes. The look-up returns the spectrum of the nearest training shape, scaled; the
trees are the leaderboard's, with one seed instead of three."""
COLUMNS = ("invlap", "polar", "rpd", "psnr20", "l1", "l2")
VERDICTS = {"a": "yes", "b": "no, the reverse", "tie": "not decided"}
LOSSES, TIMES, SPECTRA, PRINTED = (
    f"reproduction-{name}.svg" for name in ("losses", "times", "spectra", "as-printed")
)
LONGER = "-long"  # the same, trained for as long as it improves
TRAINED_LONGER = "; trained longer: "
EXAMPLES = f"{queue.BEST}{LONGER}"  # the row whose spectra are drawn
BEST_REPORTED = max(  # PSNR>20 of the paper's best row
    float(row[table["columns"].index("PSNR>20 ↑")].rstrip("%")) / 100
    for table in REPORTED["tables"][:3]
    for row in table["rows"]
)
TRAINED_BY = [row[0].removeprefix("GCN, ") for row in REPORTED["tables"][0]["rows"]]
RPD_REPORTED = [
    float(row[REPORTED["tables"][0]["columns"].index("RPD ↓")])
    for row in REPORTED["tables"][0]["rows"]
]
OPENING = """\
This page asks which of the paper's findings hold when its networks are trained by one schedule
until a rule says that they have converged, and how much of a score under the paper's split is
memory of copies. *Not run* marks trainings that nobody has completed."""
FOUND = "Under `grouped`, against the mesh, by the paired interval over test shapes{}."
SEEDS = " and seeds"
ONE_SEED = """\
Every row has one seed, so an interval does not show how far another would be."""
SOME_OF_ONE_SEED = """\
Rows of one seed are among them: an interval then does not show how far another seed would be."""
BOTH = """\
Where a network was also trained longer and the verdict is then another, both are given."""
TIMES_CAPTION = """\
Seconds from raw meshes to eigenvalues, for 200 meshes: measured here, networks in orange
and solvers in blue; reported by the paper in grey."""
INTRO = """\
Each reported row is followed by ours: the same layers, encoding, virtual node and loss
([configs.py](../baselines/gcn/configs.py)) in a form that learns. The mesh has area 1 and lies in
its principal axes, and outputs are logarithms of factors to Weyl's law. All rows have one
schedule: AdamW, batches of 16 meshes, large ones drawn less often and each axis mirrored at
random, a rate that stays for 2,500 steps, falls until step 5,000 and stays low, and a mean of the
weights of mostly the last tenth of the steps. A training ends when the last quarter of its steps,
all of them at the low rate, has improved the RPD of 200 validation shapes by less than 2 %. A
longer schedule takes a network further: the paper's best row is also *trained longer*, with a rate
that stays for 6,000 steps and falls until step 10,000. Rows *as the paper says* are without
normalisation; the table above says how far each has come. Minutes are those of one thread
beside other work; "minutes to the paper's best" end when PSNR>20 of the 200 validation shapes
passes 86.84 %, the paper's best on its test split. `python -m baselines.gcn.queue` shows what is
done and what is left, and continues with `--run`. Scores are means over every instance of the test
split of 1.0, recomputed from the committed predictions.

The paper does not say how a network is initialised. Here the last bias is the geometric mean of
the training labels, or of their factors to Weyl's law. Training without normalisation needs
that: RPDLoss is constant where an output is negative, so an output that starts there has no
gradient, and PyTorch's default initialisation puts about half of the ten outputs there.
"""
AS_PRINTED = """\
The three rows of Table 1 are to be trained as the paper says, too: coordinates and eigenvalues
are not normalised, the optimiser is SGD with a constant rate of 1e-3 and batches of 32 meshes,
and 200 epochs over nine instances of each shape are 651,600 steps. One core takes days for them,
so a row is finished after three hours; the table says how far each has come. The last columns
continue the validation RPD to the paper's last step by the power of the steps that fits the
second half. That is an extrapolation and not a result."""
AS_PRINTED_CAPTION = """\
Scores of 200 validation shapes: as the paper says (solid), so continued (dashed), and the same
networks in the form that learns (dotted). Circles are what the paper reports of its test split."""
TAKEN = """\
Networks of the tables below, trained without copies of test shapes (`grouped`) and with them
(`paper`):"""
# Our configuration of each reported row, in the order of the paper's tables.
TABLES = (
    ("table1-polar", "table1-rpd", "table1-l1"),
    ("table2-none-virtual", "table2-a", "table2-a-virtual", "table2-alg", "table2-alg-virtual"),
    (
        *("table2-alg", "table2-a", "table3-a-4", "table3-a-5"),
        *("table2-alg-virtual", "table2-a-virtual", "table3-a-4-virtual", "table3-a-5-virtual"),
    ),
)
FAMILIES = (  # of Table 4, in the order of its columns
    *("rectangular_prism", "cone", "conical_frustum", "cylinder", "sphere"),
    *("tetrahedron", "torus", "split_cone", "inverted_cone", "split_sphere"),
)


@dataclass(frozen=True, slots=True)
class Finding:
    """What the paper says of two rows: the first is better, by its own numbers."""

    text: str
    better: str
    worse: str
    reported: str


FINDINGS = (
    Finding("RPDLoss beats PolarLoss", "table1-rpd", "table1-polar", "84.5 % against 54.3 %"),
    Finding("RPDLoss beats ℓ1", "table1-rpd", "table1-l1", "84.5 % against 77.2 %"),
    Finding(
        "Area, with a virtual node, beats no encoding",
        *("table2-a-virtual", "table2-none-virtual", "72.98 % against 46.00 %"),
    ),
    Finding(
        "Edge length and Gauss map beat area alone",
        *("table2-alg", "table2-a", "80.90 % against 73.79 %"),
    ),
    Finding(
        "The same, with a virtual node",
        *("table2-alg-virtual", "table2-a-virtual", "86.84 % against 72.98 %"),
    ),
    Finding(
        "With all encodings a virtual node helps",
        *("table2-alg-virtual", "table2-alg", "86.84 % against 80.90 %"),
    ),
    Finding(
        "With area alone it does not", "table2-a", "table2-a-virtual", "73.79 % against 72.98 %"
    ),
    Finding(
        "More encodings beat a fourth block", "table2-alg", "table3-a-4", "80.90 % against 79.90 %"
    ),
    Finding("A fourth block helps", "table3-a-4", "table2-a", "79.90 % against 73.79 %"),
    Finding("A fifth does not", "table3-a-4", "table3-a-5", "79.90 % against 78.31 %"),
)


@cache
def read(config: str, protocol: str) -> Submission | None:
    """Return a row's result with its predictions, scored anew; ``None`` if it was not run."""
    path = Training(config, protocol).result()
    return submission.read(path) if path.exists() else None


@cache
def record(config: str, protocol: str) -> dict[str, Any]:
    """Return what a row's weights of the first seed say of its training."""
    return weights.read(Training(config, protocol).weights())[1]


def mean(result: Submission | None, key: str, family: str = "") -> str:
    """Return a mean over all instances, or those of a family, for a table."""
    if result is None:
        return NOT_RUN
    scores = result.scores["families"][family] if family else result.scores["overall"]
    value = scores[key]["mean"]
    if key == "psnr20" and value is not None:
        return f"{value:.2%}"
    return number(value, METRICS[key].decimals)


@cache
def planned() -> list[tuple[str, str]]:
    """Return the configurations and protocols of the queue, each once."""
    return list(dict.fromkeys((each.config, each.protocol) for each in queue.trainings()))


def ours(config: str) -> dict[str, tuple[str, str]]:
    """Return our rows of a reported one: configuration and protocol by what they are called."""
    named = {
        "ours, grouped": (f"{config}{LEARNS}", "grouped"),
        "ours, paper's protocol": (f"{config}{LEARNS}", "paper"),
        "ours, trained longer": (f"{config}{LONGER}", "grouped"),
        "ours, longer, paper's protocol": (f"{config}{LONGER}", "paper"),
        "ours, as the paper says": (config, "grouped"),
    }
    return {who: row for who, row in named.items() if row in planned()}


def side_by_side(table: int) -> str:
    """Return one of Tables 1 to 3: the paper's row, then ours."""
    given = REPORTED["tables"][table]
    titles = {METRICS[key].heading: key for key in COLUMNS}
    named = [i for i, title in enumerate(given["columns"]) if title not in titles]
    scored = [i for i, title in enumerate(given["columns"]) if title in titles]
    headers = [given["columns"][i] for i in named] + ["who"] + [given["columns"][i] for i in scored]
    rows = []
    for cells, config in zip(given["rows"], TABLES[table], strict=True):
        names = [cells[i] for i in named]
        rows.append([*names, "reported", *(cells[i] for i in scored)])
        for who, row in ours(config).items():
            scores = [mean(read(*row), titles[given["columns"][i]]) for i in scored]
            rows.append([*[""] * len(names), who, *scores])
    return markdown.table(headers, rows, "l" * (len(named) + 1) + "r")


def by_family() -> str:
    """Return Table 4: Inverse Laplacian by family."""
    given = REPORTED["tables"][3]
    rows = []
    for cells, config in zip(given["rows"], TABLES[0], strict=True):
        rows.append([cells[0], "reported", *cells[1:]])
        for who, row in ours(config).items():
            result = read(*row)
            rows.append(["", who, *(mean(result, "invlap", family) for family in FAMILIES)])
    return markdown.table([given["columns"][0], "who", *given["columns"][1:]], rows, "llr")


def minutes_to_best(training: dict[str, Any]) -> str:
    """Return after how many minutes a training passed the paper's best, if it did."""
    passed = (row for row in training["log"] if row.get("validation_psnr20", 0) > BEST_REPORTED)
    return next((f"{row['minutes']:.0f}" for row in passed), "")


def runs() -> str:
    """Return what each row was trained on, for how long, and when it passed the paper's best."""
    headers = ["configuration", "protocol", "parameters", "steps", "epochs", "minutes"]
    headers += ["minutes to the paper's best", "it ended", "hardware"]
    rows = []
    for config, protocol in planned():
        count = f"{GCN(CONFIGS[config].model).parameter_count():,}"
        r = training_curves.kept(config, protocol)
        if r is None:
            rows.append([config, protocol, count, *[NOT_RUN] * 6])
            continue
        first = minutes_to_best(r) or "–"
        hardware = f"{'; '.join(dict.fromkeys(map(told, r['sessions'])))}, {r['dtype']}"
        progress = [f"{r['steps']:,}", f"{r['epochs']:g}", f"{r['minutes']:.0f}", first]
        end = "when it had converged" if r.get("converged") else "after the last step"
        end = end if queue.ended(r) else "by the clock"
        end = end if read(config, protocol) else "not yet"
        rows.append([config, protocol, count, *progress, end, hardware])
    return markdown.table(headers, rows, "llr")


def findings() -> str:
    """Return which of the paper's findings our runs bear out, by paired intervals."""
    rows, seeds, both = [], set(), False
    for finding in FINDINGS:
        names = finding.better, finding.worse
        a, b = (read(f"{name}{LEARNS}", "grouped") for name in names)
        if a is None or b is None:
            rows.append([finding.text, finding.reported, *[NOT_RUN] * 4])
            continue
        seeds |= {len(a.predictions), len(b.predictions)}
        rpd = " against ".join(f"{of.scores['overall']['rpd']['mean']:.3f}" for of in (a, b))
        shares = f"{mean(a, 'psnr20')} against {mean(b, 'psnr20')}"
        cells = [shares, verdict(*names, "psnr20"), rpd, verdict(*names, "rpd")]
        both = both or any(TRAINED_LONGER in cell for cell in cells)
        rows.append([finding.text, finding.reported, *cells])
    said = [FOUND.format(SEEDS if max(seeds, default=1) > 1 else "")]
    if min(seeds, default=2) == 1:
        said.append(ONE_SEED if max(seeds) == 1 else SOME_OF_ONE_SEED)
    said += [BOTH] if both else []
    headers = ["the paper says", "its PSNR>20"]
    headers += ["our PSNR>20", "holds here?", "our RPD", "holds here?"]
    return f"{' '.join(said)}\n\n{markdown.table(headers, rows, 'llr')}"


def passed() -> str:
    """Return how many trained rows are above the paper's best, and which are not, with reasons."""
    rows = {config: result for config in SCALE_FREE if (result := read(config, "grouped"))}
    below = {
        config: result
        for config, result in rows.items()
        if result.scores["overall"]["psnr20"]["mean"] <= BEST_REPORTED
    }
    if not rows:
        return ""
    sentences = [
        f"Of the {len(rows)} rows of Tables 1 to 3 trained in the form that learns, "
        f"{len(rows) - len(below)} have more PSNR>20 than the paper's best row, "
        f"{BEST_REPORTED:.2%}."
    ]
    for config, result in below.items():
        has = (
            "has converged"
            if record(config, "grouped")["converged"]
            else "has not converged, and is"
        )
        sentences.append(f"`{config}` {has} at {mean(result, 'psnr20')}.")
    return " ".join(sentences)


def verdict(better: str, worse: str, key: str) -> str:
    """Return whether a finding on two rows holds by a metric, and if it does when trained longer.

    The latter only where one of them was trained longer and that makes a difference.
    """
    names = better, worse
    usual = tuple(f"{name}{LEARNS}" for name in names)
    longer = tuple(
        f"{name}{LONGER}" if f"{name}{LONGER}" in CONFIGS else config
        for name, config in zip(names, usual, strict=True)
    )
    found = []
    for configs in dict.fromkeys((usual, longer)):  # mostly nothing was trained longer
        a, b = (read(config, "grouped") for config in configs)
        if a is None or b is None:
            continue
        converged = all(record(config, "grouped")["converged"] for config in configs)
        found.append(
            VERDICTS[ranking.difference(a, b, key).verdict] if converged else "not converged"
        )
    return TRAINED_LONGER.join(dict.fromkeys(found))


def look_ups() -> str:
    """Return how well predictors do that can only remember, by ``evidence/leakage.py``."""
    columns = {
        "predictor": "{predictor}",
        "protocol": "{protocol}",
        "test meshes with a copy in training": "{seen:.2%}",
        "PSNR>20 ↑": "{psnr20:.2%}",
        "RPD ↓": "{rpd:.3g}",
    }
    return markdown.columns(numbers.read("leakage")["rows"], columns, "llr")


def both_protocols() -> str:
    """Return the scores of the networks that were trained under both protocols."""
    rows = []
    for config, protocol in planned():
        grouped, copied = read(config, "grouped"), read(config, "paper")
        if protocol == "paper" and grouped is not None and copied is not None:
            scores = [mean(of, key) for key in ("psnr20", "rpd") for of in (grouped, copied)]
            rows.append([config, *scores])
    if not rows:
        return ""
    scored = [f"{title}, {of}" for title in ("PSNR>20 ↑", "RPD ↓") for of in ("grouped", "paper")]
    return f"{TAKEN}\n\n{markdown.table(['network', *scored], rows, 'lr')}"


def as_printed(names: Iterable[str]) -> list[str]:
    """Return the section on Table 1 trained as the paper says; nothing if no training has begun."""
    if PRINTED not in names:
        return []
    table = training_curves.table(TRAINED_BY, RPD_REPORTED)
    picture = f"![Two panels of curves against steps, in logarithms]({PRINTED})"
    return ["## Table 1 as the paper says", AS_PRINTED, picture, AS_PRINTED_CAPTION, table]


def best() -> str:
    """Return how the paper's best network does here, in a sentence or two; nothing if not run."""
    result = read(EXAMPLES, "grouped")
    if result is None:
        return ""
    r = record(EXAMPLES, "grouped")
    table = REPORTED["tables"][1]
    printed = dict(zip(table["columns"], table["rows"][TABLES[1].index(queue.BEST)], strict=True))
    keys = ("psnr20", "invlap", "rpd")
    here = ", ".join(f"{METRICS[key].title} {mean(result, key)}" for key in keys)
    there = ", ".join(printed[METRICS[key].heading] for key in keys)
    soon = ""
    if minutes := minutes_to_best(r):
        soon = f" On 200 validation shapes it passed the paper's PSNR>20 after {minutes} minutes."
    end = "" if r["converged"] else " It had not converged, by the rule below."
    return (
        f"The paper's best network, with inputs and outputs free of scale, has {here} on the test "
        f"split of 1.0 after {r['minutes']:.0f} minutes of training on one core; the paper reports "
        f"{there}.{soon}{end}"
    )


def times() -> str:
    """Return Figure 2 as a table: seconds of networks and solvers."""
    measured = numbers.read("gcn")["figure2"]  # by ``measure gcn --figure-2``
    rows = [[r["what"], r["where"], f"{r['seconds']:.3g}"] for r in measured]
    if not any(r["where"].startswith("cuda") for r in measured):
        rows.insert(0, [measured[0]["what"], "a GPU", NOT_RUN])
    given = REPORTED["tables"][4]
    rows += [[f"reported: {what}", where, seconds] for what, where, seconds in given["rows"]]
    return markdown.table(["what", "where", "seconds"], rows, "llr")


def time_bars() -> Figure:
    """Draw Figure 2: seconds for a batch of 200 meshes, ours and the paper's."""
    ours = [(f"{r['what']}; {r['where']}", r["seconds"]) for r in numbers.read("gcn")["figure2"]]
    given = [row for row in REPORTED["tables"][4]["rows"] if "200 meshes" in row[0]]
    theirs = [(f"reported: {what}; {where}", float(s)) for what, where, s in given]
    bars = sorted(ours + theirs, key=lambda bar: -bar[1])
    with figures.style():
        figure = Figure(figsize=(7.2, 0.32 * len(bars) + 0.6))
        figure.subplots_adjust(0.5, 0.5 / (0.32 * len(bars) + 0.6), 0.94, 0.99)
        axes = figure.subplots()
        colours = [
            PALE if bar in theirs else VERMILION if bar[0].startswith("GCN") else BLUE
            for bar in bars
        ]
        drawn = axes.barh([name for name, _ in bars], [s for _, s in bars], color=colours)
        axes.bar_label(drawn, [f"{seconds:.2g}" for _, seconds in bars], padding=3, fontsize=8)
        axes.set_xscale("log")
        axes.set_xlabel("seconds")
        axes.tick_params(axis="y", labelsize=8)
    return figure


def pictures() -> dict[Path, Figure]:
    """Draw what there is to draw, by where it goes."""
    result = read(EXAMPLES, "grouped")
    drawn = {
        LOSSES: training_curves.losses(TRAINED_BY),
        PRINTED: training_curves.as_the_paper_says(TRAINED_BY, RPD_REPORTED),
        TIMES: time_bars(),
        SPECTRA: error_figures.spectra(result) if result else None,
    }
    return {PAGE.with_name(name): figure for name, figure in drawn.items() if figure is not None}


def page(drawn: Iterable[Path]) -> str:
    """Return the whole page, with the pictures that were drawn."""
    names = {path.name for path in drawn}
    tables = REPORTED["tables"]
    parts = [
        "<!-- Written by `make tables`. -->",
        "# The paper's tables, beside ours",
        best(),
        OPENING,
        f"![Bars of seconds: networks, LaPy and the certified solver, 200 meshes each]({TIMES})\n\n"
        f"{TIMES_CAPTION}",
        paper_speed.claim(numbers.read("gcn")),
        "## What holds of the paper's findings",
        findings(),
        passed(),
        "## How much is leakage",
        LEAKAGE,
        look_ups(),
        both_protocols(),
        *as_printed(names),
        "## The tables",
        INTRO.strip(),
        folded("What was run", runs()),
        *(folded(t["title"], side_by_side(i)) for i, t in enumerate(tables[:3])),
        folded(tables[3]["title"], by_family()),
        folded("Figure 2: time, in seconds", times()),
        "## Figure 5: how steady the losses are",
        f"![Two panels of curves against steps]({LOSSES})" if LOSSES in names else "Not run.",
        "Left the loss that each row of Table 1 is trained by, over its first value; right the RPD "
        "of the validation split.",
        "## Figure 6: spectra",
        f"![Predicted and true eigenvalues by index]({SPECTRA})"
        if SPECTRA in names
        else "Not run.",
        f"Labels and predictions of the row `{EXAMPLES}` under `grouped`; for each family the "
        "test meshes with the least, the median and the largest RPD.",
        "## Notes on the paper's numbers",
        "\n".join(f"- {note}" for note in REPORTED["notes"]),
    ]
    return "\n\n".join(filter(None, parts)) + "\n"


def fill(*, check: bool = False) -> list[str]:
    """Write the page and its pictures; return those that were not what their data say.

    ``check`` writes nothing.
    """
    mpl.use("agg")
    drawn = pictures()
    contents = {PAGE: page(drawn).encode()}
    with tempfile.TemporaryDirectory() as folder:
        for path, figure in drawn.items():
            figures.save(Path(folder) / path.name, figure)
            contents[path] = (Path(folder) / path.name).read_bytes()
    stale = [p for p, new in contents.items() if not p.exists() or p.read_bytes() != new]
    for path in () if check else stale:
        write_bytes(path, contents[path])
    return [path.name for path in stale]
