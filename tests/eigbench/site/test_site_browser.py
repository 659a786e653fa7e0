"""The page of `eigbench site` in a browser: from files, without a server and without a network."""

import csv
import json
import re
import shutil
from pathlib import Path
from urllib.parse import unquote, urlparse

import pytest
from eigbench.site import origin, write
from playwright.sync_api import expect

pytestmark = pytest.mark.slow

FIRST = "1.0-mini-test-grouped-mesh"  # the board of most tests
WIDE, PHONE = {"width": 1440, "height": 800}, {"width": 390, "height": 800}
A4 = {"width": 680, "height": 1000}  # within the margins
HELD_OUT = "2.0-mini-test-genus-mesh"
GROUPED = "#board=2.0-test-grouped-surface"
IMPORTED = "2.0-mini-test-imported-real-28-mesh"


@pytest.fixture(scope="module")
def folders(made_content, real_content, tmp_path_factory):
    """The page of a made-up board with everything there is, and of this repository."""
    folder = tmp_path_factory.mktemp("pages")
    for name, content in (("made", made_content), ("real", real_content)):
        write.write(folder / name, content)
    return folder


@pytest.fixture
def visit(browser, folders):
    """Return a function that opens a page; what it logs and asks of others fails the test."""
    pages, problems = [], []

    def opened(fragment="", name="made", size=WIDE, scheme="light", using=browser, **more):
        page = using.new_page(viewport=size, color_scheme=scheme, **more)
        pages.append(page)
        page.set_default_timeout(60_000)

        def check(route):
            if route.request.url.startswith((folders.as_uri(), "data:")):
                route.continue_()
            else:
                problems.append(f"asked for {route.request.url}")
                route.abort()

        page.route("**/*", check)
        page.on("console", lambda message: problems.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: problems.append(f"error: {error}"))
        if name == "made" and "board=" not in fragment:
            fragment = f"#board={FIRST}" + (f"&{fragment[1:]}" if fragment else "")
        page.goto(f"{(folders / name / 'index.html').as_uri()}{fragment}")
        expect(page.locator("#status")).not_to_be_empty()
        return page

    yield opened
    for page in pages:
        page.close()
    assert problems == []


def test_page_opens_with_families_held_out_against_the_surface(visit):
    page = visit(name="real")
    expect(page).to_have_url(re.compile(r"#board=2\.0-test-family-surface$"))
    titles = page.locator("#table thead th").all_text_contents()
    assert any("drop" in title for title in titles)


def names(page):
    return page.locator("#table tbody .title").all_text_contents()


def sort(page, title):
    """Click a head; return by what its column is then sorted."""
    head = page.locator("#table thead th").filter(has_text=title).first
    head.get_by_role("button").click()
    return head.get_attribute("aria-sort")


def meshes(page, count=2):
    """Wait until the meshes of the open row are drawn."""
    expect(page.locator("canvas[data-turned]")).to_have_count(count, timeout=60_000)


# --- the table ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["made", "real"])
def test_page_loads_from_a_file_with_every_row(visit, made_board, real_board, name):
    page = visit("" if name == "made" else GROUPED, name=name)
    rows = (made_board if name == "made" else real_board)[0]
    board = page.evaluate("location.hash")
    first = [row.name for row in rows if f"={row.board}-" in f"{board}-"]
    assert sorted(names(page)) == sorted(first)
    said = f"{len(first)} of {len(first)} rows shown, sorted by rank, ascending."
    expect(page.locator("#status")).to_have_text(said)
    expect(page.locator("#chart svg[role=img]").first).to_be_visible()


def test_a_head_sorts_and_turns_the_order(visit):
    page = visit()
    best = names(page)
    assert best[-1] == "Far"
    assert sort(page, "RPD ↓") == "ascending"
    assert names(page) == best
    assert sort(page, "RPD ↓") == "descending"
    assert names(page) == best[::-1]
    assert sort(page, "PSNR>20") == "descending"  # more is better
    assert page.locator("#table thead th[aria-sort]").count() == 1
    assert sort(page, "model") == "ascending"
    assert names(page) == ["Far", "One percent", "Other percent", "Twenty | <percent>"]
    expect(page.locator("#status")).to_contain_text("sorted by model, ascending")
    assert page.evaluate("document.activeElement.id") == "sort-name"  # though made anew


def test_what_has_no_value_goes_last_whatever_the_order(visit):
    page = visit()
    for _ in range(2):
        sort(page, "parameters")
        assert names(page)[0] == "Other percent"


