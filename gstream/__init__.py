"""Out-of-core voxel preprocessing: triangle meshes in, one streamable block file out."""

__version__ = "0.1.0"
