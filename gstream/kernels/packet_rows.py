"""Where the values of a packet stand: rows of lanes (`lanes.py`) of arrays that its parts share.

Frame: the low corner of the lowest voxel the triangle may meet, corners sorted by coordinates, axes
(u, v, w) with w the normal's largest component: (x, y, z), (y, z, x) or (z, x, y).
"""

from gstream.kernels.cover import WALK_ROWS

EDGE = 8  # most voxels of the box along an axis
SHAPES = EDGE**3

# Rows of `words`. An axis' three rows are u, v, w; so are each corner's.
CORNER = 0  # 9: 3 * corner + axis
NORMAL = 9
OVER, UNDER = 12, 13  # the plane meets voxel x iff over + n.x >= 0 and under - n.x >= 0
BASE, LAST = 14, 17  # the box' first voxel in the room, and its last one relative to it
TURN = 20  # -1 where sorting mirrored the triangle, else 1
FIRST_AXIS = 21  # which of x, y, z axis u is
CENTRE_OVER, CENTRE_UNDER = 22, 25  # as over and under, for the centre segments along u, v, w
VALUE = 28  # n.x of the voxel at hand
MASK = 29  # face mask
PLACES = 30  # 3: the input's corner at each sorted place
WORD_ROWS = 33
# Rows of `edges`: 9 per projection, (a, b, threshold) of three edges; then 9 centre thresholds.
THRESHOLD, CENTRE = 2, 27
ROW_START, LINE = 36, 39  # of three edges, at the start of a row of squares and in it
EDGE_ROWS = 42
# Rows of `verdicts`: sign words of the voxel at hand, and of all voxels so far.
OUTSIDE, MISSED, ALL_MISSED = 0, 1, 2
VERDICT_ROWS = 3
# Rows of `names`: the Morton code of the voxel at hand, the triangle.
CODE, OWNER = 0, 1
NAME_ROWS = 2
# Rows of `reals`, after those of the walks: area units per square of the projection along w; area
# in the voxel at hand, and in those before it in its row; the normal along x, y, z; moment
# along v of those before; the centroid of the fragment at hand.
FACTOR, AREA, PASSED, DIRECTION = WALK_ROWS, WALK_ROWS + 1, WALK_ROWS + 2, WALK_ROWS + 3
PASSED_V, MEAN_U, MEAN_V = WALK_ROWS + 6, WALK_ROWS + 7, WALK_ROWS + 8
REAL_ROWS = WALK_ROWS + 9
# Rows of `affine`, 6 per channel: value at (0, 0), slopes along u and v, least and largest value,
# mean of the fragment at hand. The corners' values stand in the first three while it is made.
LEAST, LARGEST, MEAN = 3, 4, 5
AFFINE_ROWS = 6