def test_filters_leave_the_rows_they_name_and_say_how_many(visit):
    page = visit()
    page.get_by_label("trivial").uncheck()
    assert "Far" not in names(page)
    expect(page.locator("#status")).to_contain_text("3 of 4 rows shown")
    page.get_by_label("Training data").select_option("the training split")
    assert names(page) == ["Twenty | <percent>"]
    page.get_by_role("button", name="Reset").click()
    assert len(names(page)) == 4
    page.get_by_label("Model", exact=True).fill("PERCENT")
    assert len(names(page)) == 3
    page.get_by_label("Model", exact=True).fill("nobody")
    expect(page.locator("#table")).to_contain_text("No row passes the filters.")
    page.get_by_label("Model", exact=True).fill("")
    hardware = page.get_by_label("Hardware").locator("option").nth(1).get_attribute("value")
    page.get_by_label("Hardware").select_option(hardware)
    assert len(names(page)) == 4


def test_dataset_and_protocol_choose_the_board(visit):
    page = visit()
    page.get_by_label("Dataset").select_option("synthNet 2.0-mini")
    expect(page.locator("h2")).to_contain_text("protocol family, against the surface")
    page.get_by_label("Protocol", exact=True).select_option("2.0-mini-test-grouped-mesh")
    expect(page.locator("h2")).to_contain_text("protocol grouped, against the mesh")
    page.get_by_label("Columns").select_option("protocols-rpd")
    expect(page.locator("#table")).to_contain_text(re.compile(r"0\.2439 ± .* \(\+0\.1942\)"))
    expect(page.locator("#chart svg[role=img]")).to_have_count(5)  # a chart a protocol
    page.get_by_label("Protocol", exact=True).select_option(HELD_OUT)
    expect(page.locator("#table tbody")).to_contain_text("+0.1942")
    assert sorted(names(page)) == ["Model", "Solver"]
    page.get_by_label("Dataset").select_option("Scaling track")
    expect(page.locator("#table")).to_contain_text("over 600 s")
    expect(page.locator("#chart svg[role=img]")).to_have_count(2)  # a chart a size
    page.get_by_label("Dataset").select_option("Reported, not run here")
    expect(page.locator("#status")).to_contain_text("no row was run here")
    expect(page.locator("#table")).to_contain_text("GCN, RPDLoss")


def test_a_fragment_is_a_view_that_can_be_linked(visit):
    page = visit()
    page.get_by_label("Columns").select_option("medians")
    page.get_by_label("trivial").uncheck()
    sort(page, "InvLap")
    sort(page, "InvLap")
    fragment = page.evaluate("location.hash")
    again = visit(fragment)
    assert names(again) == names(page)
    assert again.get_by_label("Columns").input_value() == "medians"
    expect(again.locator("th[aria-sort=descending]")).to_contain_text("InvLap")
    again.evaluate("location.hash = '#board=scaling'")
    expect(again.locator("h2")).to_contain_text("Scaling")
    meant = visit("#board=none&sort=nothing&columns=none&open=nobody&metric=none")
    assert names(meant) == ["Solver"]  # what is not there is as at first


def test_a_head_says_what_its_column_means_to_all(visit):
    page = visit()
    tip = page.locator("#tip")
    head = page.locator("#sort-rpd")
    head.hover()
    expect(tip).to_contain_text("Relative percent difference")
    page.keyboard.press("Escape")
    expect(tip).to_be_hidden()
    page.locator("#sort-invlap").focus()
    expect(tip).to_contain_text("Inverse Laplacian")
    expect(head).to_have_accessible_description(re.compile("Relative percent difference"))
    page.get_by_text("What the columns mean").click()
    expect(page.locator(".glossary")).to_contain_text("Relative percent difference")


def test_chart_has_the_front_and_its_points_lead_to_models(visit, real_board):
    page = visit(GROUPED, name="real")
    label = page.locator("#chart svg[role=img]").get_attribute("aria-label")
    first = [row.at("surface") for row in real_board[0] if row.board == "2.0-test-grouped"]
    at = {
        row.name: (-row.result["cost"]["reference"]["ratio"], row.scores["overall"]["rpd"]["mean"])
        for row in first
    }
    front = {  # by the definition: nobody is as fast and better, or as good and faster
        name
        for name, (slow, rpd) in at.items()
        if not any(x <= slow and y <= rpd and (x, y) != (slow, rpd) for x, y in at.values())
    }
    assert 1 < len(front) < len(at)
    shown = label.partition("Pareto front: ")[2]
    assert {name for name in at if f"{name} (" in shown} == front
    chart = page.locator("#chart svg[role=img]").first
    mark = chart.locator("g path").filter(has_not=page.locator("title")).last
    mark.hover()
    expect(page.locator("tr.pointed")).to_have_count(1)
    pointed = page.locator("tr.pointed .title").text_content()
    page.mouse.down()
    page.mouse.up()
    expect(page.locator("h2")).to_have_text(pointed)


