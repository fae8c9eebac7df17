"""An OBJ ten times the memory that its reader may take."""

import subprocess
import sys
from pathlib import Path

LIMIT = 48 << 20  # bytes of data beyond what the process holds after its kernels are compiled
TIMES = 10
TRIANGLE = "v 0.125 2.5 -1.0625\nv 3.75 0.5 1.25\nv 0.375 -4.125 2.75\nf -3 -2 -1\n"

READER = """
import re, resource, sys
from pathlib import Path
from gstream.readers import open_mesh
folder = Path(sys.argv[1])
open_mesh(folder / "small.obj", lambda name: folder / f"small-{name}")
held = int(re.search(r"VmData:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) << 10
limit = held + int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
mesh = open_mesh(folder / "large.obj", lambda name: folder / name)
print(mesh.triangle_count, mesh.positions.shape[0])
try:
    bytearray(2 * int(sys.argv[2]))
except MemoryError:
    print("limited")
"""


def test_an_obj_ten_times_the_memory_limit_is_read(tmp_path: Path) -> None:
    piece = TRIANGLE * 16_384
    pieces = LIMIT * TIMES // len(piece) + 1
    (tmp_path / "small.obj").write_text(TRIANGLE)
    with (tmp_path / "large.obj").open("w") as file:
        for _ in range(pieces):
            file.write(piece)
    command = [sys.executable, "-c", READER, str(tmp_path), str(LIMIT)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    triangles = pieces * 16_384
    assert done.stdout.split() == [str(triangles), str(3 * triangles), "limited"]
