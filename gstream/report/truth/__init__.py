"""What is true of a scene: its surface, its exact voxels, and how far a file is from both.

NumPy and the public reader only: nothing here shares code with what it judges.
"""