NAMES_OF_A_CHART = """figure => {
  const svg = figure.querySelector("svg[role=img]");
  const origin = svg.getBoundingClientRect();
  const names = [...svg.querySelectorAll("text.name")].map((one) => {
    const box = one.getBoundingClientRect();
    const [left, top] = [box.x - origin.x, box.y - origin.y];
    return [one.dataset.slug, [left, top, left + box.width, top + box.height]];
  });
  return { points: svg.points, names, listed: figure.innerText };
}"""


def distance(box, point):
    dx = max(box[0] - point[0], 0, point[0] - box[2])
    dy = max(box[1] - point[1], 0, point[1] - box[3])
    return (dx * dx + dy * dy) ** 0.5


@pytest.mark.parametrize("width", [320, 390, 1024, 1440])
@pytest.mark.parametrize("view", ["", "#board=scaling"])
@pytest.mark.parametrize("name", ["made", "real"])
def test_every_point_is_named_or_listed_and_no_name_is_nearer_to_another(visit, name, view, width):
    page = visit(view, name=name, size={"width": width, "height": 900})
    expect(page.locator("#chart svg[role=img]").first).to_be_visible()
    rows = {
        link.evaluate("link => link.closest('tr').id.slice(4)"): link.text_content()
        for link in page.locator("#table tbody .title").all()
    }
    assert rows
    drawn = set()
    for figure in page.locator("#chart figure").all():
        chart = figure.evaluate(NAMES_OF_A_CHART)
        at = {point["slug"]: (point["x"], point["y"]) for point in chart["points"]}
        named = dict(chart["names"])
        assert named
        drawn |= set(at)
        for slug in at:
            assert slug in named or rows[slug] in chart["listed"], slug
        for slug, box in named.items():
            own = distance(box, at[slug])
            others = [distance(box, point) for other, point in at.items() if other != slug]
            assert min(others, default=own) >= own, slug
    assert drawn == set(rows)


def test_a_point_or_a_row_under_the_pointer_stands_out_in_every_chart(visit):
    page = visit("#board=scaling")
    expect(page.locator("#chart svg.linked")).to_have_count(2)
    page.locator("#row-near").hover()
    expect(page.locator("#chart .halo")).to_have_count(2)
    page.locator("h2").hover()
    expect(page.locator("#chart .halo")).to_have_count(0)
    chart = page.locator("#chart svg.linked").first
    near = next(p for p in chart.evaluate("svg => svg.points") if p["slug"] == "near")
    chart.hover(position={"x": near["x"], "y": near["y"]})
    expect(page.locator("#chart .halo")).to_have_count(2)
    expect(page.locator("tr.pointed .title")).to_have_text("Near")


def test_where_a_prediction_can_win_is_shaded_and_who_wins_is_said(visit):
    page = visit("#board=scaling")
    charts = page.locator("#chart svg.linked")
    expect(charts).to_have_count(2)
    expect(charts.first).to_have_attribute("aria-label", re.compile("On most surfaces win: Near"))
    expect(charts.last).to_have_attribute("aria-label", re.compile("On most surfaces win: none"))
    shaded = charts.locator("[fill='var(--front)']")
    assert [area.locator("path").count() for area in shaded.all()] == [1, 1]


