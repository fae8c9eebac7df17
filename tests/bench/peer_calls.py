"""Another library's voxelization of a mesh, timed over its call alone; prints JSON.

Only the standard library at the top: this runs under whichever interpreter has the library.
`python -I peer_calls.py open3d MESH RESOLUTION MEMORY_BYTES`
"""

import json
import re
import resource
import sys
import time

# Voxel size = largest extent * GRID_MARGIN / N, as gstream places its grid.
GRID_MARGIN = 1 + 2.0**-10


def with_open3d(path, resolution):
    import open3d

    mesh = open3d.io.read_triangle_mesh(path)
    size = max(mesh.get_max_bound() - mesh.get_min_bound()) * GRID_MARGIN / resolution
    voxelize = open3d.geometry.VoxelGrid.create_from_triangle_mesh

    def count(grid):  # get_voxels() would make a Python object of each
        return int(re.search(r"with (\d+) voxels", repr(grid)).group(1))

    return open3d.__version__, lambda: voxelize(mesh, size), count


def with_trimesh(path, resolution):
    import trimesh

    mesh = trimesh.load(path, force="mesh", process=False)
    size = max(mesh.extents) * GRID_MARGIN / resolution
    return trimesh.__version__, lambda: mesh.voxelized(size), lambda grid: int(grid.filled_count)


def main():
    name, path, resolution, memory = sys.argv[1:]
    # as much memory as it takes is all that the machine has, for some
    resource.setrlimit(resource.RLIMIT_AS, (int(memory),) * 2)
    loaders = {"open3d": with_open3d, "trimesh": with_trimesh}
    version, call, count = loaders[name](path, int(resolution))
    cpu, wall = time.process_time(), time.perf_counter()
    grid = call()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    said = {"what": f"{name} {version}", "voxels": count(grid), "cpu_s": cpu, "wall_s": wall}
    print(json.dumps(said))


if __name__ == "__main__":
    main()
