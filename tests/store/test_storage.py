"""A dataset at a URL, against an S3-compatible server of the test's own."""

from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest

from synthnet import recipe, store
from synthnet.build.versions import build, ensure_built
from synthnet.commands.cli import main
from synthnet.errors import StoreError
from synthnet.store import storage
from synthnet.store.storage import RemotePath, location
from tests.conftest import only_line


@pytest.fixture(scope="module")
def server():
    """Endpoint of a server that has the bucket ``data``."""
    moto = pytest.importorskip("moto.server")
    s3fs = pytest.importorskip("s3fs")
    running = moto.ThreadedMotoServer(port=0, verbose=False)
    running.start()
    host, port = running.get_host_and_port()
    endpoint = f"http://{host}:{port}"
    system = s3fs.S3FileSystem(key="a", secret="b", endpoint_url=endpoint)
    system.mkdir("data")
    yield endpoint
    running.stop()


@pytest.fixture
def bucket(server, monkeypatch, request):
    monkeypatch.setenv("AWS_ENDPOINT_URL", server)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "a")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "b")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    return f"s3://data/{request.node.name}"


@pytest.mark.slow
def test_build_at_a_url_has_the_bytes_of_a_local_one(bucket, tiny, tmp_path):
    here = build(tiny, root=tmp_path, workers=1).dataset
    there = build(tiny, root=bucket, workers=1).dataset
    assert there.manifest == here.manifest
    for mine, its in zip(here.paths(), there.paths(), strict=True):
        assert isinstance(mine, Path)
        assert isinstance(its, RemotePath)
        assert its.read_bytes() == mine.read_bytes()
    assert build(tiny, root=bucket).nothing_to_do
    ids = [sample.spec.id for sample in there.samples()]
    assert ids == [sample.spec.id for sample in here.samples()]
    assert there.find("torus-00002").spec.id == "torus-00002"
    assert storage.names(location(bucket)) == [tiny.version]
    assert storage.names(location(f"{bucket}/nowhere")) == []


@pytest.mark.slow
def test_interrupted_build_at_a_url_goes_on(bucket, tiny):
    first = build(tiny, root=bucket, workers=1).dataset
    whole = [path.read_bytes() for path in first.paths()]
    missing, damaged, *_ = first.paths()
    missing.remove()
    damaged.write_bytes(whole[1][:-100])
    (first.directory / store.MANIFEST).remove()
    again = build(tiny, root=bucket, workers=1)
    assert again.reused == len(whole) - 2
    assert [path.read_bytes() for path in again.dataset.paths()] == whole


@pytest.mark.slow
def test_commands_take_a_url(bucket, mini_home, capsys):
    source = mini_home / "1.0-mini"
    for path in sorted(source.rglob("*")):
        if path.is_file():
            target = RemotePath(bucket) / "1.0-mini" / path.relative_to(source).as_posix()
            target.write_bytes(path.read_bytes())
    common = ["--version", "1.0-mini", "--out", bucket]
    assert main(["build", *common]) == 0
    assert main(["info", *common]) == 0
    assert main(["show", "torus-00005", *common]) == 0
    assert main(["verify", *common, "--sample", "1"]) == 0
    out = capsys.readouterr().out
    assert f"1.0-mini in {bucket}/1.0-mini: verified" in out
    with pytest.raises(StoreError, match="is not on this machine: copy it to a directory"):
        ensure_built("1.0-mini", bucket)


def test_missing_bucket_is_one_line(bucket, capsys):
    assert main(["build", "--version", "1.0-mini", "--out", "s3://nobody-has-it/x"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("synthnet: cannot write s3://nobody-has-it/x/1.0-mini/.writable (")


def test_unknown_protocol_is_one_line(capsys):
    assert main(["info", "--out", "nope://data"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.endswith("(Protocol not known: nope): choose another --out")


def test_file_url_is_a_path(tmp_path):
    assert location(f"file://{tmp_path}") == tmp_path
    assert storage.local(location(str(tmp_path)), "1.0") == tmp_path
    assert recipe.load("1.0").version in str(store.dataset_directory("1.0", f"file://{tmp_path}"))


@pytest.mark.slow
def test_build_at_a_url_of_directories_makes_them(tiny, tmp_path):
    report = build(tiny, root=f"local://{tmp_path}/deep/data", workers=1)
    assert isinstance(report.dataset.directory, RemotePath)
    assert (tmp_path / "deep" / "data" / "tiny" / "manifest.json").is_file()
    assert build(tiny, root=f"local://{tmp_path}/deep/data", workers=1).nothing_to_do


class Plain(SimpleHTTPRequestHandler):
    """Sends whole files alone, without ranges."""

    def log_message(self, *words):
        """Say nothing."""


class Refusing(Plain):
    """Has an error of its own for every request."""

    def do_GET(self):
        self.send_error(500)

    do_HEAD = do_GET


class CutShort(Plain):
    """Sends the first half of every shard."""

    def copyfile(self, source, outputfile):
        content = source.read()
        half = len(content) // 2 if "shards" in self.path else len(content)
        outputfile.write(content[:half])


@pytest.fixture
def served():
    """Return a function that serves a directory by HTTP, and returns its URL."""
    pytest.importorskip("aiohttp")
    running = []

    def serve(directory, handler):
        server = ThreadingHTTPServer(("127.0.0.1", 0), partial(handler, directory=directory))
        server.handle_error = lambda *_: None  # the client hangs up on whole files
        Thread(target=server.serve_forever, daemon=True).start()
        running.append(server)
        return f"http://127.0.0.1:{server.server_port}"

    yield serve
    for server in running:
        server.shutdown()
        server.server_close()


def test_a_server_without_ranges_will_do(served, mini_home, run):
    url = served(mini_home, Plain)
    for words in (["info"], ["show", "torus-00005"]):
        here = run(*words, "--version", "1.0-mini", "--out", mini_home)
        there = run(*words, "--version", "1.0-mini", "--out", url)
        assert there == (0, here[1].replace(str(mini_home), url), "")


def test_an_error_of_a_server_is_one_line(served, mini_home, run, tmp_path):
    url = served(mini_home, Refusing)
    line = only_line(*run("info", "1.0-mini", "--out", url))
    assert line.startswith(f"synthnet: cannot read {url}/1.0-mini/manifest.json (500, message=")
    assert line.endswith(": check the URL, the network and your credentials")
    url = served(mini_home, CutShort)
    line = only_line(*run("verify", "1.0-mini", "--files", "--out", url))
    assert line.startswith(f"synthnet: cannot read {url}/1.0-mini/shards/")
    url = served(tmp_path, Plain)
    line = only_line(*run("build", "1.0-mini", "--out", url))
    assert line.startswith(f"synthnet: cannot write {url}/1.0-mini/.writable (501")