# --- a row -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["made", "real"])
def test_a_name_leads_to_the_page_of_its_model_and_back(visit, name):
    page = visit(name=name)
    board = page.locator("h2").text_content()
    title = page.locator("#table tbody .title").nth(1)
    model = title.text_content()
    title.focus()
    page.keyboard.press("Enter")
    expect(page.locator("h2")).to_have_text(model)
    meshes(page)
    for heading in (
        *("Where it stands", "Why this rank", "By family", "The laws of every spectrum"),
        *("Worst shape", "Median shape", "Metrics", "By eigenvalue", "Cost", "Run it again"),
    ):
        expect(page.get_by_role("heading", name=re.compile(heading)).first).to_be_visible()
    expect(page.locator(".spectrum svg[role=img]")).to_have_count(2)
    page.get_by_text("Numbers", exact=True).first.click()
    expect(page.get_by_role("table", name="Eigenvalues").first).to_contain_text("λ10")
    expect(page.locator("#table")).to_be_hidden()
    page.go_back()
    expect(page.locator("h2")).to_have_text(board)
    expect(page.locator("#table")).to_be_visible()
    page.go_forward()
    expect(page.locator("h2")).to_have_text(model)
    page.get_by_role("link", name=f"← {board}").click()
    expect(page.locator("tr.open .title")).to_have_text(model)
    expect(page.locator("tr.open")).to_be_in_viewport()


def test_another_board_is_one_step_of_back(visit):
    page = visit()
    page.get_by_label("Dataset").select_option("Scaling track")
    expect(page.locator("h2")).to_contain_text("Scaling")
    page.go_back()
    expect(page.locator("h2")).to_contain_text("synthNet 1.0-mini")


def test_why_a_rank_shows_the_paired_difference_to_every_other_row(visit):
    page = visit("#model=one-percent")
    chart = page.get_by_role("img", name=re.compile("of each other row minus that of One percent"))
    others = ("Other percent", "Twenty | <percent>", "Far")
    expect(chart).to_be_visible()
    assert all(f"{name} " in chart.get_attribute("aria-label") for name in others)
    page = visit()
    page.get_by_role("link", name=re.compile("^why .*: One percent")).click()
    expect(page.get_by_role("heading", name="Why this rank")).to_be_in_viewport()
    expect(page.get_by_role("img", name=re.compile("minus that of One percent"))).to_be_visible()
    page.get_by_label("Compare with").select_option("Far")
    table = page.get_by_role("table", name="Beside Far")
    expect(table).to_contain_text("One percent")
    expect(table.locator("tbody tr")).to_have_count(2)
    families = page.get_by_role("table", name="Families, with Far").locator("tbody tr")
    expect(families).to_have_count(10)
    for line in families.all_text_contents():
        assert re.search(r"0\.0498\d\.\d{4}One percent$", line), line
    assert "other=far" in page.evaluate("location.hash")
    page.go_back()
    expect(page.get_by_role("table", name="Beside Far")).to_have_count(0)


def test_a_page_says_where_its_model_comes_from_and_how_to_cite_it(visit, real_board):
    row = next(
        row
        for row in real_board[0]
        if "checkout" in row.result
        and any(name.endswith(".safetensors") for name in row.result["model"]["sources"])
    )
    page = visit(f"#board={row.board}-surface&model={row.slug}", name="real")
    meshes(page)
    facts = page.locator(".facts")
    titles = ["row by", "code", "weights", "training set", "commit of the code"]
    titles += ["result of"] * bool(origin.date(row.result_path))  # a shallow clone knows no days
    for title in titles:
        expect(facts.locator("dt").filter(has_text=re.compile(f"^{title}$"))).to_have_count(1)
    links = facts.locator("a[href^='code/']").all()
    assert {link.text_content() for link in links} >= {row.result["model"]["code"].split(":")[0]}
    for link in links:
        assert Path(unquote(urlparse(link.evaluate("one => one.href")).path)).is_file()
    entry = page.locator(".cite").text_content()
    assert entry.startswith(f"@misc{{eigbench-{row.slug},")
    assert row.name in entry
    run = "run by a maintainer" in page.locator("#model").text_content()
    assert run == ("verified" in row.result)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    button = page.get_by_role("button", name="Copy the citation")
    button.click()
    expect(page.get_by_role("button", name="Copied")).to_have_count(1)
    assert page.evaluate("navigator.clipboard.readText()") == entry


def test_a_row_that_a_maintainer_has_run_says_so(altered):
    def alter(folder):
        path = folder / "rows" / FIRST / "far.js"
        text = path.read_text()
        assert '"verified":false' in text
        path.write_text(text.replace('"verified":false', '"verified":true'))

    page = altered(alter, f"#board={FIRST}&model=far")
    badges = ["scores recomputed by CI from its predictions", "run by a maintainer"]
    expect(page.locator(".badge")).to_have_text(badges)


