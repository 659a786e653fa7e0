"""What README and docs say is run: commands, code, numbers and links."""

import json
import re
import shlex
import shutil
import sys
import tomllib

import eigbench.commands.cli
import pytest
import trimesh
from eigbench.running.predictor import META_KEYS

import synthnet.commands.cli
from evidence.__main__ import parser as evidence_parser
from synthnet import recipe, store
from synthnet.build import filters, label
from synthnet.families import CHARTED
from synthnet.store import limits, pins
from tests.docs.pages import DOCS, PAGES, README, ROOT, STEP, WHOLE, blocks, commands, run, steps

CARD_2 = (ROOT / "docs" / "dataset-card-2.0.md").read_text()
CARD = (ROOT / "docs" / "dataset-card.md").read_text()


@pytest.mark.parametrize("page", WHOLE, ids=lambda page: page.name)
def test_page_shows_what_a_block_before_it_printed(page):
    shown = [number for number, (language, *_) in enumerate(steps(page)) if language == "output"]
    assert shown
    assert all(steps(page)[number - 1][0] in ("sh", "python") for number in shown)


def test_each_adapter_has_a_page_whose_first_line_of_code_imports_it():
    adapters = {path.stem for path in (ROOT / "synthnet" / "adapters").glob("[!_]*.py")}
    first = {page: blocks("python", page.read_text())[:1] for page in WHOLE}
    imports = {
        match[1]: page
        for page, code in first.items()
        if code and (match := re.match(r"from synthnet\.adapters\.(\w+) import", code[0]))
    }
    assert set(imports) == adapters
    navigation = (ROOT / "docs" / "navigation.rst").read_text()
    for page in imports.values():
        assert f"   docs/tutorials/{page.stem}\n" in navigation
        assert STEP.search(page.read_text()).start() < 50  # nothing but the title comes before


# What takes hours, or wants files that are not ours, is run on a small version instead. Not here:
# clusters, S3 and the page, which tests/build, tests/store and tests/eigbench have, and
# scripts, whose options are checked below.

SMALLER = (
    (r"(build|--dataset) ([12])\.0(?= |$)", r"\1 \2.0-mini"),
    (r"(eigbench evaluate (?!.*--dataset).*)", r"\1 --dataset 1.0-mini"),
    (r"--scale 100", "--scale 2"),
    (r"1\.0-x100", "1.0-mini-x2"),
    (r"--sizes 1000000", "--sizes 1000"),
    (r"(eigbench scale .*)", r"\1 --sizes 1000"),
    (r"(eigbench (?:submit|leaderboard).*)", r"\1 --board trial"),
    (r"import meshes --packages --download --name \S+", "import clean --name installed"),
    (r"real-28|pypi-246", "not-ours"),
)
LONG = [
    pytest.param(page, lines, id=f"{page.name}-{number}")
    for page in (*DOCS, *WHOLE)
    for number, block in enumerate(blocks("text", page.read_text()))
    if (
        lines := re.findall(
            r"^(?:synthnet(?!.*(?:--engine|s3:))|eigbench(?! site| verify-row)) .*", block, re.M
        )
    )
]


def smaller(line):
    line = line.partition("#")[0].strip()
    for long, short in SMALLER:
        line = re.sub(long, short, line)
    whole = re.search(r"[12]\.0(?!-mini)|^synthnet build(?! \d)", line)
    assert not whole, f"{line} has its full size: see SMALLER"
    return line


def test_datasets_are_named_by_a_word_or_by_dataset():
    """The old option stays, and is tested; what is shown has one name for it."""
    shown = [*PAGES, ROOT / "Makefile", ROOT / ".ci" / "run"]
    old = re.compile(r"(?:synthnet|eigbench)\b[^\n]* --version[ =]\S")
    assert [(path.name, line) for path in shown for line in old.findall(path.read_text())] == []


@pytest.fixture(scope="module")
def small_home(mini_home, build, tmp_path_factory):
    """Directory with 1.0-mini, 2.0-mini and an import, to which commands may add."""
    home = tmp_path_factory.mktemp("small") / "home"
    shutil.copytree(mini_home, home)
    clean = tmp_path_factory.mktemp("files") / "clean"
    clean.mkdir()
    trimesh.creation.torus(3, 1).export(clean / "torus.stl")
    build("2.0-mini", home)
    importing = ["synthnet", "import", clean, "--name", "not-ours"]
    run([sys.executable, "-m", *importing], home, clean.parent)
    return home


