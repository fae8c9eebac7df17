"""Other programs on the same mesh: libraries of Python, and any command line."""

import json
import shlex
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.bench.process import Cost, run

CALLS = Path(__file__).with_name("peer_calls.py")
NAMES = ("open3d", "trimesh")
HAS = "import sys; from importlib.util import find_spec; sys.exit(find_spec(sys.argv[1]) is None)"


@dataclass(slots=True)
class Peers:
    """Who is measured beside us, and what they may take."""

    names: tuple[str, ...]  # of NAMES
    pythons: tuple[str, ...]  # interpreters, tried in turn
    commands: tuple[str, ...]  # templates with {mesh}, {resolution} and {output}
    seconds: float
    memory: int  # bytes of address space of a library
    voxels: int  # of our result: above it they are not run
    given_up: set[str] = field(default_factory=set)  # killed once: what comes next is larger

    @classmethod
    def of(cls, args: Any) -> "Peers":
        """Of the driver's options."""
        wanted = tuple(filter(None, args.peers.split(",")))
        if unknown := [name for name in wanted if name not in NAMES]:
            raise SystemExit(f"--peers {','.join(unknown)}: there are {', '.join(NAMES)}")
        pythons = (*args.peer_python, sys.executable)
        memory = int(args.peer_memory * (1 << 30))
        return cls(
            wanted, pythons, tuple(args.command), args.peer_seconds, memory, args.peer_voxels
        )

    def measure(self, mesh: Path, resolution: int, folder: Path) -> list[dict[str, Any]]:
        """Figures of each, or its error in one line."""
        left = (who for who in (*self.names, *self.commands) if who not in self.given_up)
        return [
            self._library(who, mesh, resolution)
            if who in self.names
            else self._program(who, mesh, resolution, folder)
            for who in left
        ]

    def _library(self, name: str, mesh: Path, resolution: int) -> dict[str, Any]:
        for python in self.pythons:
            if not run([python, "-I", "-c", HAS, name]).returncode:
                break
        else:
            return {"what": name, "error": "no interpreter has it: give --peer-python"}
        command = [python, "-I", CALLS, name, mesh, str(resolution), str(self.memory)]
        cost = run(command, self.seconds)
        if cost.returncode:
            return {"what": name, "error": self._failure(name, cost)}
        return json.loads(cost.out.splitlines()[-1]) | {"peak_bytes": cost.peak_bytes}

    def _program(self, template: str, mesh: Path, resolution: int, folder: Path) -> dict[str, Any]:
        output = folder / "peer.out"
        values = {"{mesh}": mesh, "{resolution}": resolution, "{output}": output}
        command = shlex.split(template)
        name = Path(command[0]).name
        for place, value in values.items():
            command = [part.replace(place, str(value)) for part in command]
        try:
            cost = run(command, self.seconds)
        except OSError as error:
            return {"what": name, "error": str(error)}
        size = output.stat().st_size if output.is_file() else None
        output.unlink(missing_ok=True)
        if cost.returncode:
            return {"what": name, "error": self._failure(template, cost)}
        return {
            "what": name,
            "cpu_s": cost.cpu_s,
            "wall_s": cost.wall_s,
            "peak_bytes": cost.peak_bytes,
            "output_bytes": size,
        }

    def _failure(self, who: str, cost: Cost) -> str:
        if cost.wall_s > self.seconds:
            self.given_up.add(who)
            return f"killed after {self.seconds:,.0f} s"
        said = cost.err.strip().splitlines()
        return f"exit code {cost.returncode}: {said[-1] if said else '(silence)'}"