def test_the_shown_rows_can_be_had_as_csv_and_json(visit):
    page = visit()
    page.get_by_label("trivial").uncheck()
    with page.expect_download() as download:
        page.get_by_role("button", name="CSV").click()
    text = Path(download.value.path()).read_bytes().decode()
    lines = list(csv.reader(text.splitlines()))
    assert download.value.suggested_filename == f"{FIRST}.csv"
    assert [line[0] for line in lines[1:]] == names(page)
    assert len({len(line) for line in lines}) == 1
    assert len(set(lines[0])) == len(lines[0])
    assert "rpd-median" in lines[0]  # of another view
    column = lines[0].index("rpd")
    assert float(lines[1][column]) == pytest.approx(10 * 0.01 / 2.01, rel=1e-4)
    with page.expect_download() as download:
        page.get_by_role("button", name="JSON").click()
    rows = json.loads(Path(download.value.path()).read_text())["rows"]
    assert [row["model"] for row in rows] == names(page)
    assert rows[0]["rpd"]["value"] == float(lines[1][column])


def test_a_mesh_turns_by_keys_by_a_drag_and_by_buttons(visit):
    page = visit("#model=one-percent")
    meshes(page)
    canvas = page.locator("canvas").first
    canvas.scroll_into_view_if_needed()

    def state():
        turned = canvas.get_attribute("data-turned")
        return (*map(float, turned.split()), float(canvas.get_attribute("data-distance")))

    start, picture = state(), canvas.screenshot()
    canvas.press("ArrowRight")
    assert state()[0] == pytest.approx(start[0] + 0.1745, abs=0.01)
    assert state()[1:] == pytest.approx(start[1:], abs=0.01)
    assert canvas.screenshot() != picture
    canvas.press("ArrowUp")
    assert state()[1] == pytest.approx(start[1] - 0.1745, abs=0.01)
    canvas.press("+")
    assert state()[2] < start[2]
    canvas.press("0")
    assert state() == pytest.approx(start, abs=0.01)
    page.mouse.wheel(0, 100)  # with the focus, the wheel zooms
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 60, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 140, box["y"] + 60, steps=4)
    page.mouse.up()
    assert abs(state()[0] - start[0]) > 0.1
    page.get_by_role("button", name="Reset the view").first.click()
    assert state() == pytest.approx(start, abs=0.01)
    page.get_by_role("button", name="Turn left").first.click()
    assert state()[0] == pytest.approx(start[0] - 0.1745, abs=0.01)
    edges = page.get_by_role("button", name="Show edges").first
    edges.click()
    expect(edges).to_have_attribute("aria-pressed", "false")
    expect(canvas).to_have_accessible_name(re.compile("Worst shape .* Arrow keys turn it"))


def test_an_imported_shape_has_its_spectrum_and_says_why_no_mesh(visit):
    page = visit(f"#board={IMPORTED}&model=model")
    expect(page.locator(".mesh").first).to_contain_text("its file is not part of this project")
    expect(page.locator(".spectrum svg[role=img]")).to_have_count(2)
    assert page.locator("canvas").count() == 0


def test_a_large_mesh_says_that_it_is_simplified(visit, folders):
    def has(path, pattern):
        return re.search(pattern, path.read_text())

    places = sorted((folders / "real").rglob("*.js"))
    large = next(p for p in places if "meshes" in p.parts and has(p, r'"face_count":[2-9]\d{4}'))
    row = next(p for p in places if "rows" in p.parts and has(p, f"meshes/1.0/{large.stem}"))
    page = visit(f"#board={row.parent.name}&model={row.stem}", name="real")
    expect(page.locator(".detail")).to_contain_text("simplified for display to", timeout=60_000)


def test_without_webgl_all_but_the_mesh_is_there(visit, launch):
    page = visit("#model=far", using=launch("--disable-3d-apis"))
    expect(page.locator(".mesh").first).to_contain_text("This browser has no WebGL")
    expect(page.locator(".spectrum svg[role=img]")).to_have_count(2)
    assert page.locator("canvas").count() == 0


# --- what the first view costs ------------------------------------------------------------


@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_the_first_view_loads_less_than_400_kb_and_has_few_elements(new_page, folders, size):
    page = new_page(viewport=size)
    loaded = []
    page.on("request", lambda request: loaded.append(request.url))
    page.goto((folders / "real" / "index.html").as_uri())
    expect(page.locator("#chart svg[role=img]").first).to_be_visible()
    page.wait_for_load_state("networkidle")
    files = [Path(unquote(urlparse(url).path)) for url in loaded if url.startswith("file:")]
    assert {"page.js", "chart.js", "data.js", "style.css"} <= {file.name for file in files}
    assert sum(file.stat().st_size for file in files) < 400_000
    # What a slow processor has to lay out; the seconds that takes are not for a test
    assert 100 < page.locator("*").count() < 2000


