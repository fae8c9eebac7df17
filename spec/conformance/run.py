"""Does a program read, or check, block files and geometry streams as the spec says?

    python run.py --level reader CMD...      python run.py --level validator CMD...

CMD is started once. It reads a path a line on standard input and answers each with one line of JSON
on standard output. README.md has the protocol, the levels, and how to claim one. Needs only Python.
"""

import argparse
import json
import queue
import subprocess
import sys
import threading
from pathlib import Path

VECTORS = Path(__file__).resolve().parents[1] / "vectors"


class Program:
    """The program under test: one line in, one line out."""

    def __init__(self, command, seconds):
        self.seconds = seconds
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
        self.lines = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        for line in self.process.stdout:
            self.lines.put(line)
        self.lines.put(None)

    def ask(self, path):
        """(answer, None), or (None, what went wrong); after that the program is of no more use."""
        try:
            self.process.stdin.write(f"{path}\n")
            self.process.stdin.flush()
            line = self.lines.get(timeout=self.seconds)
        except BrokenPipeError:
            line = None
        except queue.Empty:
            return None, f"no answer within {self.seconds} s"
        if line is None:
            return None, f"the program ended with status {self.process.wait()}"
        try:
            answer = json.loads(line)
        except ValueError:
            answer = None
        if not isinstance(answer, dict) or not {"valid", "codes"} <= answer.keys():
            return None, f'not an answer {{"valid": ..., "codes": [...]}}: {line.strip()[:200]}'
        return answer, None

    def end(self):
        self.process.kill()
        self.process.wait()


def levels_of(content):
    """Blocks, voxels and digests by level; a level without blocks is as good as none."""
    levels = content.get("levels", []) if isinstance(content, dict) else []
    return {level["level"]: level for level in levels if level.get("blocks", 1)}


def difference(expected, found):
    """The first thing that `found` has otherwise, as a sentence; None if there is none."""
    wanted, given = levels_of(expected), levels_of(found)
    if wanted.keys() != given.keys():
        return f"content of levels {sorted(given)}, expected {sorted(wanted)}"
    for number, level in sorted(wanted.items()):
        for what, count in level.items():
            if what != "columns" and given[number].get(what) != count:
                return f"level {number}: {what} {given[number].get(what)}, expected {count}"
        columns = given[number].get("columns", {})
        for name, digest in level["columns"].items():
            if columns.get(name) != digest:
                return f"level {number}, column {name}: {columns.get(name)}, expected {digest}"
    return None


def reader_fault(expected, answer):
    """Why a reader's answer is wrong, or None."""
    codes = ", ".join(expected["codes"])
    if codes == "unsupported" and answer["codes"] != ["unsupported"]:
        return f"{answer['codes']}, expected ['unsupported']: it is later, not damaged"
    if answer["valid"] is not True:
        if expected["reader"] == "read":
            return f"refused by {answer['codes']}, and is valid"
        return None
    if expected["reader"] == "refuse":
        return f"read, and breaks what a reader must notice: {codes}"
    if "content" in expected:
        return difference(expected["content"], answer.get("content"))
    return None


def validator_fault(expected, answer):
    """Why a validator's answer is wrong, or None."""
    if answer["valid"] is not expected["valid"]:
        return f"valid: {answer['valid']}, expected {expected['valid']}"
    if sorted(answer["codes"]) != expected["codes"]:
        return f"codes {sorted(answer['codes'])}, expected {expected['codes']}"
    return None


def main():
    """Ask for every vector; exit status 1 if an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--level", choices=("reader", "validator"), default="reader")
    parser.add_argument("--format", choices=("gsb", "gst"), help="only vectors of one format")
    parser.add_argument("--seconds", type=float, default=60, help="to wait for an answer")
    parser.add_argument("command", nargs=argparse.REMAINDER, help="the program and its arguments")
    chosen = parser.parse_args()
    if not chosen.command:
        parser.error("which program?")
    fault_of = reader_fault if chosen.level == "reader" else validator_fault
    vectors = json.loads((VECTORS / "expected.json").read_text())
    vectors = {n: e for n, e in vectors.items() if n.endswith(chosen.format or "")}
    program = Program(chosen.command, chosen.seconds)
    failed = 0
    for name, expected in vectors.items():
        answer, fault = program.ask(VECTORS / name)
        if answer:
            fault = fault_of(expected, answer)
        else:
            program.end()
            program = Program(chosen.command, chosen.seconds)
        if fault:
            failed += 1
            print(f"FAIL {name}: {fault}")
    program.end()
    print(f"{chosen.level}: {len(vectors) - failed} of {len(vectors)} vectors answered as expected")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