@pytest.mark.slow
@pytest.mark.parametrize(("page", "lines"), LONG)
def test_commands_that_take_too_long_run_on_a_small_version(page, lines, small_home, tmp_path):
    for _, name, text in steps(page):
        if name:
            (tmp_path / name).write_text(text)
    (tmp_path / "baselines").symlink_to(ROOT / "baselines")
    (tmp_path / "my_model.py").write_text((ROOT / "baselines" / "mean.py").read_text())
    for location in (tmp_path / "clean", tmp_path / "Thingi10K" / "raw_meshes"):
        location.mkdir(parents=True)
        trimesh.creation.torus(3, 1).export(location / "torus.stl")
    assert lines
    for line in lines:
        program, *arguments = shlex.split(smaller(line))
        assert run([sys.executable, "-m", program, *arguments], small_home, tmp_path), line


@pytest.mark.parametrize(
    "line",
    [
        line
        for page in (*DOCS, *WHOLE)
        for line in commands("text", page)
        if re.search("eigbench |synthnet (b|i)", line)
    ],
)
def test_commands_of_full_size_or_for_a_cluster_are_understood(line):
    before, program, arguments = re.split(r"(eigbench|synthnet) ", line, maxsplit=1)
    assert before == "" or program == "synthnet"  # a launcher of a cluster's jobs may come first
    house = {"eigbench": eigbench, "synthnet": synthnet}[program]
    parsed = house.commands.cli._parser().parse_args(shlex.split(arguments, comments=True))
    assert callable(parsed.run)


def named(pattern, pages):
    """Return what in some pages has a form, sorted."""
    return sorted({match for page in pages for match in re.findall(pattern, page.read_text())})


def test_pages_name_no_script_that_is_not_there():
    scripts = named(r"(?<![\w/])scripts/\w+\.py", PAGES)
    assert [script for script in scripts if not (ROOT / script).is_file()] == []


EVIDENCE = named(r"python -m evidence\b(?!\.)([^`#\n\"]*)", [*PAGES, ROOT / "Makefile"])
EVIDENCE = sorted({command.strip() for command in EVIDENCE})


def test_pages_name_commands_of_evidence():
    assert len(EVIDENCE) > 5


@pytest.mark.parametrize("command", EVIDENCE)
def test_commands_of_evidence_are_understood(command):
    example = {"SIZE": "1000", "VERSION": "1.0"}
    arguments = [example.get(word, word) for word in shlex.split(command)]
    assert callable(evidence_parser().parse_args(arguments).run)


def test_page_to_start_from_installs_what_there_is():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    page = ROOT / "docs" / "start.md"
    (line,) = (line for line in commands("text", page) if line.startswith("pip "))
    assert shlex.split(line) == ["pip", "install", "-e", ".[all]"]
    section = page.read_text().partition(line)[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", section, flags=re.M)) == {
        *extras["optional-dependencies"]
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "code", [code for page in DOCS for code in blocks("python", page.read_text())]
)
def test_code_of_a_page_runs(code, unpacking_home, tmp_path):
    assert run([sys.executable, "-c", code], unpacking_home, tmp_path)


def test_meta_of_the_page_on_submitting_has_every_key():
    (code,) = blocks("py", (ROOT / "docs" / "submit.md").read_text())
    names = {}
    exec(code, names)
    assert tuple(names["META"]) == META_KEYS


def test_page_on_submitting_has_the_overhead_that_was_measured():
    report = json.loads((ROOT / "docs" / "data" / "harness-overhead.json").read_text())
    page = (ROOT / "docs" / "submit.md").read_text()
    assert report["rows"]
    rows = [re.split(r"\s*\|\s*", line)[1:-1] for line in page.splitlines()]
    for row in report["rows"]:
        assert row["ratio"] <= 1.05
        assert [str(value) for value in row.values()] in rows


@pytest.mark.slow
def test_example_runs(unpacking_home, tmp_path):
    example = ROOT / "examples" / "first_batch.py"
    assert "a batch:" in run([sys.executable, str(example), "1.0-mini"], unpacking_home, tmp_path)


def test_make_targets_are_there():
    makefile = (ROOT / "Makefile").read_text()
    pages = README + (ROOT / "CONTRIBUTING.md").read_text()
    targets = set(re.findall(r"\bmake ([a-z]+)\b", pages)) - {"sure"}
    assert {"quickstart", "test"} <= targets
    for target in targets:
        assert re.search(rf"^{target}:", makefile, flags=re.M), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_line_begins_with_a_mark_and_goes_on(page):
    """Markdown takes such a line as HTML: its links and code would be shown as typed."""
    assert re.findall(r"^<!-- begin [a-z0-9-]+ -->.+$", page.read_text(), flags=re.M) == []


