"""What a ladder found: printed and written as JSON and Markdown, anew after each run."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tests.bench import tables
from tests.bench.figures import DiskRate, least_seconds
from tests.bench.runs import Run
from tests.bench.slopes import slopes


@dataclass(slots=True)
class Result:
    """All measurements of one call of the driver."""

    machine: str
    settings: dict[str, Any]
    memory: int  # bytes of --memory
    disk: DiskRate
    compile_s: float  # CPU seconds of the kernels that were not in the cache
    starts: dict[str, float]  # CPU seconds of a tiny mesh, by `Run.start`
    runs: list[Run] = field(default_factory=list)
    peers: list[dict[str, Any]] = field(default_factory=list)  # each with its Run as `ours`
    failures: list[str] = field(default_factory=list)

    def write(self, folder: Path) -> None:
        (folder / "ladder.md").write_text(self.markdown())
        (folder / "ladder.json").write_text(json.dumps(self.as_dict(), indent=1) + "\n")

    def as_dict(self) -> dict[str, Any]:
        """As JSON values: the measurements, and what the tables compute of them."""
        found = asdict(self)
        for row, run in zip(found["runs"], self.runs, strict=True):
            sizes = (run.input_bytes, run.scratch_bytes, run.output_bytes)
            row["least_disk_s"] = least_seconds(self.disk, *sizes)
            row["estimate_over_used"] = run.estimate
            row["shares"] = run.shares
        return found | {"slopes": [asdict(slope) for slope in slopes(self.runs, self.starts)]}

    def markdown(self) -> str:
        rate = self.disk
        starts = ", ".join(f"{name} {seconds:.1f}" for name, seconds in self.starts.items())
        settings = " ".join(f"--{name} {value}" for name, value in self.settings.items())
        parts = [
            f"{self.machine}\n{settings}",
            f"Disk: {rate.read / 1e6:,.0f} MB/s read, {rate.write / 1e6:,.0f} MB/s written. "
            f"CPU s of a tiny mesh: {starts}. Compiling kernels: {self.compile_s:.1f} CPU s, in no "
            "run below.",
        ]
        if self.runs:
            longest = max(self.runs, key=lambda run: run.cpu_s)
            parts += [
                "## Speed and size\n\n" + tables.speed_table(self.runs, self.memory),
                "## Disk\n\n" + tables.disk_table(self.runs, rate),
                "## Share of CPU time\n\n" + tables.share_table(self.runs),
                f"## Stages of {tables.label(longest)}\n\n" + tables.stage_table(longest, rate),
            ]
        if laws := list(slopes(self.runs, self.starts)):
            parts.append("## Slopes\n\n" + tables.slope_table(laws))
        if self.peers:
            parts.append("## Beside others\n\n" + tables.peer_table(self.peers))
        if self.failures:
            parts.append("## Failed\n\n" + "\n".join(f"* {line}" for line in self.failures))
        return "\n\n".join(parts) + "\n"