def test_the_table_does_not_wait_for_the_chart(new_page, folders):
    page = new_page(viewport=PHONE)
    held = []
    page.route("**/chart.js", lambda route: held.append(route))  # neither answered nor refused
    with page.expect_request("**/chart.js"):
        page.goto((folders / "real" / "index.html").as_uri(), wait_until="commit")
    rows = page.locator("#table tbody tr")
    expect(rows.nth(10)).to_be_visible()
    assert len(held) == 1
    expect(page.locator("#chart svg[role=img]")).to_have_count(0)
    held[0].continue_()
    expect(page.locator("#chart svg[role=img]").first).to_be_visible()


# --- widths, themes, accessibility ---------------------------------------------------------

VIEWS = (
    "",
    "#model=far",
    "#columns=families-rpd",
    f"#board={HELD_OUT}",
    "#board=2.0-mini-test-grouped-mesh&columns=protocols-rpd",
    "#board=scaling",
    "#board=scaling&model=near",
    "#board=reported",
)


@pytest.mark.parametrize("width", [320, 390, 1440])
@pytest.mark.parametrize("view", VIEWS)
def test_no_view_scrolls_sideways(visit, view, width, overflow):
    page = visit(view, size={"width": width, "height": 800})
    if "model=far" in view:
        meshes(page)
    page.wait_for_timeout(200)
    assert overflow(page) == 0


def test_a_phone_has_a_card_a_row_and_sorts_by_any_column(visit, overflow):
    page = visit(size=PHONE, has_touch=True, is_mobile=True)
    page.get_by_text("Columns, filters, order").tap()
    page.get_by_label("Sort by").select_option("psnr20")
    expect(page.locator("#status")).to_contain_text("sorted by PSNR>20")
    card = page.locator("#table tbody tr").first
    shown = card.locator("td:visible").evaluate_all("cells => cells.map(one => one.dataset.title)")
    assert {"RPD ↓", "PSNR>20 ↑", "ms per mesh", "training set"} <= set(shown)
    page.get_by_role("link", name="Far", exact=True).tap()
    meshes(page)
    assert overflow(page) == 0


def test_on_a_phone_a_rank_its_why_and_the_name_stand_apart(visit):
    page = visit(name="real", size={"width": 320, "height": 800})
    apart = """rows => rows.map(row => row.querySelector(".name").getBoundingClientRect().left
        - row.querySelector(".why").getBoundingClientRect().right)"""
    assert min(page.locator("#table tbody tr").evaluate_all(apart)) >= 0


@pytest.mark.parametrize("of", ["board", "model"])
def test_nothing_is_cut_on_a4_and_the_table_stays_a_table(visit, real_board, overflow, of):
    row = real_board[0][0]
    page = visit(f"#model={row.slug}" if of == "model" else "", name="real", size=A4)
    if of == "model":
        meshes(page)
    page.emulate_media(media="print")
    assert overflow(page) == 0
    wide = "all => all.filter(one => one.scrollWidth > one.clientWidth + 1).length"
    assert page.locator(".board:visible, .scroll:visible").evaluate_all(wide) == 0
    if of == "board":
        # The rows are drawn anew when the medium changes: a row taken before is no longer there
        expect(page.locator("#table tbody tr").first).to_have_css("display", "table-row")


