"""Build and check every mesh of a folder, and say in one table how each ended.

`python -m tests.bench.outcomes FOLDER...`. A mesh ends well in a block file that `gstream check`
accepts, or in one line on stderr with a documented exit code and nothing left behind. The rest is
BAD, and the program's exit code is 1.
"""

import argparse
import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from tests.bench.process import gstream, machine, markdown

KINDS = {".ply", ".stl", ".obj", ".off"}
REFUSALS = {2, 3, 4, 5, 6}  # exit 1 is an error of ours


@dataclass(frozen=True, slots=True)
class Outcome:
    """How one mesh ended."""

    file: str
    verdict: str  # ok | refused | BAD
    said: str


def is_mesh(path: Path) -> bool:
    """By its name: a mesh we read, also as .gz; names with no known ending are left out."""
    name = path.name.lower().removesuffix(".gz")
    return path.is_file() and Path(name).suffix in KINDS


def attempt(mesh: Path, label: str, arguments: argparse.Namespace, folder: Path) -> Outcome:
    output, scratch = folder / "out.gsb", folder / "scratch"
    report = scratch / "report.json"
    scratch.mkdir(exist_ok=True)
    settings = ["--resolution", str(arguments.resolution), "--sep", arguments.sep]
    settings += ["--workers", arguments.workers, "--tmp", str(scratch), "--quiet"]
    settings += ["--report", str(report)]
    built = gstream("build", mesh, "-o", output, *settings, timeout=arguments.timeout)
    if built.returncode:
        return _refusal(label, built.returncode, built.err, folder)
    checked = gstream("check", output, timeout=arguments.timeout)
    held = json.loads(report.read_text())["file"]
    size = output.stat().st_size
    output.unlink()
    faults = [] if not checked.returncode else [f"check exits {checked.returncode}: {checked.out}"]
    faults += [f"stderr of a good build: {built.err}"] * bool(built.err.strip())
    faults += _leftovers(folder)
    if faults:
        return Outcome(label, "BAD", "; ".join(faults))
    voxels, read = held["levels"][0]["voxels"], held["ledger"]["triangles"]
    lost = ", ".join(
        f"{name} {count:,}"
        for name, count in held["ledger"].items()
        if name in ("non_finite", "degenerate", "outside", "unassigned") and count
    )
    said = f"{read:,} triangles, {voxels:,} voxels, {size / max(voxels, 1):.2f} bytes/voxel"
    return Outcome(label, "ok", f"{said}; {lost}" if lost else said)


def _refusal(label: str, code: int, err: str, folder: Path) -> Outcome:
    lines = err.strip().splitlines()
    faults = _leftovers(folder)
    if code not in REFUSALS:
        faults.append("killed after the time limit" if code == -9 else "no documented exit code")
    if len(lines) != 1:
        faults.append(f"{len(lines)} lines on stderr")
    if "Traceback" in err:
        faults.append("a traceback")
    said = f"exit {code}: {lines[-1] if lines else '(silence)'}"
    if faults:
        return Outcome(label, "BAD", f"{'; '.join(faults)}; {said}")
    return Outcome(label, "refused", said)


def _leftovers(folder: Path) -> list[str]:
    """What the command left where its output should be; scratch of a resumable job may stay."""
    left = [path.name for path in folder.iterdir() if path.name != "scratch"]
    for name in left:
        (folder / name).unlink()
    return [f"left behind: {', '.join(left)}"] if left else []


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--resolution", type=int, default=256)
    parser.add_argument("--sep", default="6")
    parser.add_argument("--workers", default="0")
    parser.add_argument("--timeout", type=float, default=300, help="seconds for one command")
    parser.add_argument("--all", action="store_true", help="files of any name")
    parser.add_argument("--markdown", type=Path, help="write the table here too")
    args = parser.parse_args()
    found: list[Outcome] = []
    for root in args.folders:
        wanted = (p for p in sorted(root.rglob("*")) if p.is_file() and (args.all or is_mesh(p)))
        for mesh in wanted:
            with tempfile.TemporaryDirectory(prefix="gstream-outcome-") as folder:
                label = str(mesh.relative_to(root.parent))
                found.append(attempt(mesh, label, args, Path(folder)))
            print(f"{found[-1].verdict:8}{found[-1].file}: {found[-1].said}", file=sys.stderr)
    rows = [[o.file, o.verdict, o.said.replace("|", "\\|").replace("\n", " ")] for o in found]
    counts = ", ".join(
        f"{sum(o.verdict == name for o in found)} {name}" for name in ("ok", "refused", "BAD")
    )
    text = f"{markdown(['file', '', 'outcome'], rows)}\n\n{len(found)} files: {counts}"
    print(f"{machine()}\n\n{text}")
    if args.markdown:
        args.markdown.write_text(text + "\n")
    sys.exit(any(o.verdict == "BAD" for o in found))


if __name__ == "__main__":
    main()
