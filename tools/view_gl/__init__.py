"""The OpenGL reference viewer."""