def test_head_ranks_and_names_stay_while_page_and_table_are_scrolled(visit):
    page = visit("#columns=families-rpd", name="real", size={"width": 1024, "height": 400})
    table = page.locator("#table .wide")
    top = table.bounding_box()["y"]
    page.evaluate("y => scrollTo(0, y)", top + 200)
    table.evaluate("table => table.scrollTo(200, 0)")
    frame = table.bounding_box()
    assert frame["y"] == pytest.approx(-200, abs=2)
    head = page.locator("#table thead")
    # The page moves its head when it hears of the scrolling, a moment later: not by 0 any more.
    expect(head).to_have_css("transform", re.compile(r"matrix\(1, 0, 0, 1, 0, [1-9]"))
    assert head.bounding_box()["y"] == pytest.approx(0, abs=2)
    row = page.locator("#table tbody tr").nth(12)
    rank, name = row.locator(".rank").bounding_box(), row.locator("th.name").bounding_box()
    assert rank["x"] == pytest.approx(frame["x"], abs=2)
    assert name["x"] == pytest.approx(rank["x"] + rank["width"], abs=2)
    above = page.evaluate("([x, y]) => document.elementFromPoint(x, y).closest('thead') !== null",
                          [name["x"] + 20, 10])  # fmt: skip
    assert above


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
@pytest.mark.parametrize("view", VIEWS)
def test_axe_finds_nothing(visit, view, size, scheme, violations):
    page = visit(view, size=size, scheme=scheme)
    if "model=far" in view:
        meshes(page)
    for summary in page.locator("summary:visible").all():
        summary.click()
    page.wait_for_timeout(200)
    assert violations(page) == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_axe_finds_nothing_on_the_real_board(visit, real_board, size, scheme, overflow, violations):
    page = visit(f"#model={real_board[0][0].slug}", name="real", size=size, scheme=scheme)
    meshes(page)
    assert violations(page) == []
    assert overflow(page) == 0


def test_theme_is_the_systems_until_one_is_chosen(visit):
    page = visit(scheme="dark")

    def ground():
        colour = page.evaluate("getComputedStyle(document.body).backgroundColor")
        return sum(map(int, re.findall(r"\d+", colour)[:3]))

    assert ground() < 150
    page.get_by_label("Theme").select_option("light")
    assert ground() > 700
    page.reload()
    expect(page.locator("#status")).not_to_be_empty()
    assert ground() > 700  # it is kept


def test_the_tab_key_reaches_the_table_at_once(visit):
    page = visit()
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "table"
    assert "board=" in page.evaluate("location.hash")  # the view is kept


FORBIDDEN = """() => new Promise((resolve) => {
  addEventListener("securitypolicyviolation", (event) =>
    resolve([event.effectiveDirective, event.blockedURI]));
  fetch("https://example.org/").catch(() => setTimeout(() => resolve("no violation"), 5000));
})"""


def test_the_policy_of_the_page_forbids_other_hosts(new_page, folders):
    page = new_page()
    page.goto((folders / "made" / "index.html").as_uri())
    # That the request fails is not enough: without a network it would without a policy
    assert page.evaluate(FORBIDDEN) == ["connect-src", "https://example.org/"]


# --- what is missing or unknown ------------------------------------------------------------


@pytest.fixture
def altered(new_page, folders, tmp_path):
    """Return a function that opens a copy of the page that was changed; it may log errors."""

    def opened(alter, view=f"#board={FIRST}"):
        folder = tmp_path / "altered"
        shutil.copytree(folders / "made", folder)
        alter(folder)
        page = new_page(viewport=WIDE)
        page.goto(f"{(folder / 'index.html').as_uri()}{view}")
        return page

    return opened


@pytest.mark.parametrize(("name", "where"), [("data.js", "#status"), ("chart.js", "#chart")])
def test_a_file_of_the_first_view_that_is_missing_is_said(altered, name, where):
    page = altered(lambda folder: (folder / name).unlink())
    expect(page.locator(where)).to_have_text(f"{name} of this page's folder cannot be loaded")


def test_shapes_that_cannot_be_loaded_are_said(altered):
    page = altered(lambda folder: shutil.rmtree(folder / "rows"), f"#board={FIRST}&model=far")
    expect(page.locator(".detail")).to_contain_text("cannot be loaded")


def test_columns_that_cannot_be_loaded_are_said(altered):
    page = altered(lambda folder: shutil.rmtree(folder / "columns"))
    expect(page.locator("#table")).to_contain_text("One percent")
    page.get_by_label("Columns").select_option("medians")
    said = f"columns/{FIRST}.js of this page's folder cannot be loaded"
    expect(page.locator("#status")).to_have_text(said)


def test_a_board_that_cannot_be_loaded_does_not_leave_the_one_before(altered):
    page = altered(
        lambda folder: [file.unlink() for file in folder.glob("boards/2.0-mini-*-surface.js")]
    )
    expect(page.locator("#table")).to_contain_text("One percent")
    page.get_by_label("Dataset").select_option("synthNet 2.0-mini")
    missing = re.compile(
        r"^boards/2\.0-mini-\S+-surface\.js of this page's folder cannot be loaded$"
    )
    expect(page.locator("#status")).to_have_text(missing)
    for part in ("#table", "#chart", "#notes"):
        expect(page.locator(part)).to_be_empty()
    expect(page.locator("h2")).to_have_text("This board cannot be shown")
    expect(page.locator("#controls")).to_be_hidden()
    assert page.get_by_label("Dataset").input_value() == "synthNet 2.0-mini"
    page.get_by_label("Dataset").select_option("synthNet 1.0-mini")
    expect(page.locator("#table")).to_contain_text("One percent")
    expect(page.locator("#controls")).to_be_visible()


