"""The pages of README and docs, and what stands in them: blocks, commands, steps."""

import os
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("baselines/*.md")])
README = (ROOT / "README.md").read_text()
WHOLE = [
    *(ROOT / "docs" / name for name in ("start.md", "spectrum.md")),
    *sorted(ROOT.glob("docs/tutorials/*.md")),
]
DOCS = [page for page in [*ROOT.glob("docs/*.md"), ROOT / "README.md"] if page not in WHOLE]

STEP = re.compile(r"^```(sh|python|py|output)(?: title=\"(.+?)\")?\n(.*?)^```", flags=re.S | re.M)


def blocks(language, text=README):
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.S | re.M)


def commands(language, page):
    return [line for block in blocks(language, page.read_text()) for line in block.splitlines()]


def run(command, home, location, stdin=None):
    environment = {**os.environ, "SYNTHNET_HOME": str(home)}
    done = subprocess.run(
        command,
        cwd=location,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        input=stdin,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def steps(page):
    """Return a page's blocks, each with its language, the name of its file and its text."""
    return STEP.findall(page.read_text())