def test_links_lead_somewhere():
    links = [
        (page, target)
        for page in PAGES
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text())
        if not target.startswith("https://")
    ]
    assert len(links) > 100
    assert [(page, target) for page, target in links if not (page.parent / target).exists()] == []


def files_of(table):
    """Return the files of a table's first column; one without a folder is beside the one before."""
    for cell in re.findall(r"^\| (`.+?`) \|", table, flags=re.M):
        folder = ROOT
        for name in re.findall(r"`([^`]+)`", cell):
            path = ROOT / name if "/" in name else folder / name
            folder = path.parent
            yield path


def test_the_reading_routes_of_the_map_lead_to_files_and_the_first_is_as_long_as_it_says():
    page = (ROOT / "docs" / "architecture.md").read_text()
    _, _, mesh, predictor, _ = page.split("\n## ")
    route, further = mesh.split("Further,")
    for table in (route, further, predictor):
        files = list(files_of(table))
        assert len(files) > 15
        assert [path for path in files if not path.is_file()] == []
    (stated,) = re.findall(r"together they are some ([\d,]+) lines", route)
    lines = sum(len(path.read_text().splitlines()) for path in files_of(route))
    assert lines == pytest.approx(int(stated.replace(",", "")), rel=0.03)


def test_versions_of_the_first_page_are_the_recipes():
    start = (ROOT / "docs" / "start.md").read_text()
    rows = dict(re.findall(r"^\| `([\w.-]+)` \| ([\d,]+) \|", start, flags=re.M))
    assert rows == {v: f"{recipe.load(v).count:,}" for v in recipe.available()}


def test_card_names_every_filter_in_order():
    solved = [label.FEW_VERTICES, filters.SOLVER, filters.CERTIFICATE]
    names = [*filters.MESH_CHECKS, *solved, *filters.SPECTRUM_CHECKS]
    table = CARD.partition("## Filters")[2].partition("## Instances")[0]
    assert re.findall(r"^\| `(\w+)` \|", table, flags=re.M) == names


def test_card_names_every_column_in_order():
    table = CARD.partition("| column | type |")[2]
    cells = re.findall(r"^\| (`.+?) \|", table, flags=re.M)
    assert re.findall(r"`(\w+)`", " ".join(cells)) == store.SCHEMA.names


def test_card_of_2_0_says_of_each_family_what_it_is():
    rows = re.findall(r"^\| `(\w+)` \| .+ \| (.+) \| (\d) \| (.+) \|$", CARD_2, flags=re.M)
    assert [row[0] for row in rows] == list(recipe.load("2.0").families)
    for name, euler, boundaries, limit in rows:
        family = CHARTED[name]
        assert family.boundaries == int(boundaries)
        if isinstance(family.euler_characteristic, int):
            assert family.euler_characteristic == int(euler)
        assert (family.limit is None) == (limit == "elements")


def test_card_counts_the_labels_that_fail_20_db():
    pinned, known = pins.read("1.0"), pins.read_limits("1.0")
    rows = [limits.compare(id, pinned[id].eigenvalues, known[id]) for id in known]
    assert all((row.error > 0).all() for row in rows)  # docs/labels.md
    failing = [row.id.rpartition("-")[0] for row in rows if not row.above_20_db]
    sentence = f"The PSNR of {len(failing):,} of the {len(rows):,} labels against their own surface"
    assert sentence in CARD
    drawn = recipe.load("1.0").families
    shares = {name: failing.count(name) / drawn[name].count for name in drawn}
    assert shares["split_cone"] == 1
    assert shares["conical_frustum"] == pytest.approx(2 / 3, abs=0.02)
    assert shares["cylinder"] == pytest.approx(1 / 2, abs=0.05)


THREATS = (ROOT / "docs" / "threats.md").read_text()
ATTEMPTS = re.findall(
    r"^\| attempt \| what happens \| test \|\n\|[-|]+\n((?:\|.*\n)+)", THREATS, flags=re.M
)
MARK = re.compile(r"^(?:pytestmark = |@)pytest\.mark\.attack$", flags=re.M)


@pytest.mark.parametrize("table", ATTEMPTS)
def test_each_attempt_on_the_page_of_threats_names_tests(table):
    cells = [line.split("|")[-2].strip() for line in table.splitlines()]
    test = r"`test_\w+\.py`"
    assert [cell for cell in cells if not re.fullmatch(f"{test}(?:, {test})*", cell)] == []


@pytest.mark.parametrize("name", sorted(set(re.findall(r"\btest_\w+\.py", THREATS))))
def test_the_command_of_the_page_of_threats_runs_tests_of_each_file_it_names(name):
    (path,) = (ROOT / "tests").rglob(name)
    assert MARK.search(path.read_text()), "none of its tests is marked as an attack"