@pytest.mark.parametrize("value", ["nothing", "toString"])
@pytest.mark.parametrize("name", ["sort", "columns", "metric", "training", "setting", "kinds"])
def test_what_a_linked_view_names_and_is_not_there_is_dropped(visit, name, value):
    page = visit(f"#{name}={value}")
    assert len(names(page)) == 4
    assert f"{name}=" not in page.evaluate("location.hash")


def test_a_linked_model_that_the_board_does_not_have_is_said_and_the_board_is_shown(visit):
    page = visit("#model=nobody")
    assert len(names(page)) == 4
    expect(page.locator("#status")).to_contain_text("no model “nobody” on this board. 4 of 4 rows")
    assert "model=" not in page.evaluate("location.hash")
    page.locator("#sort-rpd").click()
    expect(page.locator("#status")).not_to_contain_text("nobody")


def test_a_linked_board_that_is_not_there_is_said_and_the_first_one_shown(visit):
    page = visit("#board=nonsense&model=far")
    said = re.compile(r"^There is no board “nonsense”\. (\d+) of \1 rows shown")
    expect(page.locator("#status")).to_have_text(said)


def test_text_of_a_board_has_no_links_but_its_own(altered):
    notes = (
        r"\[name\](https://example.org/a) [b\]c](docs/rules.md#x) [out](javascript:alert%281%29) "
        r"[up](/etc/passwd) [far](https://example.org/d) **e \*\* f** \*\*g\*\* \`h\`"
    )

    def alter(folder):
        path = folder / "boards" / f"{FIRST}.js"
        text, count = re.subn(
            r'"notes":\[.*?\],"columns"',
            lambda _: f'"notes":[{json.dumps(notes)}],"columns"',
            path.read_text(),
        )
        assert count == 1
        path.write_text(text)

    page = altered(alter)
    page.get_by_text("How to read this").click()
    paragraph = page.locator("#notes details p").last
    expect(paragraph).to_have_text("[name](https://example.org/a) b]c out up far e ** f **g** `h`")
    links = paragraph.locator("a")
    addresses = [link.get_attribute("href") for link in links.all()]
    assert addresses == ["../docs/rules.md#x", "https://example.org/d"]
    assert paragraph.locator("strong").all_text_contents() == ["e ** f"]
    assert paragraph.locator("code").count() == 0


# --- filters, seeds, tips ------------------------------------------------------------------


def test_a_filter_leaves_the_front_as_it_is(visit):
    page = visit()
    chart = page.locator("#chart svg[role=img]").first
    whole = chart.get_attribute("aria-label")
    assert "Pareto front: One percent (" in whole
    front = chart.locator("[stroke='var(--front)'] path")
    drawn = front.get_attribute("d")
    page.get_by_label("classical").uncheck()
    assert "One percent" not in names(page)
    label = chart.get_attribute("aria-label")
    assert whole.partition("Pareto")[2] == label.partition("Pareto")[2]
    assert "4 rows, 1 of them faint" in label
    assert front.get_attribute("d") == drawn
    expect(page.locator("#chart")).to_contain_text("Pareto front: One percent.")
    expect(page.locator("#chart")).to_contain_text("faint: left out by the filters")


def test_an_imported_shape_says_that_one_of_several_seeds_is_shown(visit, real_board):
    imported = (row for row in real_board[0] if row.truth.protocol.startswith("imported/"))
    row = next(row for row in imported if len(row.predictions) > 1)
    page = visit(f"#board={row.board}-mesh&model={row.slug}", name="real")
    expect(page.locator(".shape").first).to_contain_text("Predicted by the first seed.")


def test_a_tip_goes_when_the_table_is_scrolled_below_it(visit):
    page = visit("#columns=families-rpd", size={"width": 800, "height": 800})
    page.locator("#sort-name").hover()
    expect(page.locator("#tip")).to_be_visible()
    table = page.locator("#table .scroll")
    table.evaluate("table => { table.scrollLeft = 8; }")
    expect(page.locator("#tip")).to_be_hidden()
    assert table.evaluate("table => table.scrollLeft") > 0
